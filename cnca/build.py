"""The one place that turns names and files into objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch

from cnca.color import srgb_to_linear
from cnca.detect import BUILTIN, BUILTIN_CONFIG, load_detector
from cnca.errors import CncaError, MeshError, SceneError, did_you_mean
from cnca.paint import Paint
from cnca.protocols import Detector, Renderer, Residual, TextureGenerator
from cnca.scene.cameras import View, orbit_view
from cnca.scene.carla import carla_view, read_carla_frame
from cnca.scene.effects import Demand
from cnca.scene.images import read_mask, read_texture_srgb
from cnca.scene.load_mesh import resolve_vehicle
from cnca.scene.mesh import Vehicle
from cnca.scene.schema import CarlaCamera, Scene
from cnca.scene.uv import paint_mask
from cnca.types import SrgbTexture

BACKENDS = ("mitsuba",)
SHIPPED_GENERATOR = Path(__file__).parent / "assets" / "generator"


def build_vehicle(scene: Scene) -> Vehicle:
    """The scene's vehicle, facing +x and standing on z = 0."""
    section = scene.vehicle
    path = scene.base / section.mesh
    if section.missing and not path.exists():
        raise MeshError(f"{path}: no such file; {section.missing}")
    vehicle = resolve_vehicle(
        section.mesh,
        scene.base,
        up=section.up,
        front=section.front,
        scale=section.scale,
        materials=section.materials,
        unwrap=section.unwrap,
    )
    return replace(vehicle, paint=replace(vehicle.paint, **section.finish.model_dump()))


def build_paint(scene: Scene, vehicle: Vehicle) -> Paint:
    """The vehicle's own texture and the mask of its paint, at the scene's texture size."""
    section, size = scene.vehicle, scene.vehicle.texture_size
    if section.paint_mask:
        mask = read_mask(scene.base / section.paint_mask).astype(np.float32)
        mask = cv2.resize(mask, (size, size), interpolation=cv2.INTER_AREA)
    else:
        mask = paint_mask(vehicle, size).astype(np.float32)
    if section.base_texture:
        base = read_texture_srgb(scene.base / section.base_texture)
        base = cv2.resize(base, (size, size), interpolation=cv2.INTER_AREA)
    else:
        base = np.full((size, size, 3), section.paint, np.float32)
    return Paint(
        torch.from_numpy(base).permute(2, 0, 1).contiguous().clamp(0, 1),
        torch.from_numpy(mask)[None].clamp(0, 1),
    )


def build_renderer(
    scene: Scene,
    vehicle: Vehicle,
    *,
    backend: str = "mitsuba",
    samples: int | None = None,
    demand: Demand | None = None,
) -> Renderer:
    """The renderer called ``backend`` for the scene's vehicle and ground.

    Raises CncaError for an unknown name.
    """
    if backend not in BACKENDS:
        hint = did_you_mean(backend, BACKENDS)
        raise CncaError(f"backend '{backend}': unknown; there is {', '.join(BACKENDS)}{hint}")
    from cnca.mi_bridge.renderer import MitsubaRenderer

    ground = srgb_to_linear(torch.tensor(scene.ground.color))
    return MitsubaRenderer(
        vehicle,
        ground_albedo=ground.tolist(),
        texture_size=scene.vehicle.texture_size,
        samples=samples or scene.image.samples,
        exposure=scene.image.exposure,
        demand=demand,
    )


def build_loop_renderer(
    scene: Scene, vehicle: Vehicle, paint: Paint, *, backend: str, samples: int
) -> Renderer:
    """The renderer of an optimization: it comes back to its views, so backgrounds are kept."""
    from cnca.mi_bridge.backgrounds import KeptBackgrounds
    from cnca.mi_bridge.renderer import MitsubaRenderer

    renderer = build_renderer(scene, vehicle, backend=backend, samples=samples)
    assert isinstance(renderer, MitsubaRenderer)
    return KeptBackgrounds(renderer, paint.apply())


def build_views(scene: Scene) -> list[View]:
    """The cameras that the scene names."""
    width, height = scene.image.width, scene.image.height
    views = []
    for camera in scene.cameras:
        if isinstance(camera, CarlaCamera):
            frame = read_carla_frame(scene.base / camera.carla)
            view = carla_view(
                frame.vehicle,
                frame.camera,
                lift=camera.lift,
                width=width,
                height=height,
                fov=camera.fov,
                name=camera.name or Path(camera.carla).stem,
            )
        else:
            view = orbit_view(
                camera.azimuth,
                camera.elevation,
                camera.distance,
                fov=camera.fov,
                width=width,
                height=height,
                target=camera.target,
                name=camera.name,
            )
        views.append(view)
    return views


def choose_views(scene: Scene, name: str | None, *, every: bool = False) -> list[View]:
    """The view called ``name``, all of them, or the first; raises SceneError for another name."""
    views = build_views(scene)
    if every:
        return views
    if name is None:
        return views[:1]
    chosen = [view for view in views if view.name == name]
    if not chosen:
        names = [view.name for view in views]
        hint = did_you_mean(name, names)
        raise SceneError(f"view '{name}': the scene has {', '.join(names)}{hint}")
    return chosen


def build_generator(path: Path | None, *, tokens: int, guidance: float) -> TextureGenerator:
    """The diffusion pipeline in a folder in diffusers format; None is the shipped one."""
    from cnca.gen.sampling import DiffusionTextureGenerator

    return DiffusionTextureGenerator.load(path, tokens=tokens, guidance=guidance)


def build_residual(path: Path | None) -> Residual | None:
    """The trained EFR in a safetensors file; without a path nothing of it is even imported."""
    if path is None:
        return None
    from cnca.efr.unet import EnvironmentFeatureRenderer

    return EnvironmentFeatureRenderer.load(path)


def build_detector(spec: str) -> Detector:
    """The detector called ``spec``: ``builtin``, a Darknet ``.cfg`` or an ``.onnx`` file."""
    return load_detector(spec)


def read_texture(path: str | Path) -> SrgbTexture:
    """A texture file as a tensor (3, height, width) in [0, 1]."""
    return torch.from_numpy(read_texture_srgb(path)).permute(2, 0, 1).contiguous()


def vehicle_label(class_names: Sequence[str], wanted: str = "car") -> int:
    """The index of class ``wanted``; raises CncaError where it is missing."""
    if wanted not in class_names:
        raise CncaError(f"the detector knows no class '{wanted}': it has {', '.join(class_names)}")
    return list(class_names).index(wanted)


def input_files(
    scene: Scene, scene_file: Path, detector: str, generator: Path | None
) -> list[Path]:
    """Every file that a run reads, for its manifest."""
    section = scene.vehicle
    named = [section.paint_mask, section.base_texture]
    named += [] if section.mesh.startswith("builtin:") else [section.mesh]
    files = [scene_file, *(scene.base / name for name in named if name)]
    files.append(Path(generator or SHIPPED_GENERATOR))
    config = BUILTIN_CONFIG if detector == BUILTIN else Path(detector)
    files += sorted(config.parent.glob(f"{config.stem}.*"))
    return files
