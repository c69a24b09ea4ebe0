"""Do detectors see the traffic of the built-in worlds, and nothing that is not there?

    python benchmarks/street_realism.py --detector yolox_nano.onnx --frames ../shared/data/streets

looks ahead from places in built-in worlds, as a driver does, and prints for each world, as one
line of JSON: how many of the vehicles over 40 pixels wide and not half hidden are reported (as any
vehicle, overlap at least one half), and how many reports per picture meet no vehicle; the last line
is the same count of false alarms on photographs or frames with YOLO labels (class 0: vehicle).

    python benchmarks/street_realism.py --detector yolox_nano.onnx --etron scenes/etron_carla.yaml

prints the scores of that scene's vehicle in its own paint, at its cameras, on the plane and in the
street, beside those of the frames that the cameras are of.  ``--color 0.05 0.45 0.55`` paints it
in that color (sRGB), such as the one that it has in the frames.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import torch

from cnca import build
from cnca.core.boxes import iou_matrix
from cnca.core.color import linear_to_srgb
from cnca.core.pictures import as_pictures, draw_boxes, write_png
from cnca.core.types import Boxes, Detections, SrgbImages, SrgbTexture
from cnca.judge.scores import as_one_class, detection_score
from cnca.mi_bridge.rays import Cameras
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.variant import mi
from cnca.mi_bridge.world_shapes import make_mesh
from cnca.scene.cameras import Spot, View
from cnca.scene.carla import read_carla_frame
from cnca.scene.load_scene import load_scene
from cnca.scene.protocols import Detector
from cnca.scene.schema import CarlaCamera, WorldSection
from cnca.scene.views import build_views
from cnca.scene.weather import Weather
from cnca.vehicle.builtin.sedan import build_sedan
from cnca.world.builtin import BUILTIN_WORLDS
from cnca.world.builtin import build as build_world
from cnca.world.model import World

THRESHOLD, OVERLAP = 0.25, 0.5
VEHICLES = ("car", "truck", "bus")
WIDEST, SHARE = 40, 0.5
"""Pixels over which, and visible share from which, a vehicle is to be found."""
SIZE = {"width": 640, "height": 380}


@dataclass
class Count:
    """What a detector made of some pictures."""

    pictures: int = 0
    expected: int = 0
    reported: int = 0
    false_alarms: int = 0

    def add(self, reports: Boxes, vehicles: Boxes, expected: Boxes) -> None:
        """Count one picture; ``expected`` are those of its vehicles that are to be found."""
        self.pictures += 1
        self.expected += len(expected)
        if len(reports) and len(expected):
            best = iou_matrix(expected, reports).max(dim=1).values
            self.reported += int((best >= OVERLAP).sum())
        if len(reports):
            best = torch.zeros(len(reports))
            if len(vehicles):
                best = iou_matrix(reports, vehicles).max(dim=1).values
            self.false_alarms += int((best < OVERLAP).sum())


def main() -> None:
    """Print one line of JSON for each world and for the frames, or for the scene's vehicle."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--detector", required=True)
    parser.add_argument("--world", action="append", choices=BUILTIN_WORLDS)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--places", type=int, default=4)
    parser.add_argument("--spp", type=int, default=32)
    parser.add_argument("--frames", type=Path)
    parser.add_argument("--every", type=int, default=8)
    parser.add_argument("--etron", type=Path)
    parser.add_argument("--color", type=float, nargs=3)
    parser.add_argument("--pictures", type=Path)
    options = parser.parse_args()
    detector = build.build_detector(options.detector)
    if options.etron:
        own_paint(options, detector)
        return
    for name in options.world or BUILTIN_WORLDS:
        count = Count()
        for seed in range(options.seeds):
            look_ahead(options, detector, name, seed, count)
        print(json.dumps({"world": name, **row(count)}), flush=True)
    if options.frames:
        print(json.dumps({"frames": str(options.frames), **row(frames(options, detector))}))


def row(count: Count) -> dict[str, float]:
    """Shares for printing."""
    return {
        "pictures": count.pictures,
        "expected": count.expected,
        "reported": round(count.reported / max(count.expected, 1), 3),
        "false_alarms": round(count.false_alarms / max(count.pictures, 1), 3),
    }


def look_ahead(
    options: argparse.Namespace, detector: Detector, name: str, seed: int, count: Count
) -> None:
    """Count what is reported in one world, seen over the bonnet of a car at several places."""
    world = build_world(name, seed)
    chosen = np.linspace(0, len(world.places) - 1, options.places).astype(int)
    for place in chosen:
        around = world.around(world.places[place])
        renderer = MitsubaRenderer(
            build_sedan(),
            texture_size=2,
            samples=options.spp,
            exposure=0.75,
            worlds=partial(_same, around),
        )
        view = View("ahead", (2.6, 0.0, 1.5), (12.0, 0.0, 1.2), (0.0, 0.0, 1.0), 80.0, **SIZE)
        with torch.no_grad():
            linear = renderer.render(torch.full((3, 2, 2), 0.4), [view], Weather(50, 70), seed=0)
        image = linear_to_srgb(linear)
        reports = vehicle_reports(detector, image)
        visible, shares = boxes_of(around, view)
        wide = (visible[:, 2] - visible[:, 0] > WIDEST) & (shares >= SHARE)
        count.add(reports.boxes, visible, visible[wide])
        if options.pictures:
            drawn = draw_boxes(as_pictures(image)[0], reports, ["vehicle"])
            for box in visible[wide].round().int().tolist():
                cv2.rectangle(drawn, tuple(box[:2]), tuple(box[2:]), (255, 255, 0), 1)
            write_png(options.pictures / f"{name}_{seed}_{place}.png", drawn)


def _same(world: World, _spot: Spot) -> World:
    return world


def vehicle_reports(detector: Detector, image: torch.Tensor) -> Detections:
    """Vehicles of any kind as class 0, a box once though it be called a car and a truck."""
    labels = [list(detector.class_names).index(name) for name in VEHICLES]
    return as_one_class(detector.detect(image, score_threshold=THRESHOLD)[0], labels)


def boxes_of(world: World, view: View) -> tuple[Boxes, torch.Tensor]:
    """Boxes of what is visible of each vehicle, and which share of the vehicle that is."""
    vehicles = [thing for thing in world.objects if thing.label in VEHICLES]
    owners = {index: number for number, thing in enumerate(vehicles) for index in thing.pieces}
    groups: dict[int, list[int]] = {}
    for index in range(len(world.pieces)):
        groups.setdefault(owners.get(index, -1), []).append(index)
    shapes = {number: _shape(world, indices) for number, indices in groups.items()}
    everything = mi.load_dict({"type": "scene", **{f"s{n}": s for n, s in shapes.items()}})
    ray, _ = Cameras([view]).rays(1)
    hit = everything.ray_intersect(ray)
    boxes, shares = [], []
    for number in range(len(vehicles)):
        seen = np.array(hit.is_valid() & (hit.shape == mi.ShapePtr(shapes[number])))
        if seen.sum() < 30:
            continue
        alone = mi.load_dict({"type": "scene", "vehicle": shapes[number]})
        whole = np.array(alone.ray_test(ray)).sum()
        rows, columns = np.nonzero(seen.reshape(view.height, view.width))
        boxes.append([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
        shares.append(seen.sum() / whole)
    return torch.tensor(boxes, dtype=torch.float32).reshape(-1, 4), torch.tensor(shares)


def _shape(world: World, indices: Sequence[int]) -> mi.Mesh:
    pieces = [world.pieces[index] for index in indices]
    starts = np.cumsum([0] + [len(piece.vertices) for piece in pieces[:-1]])
    return make_mesh(
        "group",
        mi.load_dict({"type": "diffuse"}),
        np.concatenate([piece.vertices for piece in pieces]),
        np.concatenate([p.faces + start for p, start in zip(pieces, starts, strict=True)]),
        np.concatenate([piece.normals for piece in pieces]),
        None,
    )


def frames(options: argparse.Namespace, detector: Detector) -> Count:
    """The same counts on pictures with YOLO labels."""
    count = Count()
    for file in sorted((options.frames / "images").glob("*.jpg"))[:: options.every]:
        picture = cv2.cvtColor(cv2.imread(str(file)), cv2.COLOR_BGR2RGB)
        height, width = picture.shape[:2]
        image = torch.from_numpy(picture).permute(2, 0, 1)[None].float() / 255
        labels = options.frames / "labels" / f"{file.stem}.txt"
        numbers = np.loadtxt(labels, ndmin=2) if labels.stat().st_size else np.zeros((0, 5))
        x, y, w, h = (numbers[numbers[:, 0] == 0][:, 1:] * [width, height, width, height]).T
        corners = np.stack([x - w / 2, y - h / 2, x + w / 2, y + h / 2], axis=1)
        vehicles = torch.from_numpy(corners).float()
        wide = vehicles[:, 2] - vehicles[:, 0] > WIDEST
        count.add(vehicle_reports(detector, image).boxes, vehicles, vehicles[wide])
    return count


def own_paint(options: argparse.Namespace, detector: Detector) -> None:
    """Print the scores of the scene's vehicle: in the frames, on the plane, in each street."""
    scene = load_scene(options.etron)
    vehicle, views = build.build_vehicle(scene), build_views(scene)
    color = (
        None if options.color is None else SrgbTexture(torch.tensor(options.color)[:, None, None])
    )
    albedo = build.build_paint(scene, vehicle).apply(color)
    label = build.vehicle_label(detector.class_names)
    files = [camera.carla for camera in scene.cameras if isinstance(camera, CarlaCamera)]
    photographs = np.stack([read_carla_frame(scene.base / file).image for file in files])
    for seed in range(-1, options.seeds):
        section = WorldSection(file="builtin:street", seed=seed) if seed >= 0 else None
        placed = scene.model_copy(update={"world": section})
        renderer = build.build_path_tracer(placed, vehicle, samples=options.spp)
        boxes = renderer.vehicle_boxes(views)
        if seed < 0:
            images = torch.from_numpy(photographs).permute(0, 3, 1, 2).contiguous()
            print(json.dumps({"frames": scores(detector, images, boxes, label)}))
        with torch.no_grad():
            linear = [renderer.render(albedo, [v], scene.weather(), seed=0) for v in views]
        images = linear_to_srgb(torch.cat(linear))
        name = f"street {seed}" if seed >= 0 else "plane"
        print(json.dumps({name: scores(detector, images, boxes, label)}), flush=True)
        if options.pictures:
            for view, picture in zip(views, as_pictures(images), strict=True):
                write_png(options.pictures / f"{name.replace(' ', '_')}_{view.name}.png", picture)


def scores(detector: Detector, images: SrgbImages, boxes: Boxes, label: int) -> list[float]:
    """Of the vehicle in each picture."""
    found = [detector.detect(image[None], score_threshold=0.01)[0] for image in images]
    pairs = zip(found, boxes, strict=True)
    return [round(detection_score(detections, box, label), 2) for detections, box in pairs]


if __name__ == "__main__":
    main()
