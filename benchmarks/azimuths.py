"""Do detectors call the vehicle of a scene a car?  Twelve azimuths at 12° elevation.

    python benchmarks/azimuths.py scenes/sedan_clear.yaml --detector A.cfg --detector B.onnx

prints, for each detector, in how many views it reports ``car`` above 0.25 with an overlap of at
least one half with the vehicle's box, and the score of each view.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import torch

from cnca import build
from cnca.core.color import linear_to_srgb
from cnca.core.pictures import as_pictures, draw_boxes, side_by_side, write_png
from cnca.judge.scores import detection_score
from cnca.scene.cameras import orbit_view
from cnca.scene.load_scene import load_scene

AZIMUTHS = range(0, 360, 30)
THRESHOLD = 0.25


def main() -> None:
    """Render the views, ask the detectors, print one line of JSON for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--detector", action="append", required=True)
    parser.add_argument("--distance", type=float, default=8.0)
    parser.add_argument("--fov", type=float, default=50.0)
    parser.add_argument("--size", type=int, default=320)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()

    scene = load_scene(options.scene)
    vehicle = build.build_vehicle(scene)
    renderer = build.build_renderer(scene, vehicle, samples=options.spp)
    albedo = build.build_paint(scene, vehicle).apply()
    lens = {"fov": options.fov, "width": options.size, "height": options.size}
    views = [orbit_view(float(a), 12.0, options.distance, **lens) for a in AZIMUTHS]
    with torch.no_grad():
        images = linear_to_srgb(
            torch.cat([renderer.render(albedo, [v], scene.weather(), seed=0) for v in views])
        )
    boxes = renderer.vehicle_boxes(views)
    for spec in options.detector:
        detector = build.build_detector(spec)
        label = build.vehicle_label(detector.class_names)
        found = detector.detect(images, score_threshold=0.01)
        scores = [detection_score(d, b, label) for d, b in zip(found, boxes, strict=True)]
        row = {
            "scene": str(options.scene),
            "detector": detector.name,
            "found": sum(score > THRESHOLD for score in scores),
            "of": len(scores),
            "scores": [round(score, 2) for score in scores],
        }
        print(json.dumps(row))
    if options.picture:
        sure = [d.above(THRESHOLD) for d in found]
        pictures = as_pictures(images)
        drawn = [
            draw_boxes(p, d, detector.class_names, b)
            for p, d, b in zip(pictures, sure, boxes, strict=True)
        ]
        write_png(options.picture, side_by_side(drawn, columns=4))


if __name__ == "__main__":
    main()
