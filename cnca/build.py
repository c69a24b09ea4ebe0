"""The one place that turns names and files into objects."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import torch

from cnca.attack.targets import Target, parse_targets
from cnca.core.color import decode
from cnca.core.errors import CncaError, GeneratorError, MeshError, TextureError
from cnca.core.hub import hub_folder, is_hub_name
from cnca.core.images import read_mask, read_texture_srgb
from cnca.core.plugins import is_plugin, load_plugin, plugin_file
from cnca.core.types import SrgbTexture
from cnca.detect import detector_files, load_detector
from cnca.detect.classes import CAR, known_name, vehicle_labels
from cnca.effects.plan import Demand
from cnca.effects.prices import SHIPPED as SHIPPED_PRICES
from cnca.effects.protocols import PlanningRenderer
from cnca.mi_bridge.backends import is_own_backend, parse_backend
from cnca.scene import shipped
from cnca.scene.cameras import Spot
from cnca.scene.named_files import named_files
from cnca.scene.paint import Paint
from cnca.scene.protocols import Detector, LoopRenderer, Residual, TextureGenerator
from cnca.scene.schema import Scene
from cnca.vehicle.mesh.load_mesh import resolve_vehicle
from cnca.vehicle.model import Vehicle
from cnca.vehicle.uv.masks import pad_mask, paint_mask
from cnca.world.model import World
from cnca.world.resolve import resolve_world, world_at

if TYPE_CHECKING:
    from cnca.mi_bridge.renderer import MitsubaRenderer

CACHE_FACTOR = 4
"""Rays per pixel of kept shading relative to those of a picture: its noise stays for ever."""
SEAM_PADDING = 2
"""Texels of paint around every chart, for the filters."""
SHIPPED_GENERATOR = Path(__file__).parent / "assets" / "generator"
GENERATOR_FILES = ("model_index.json", "*/*.json", "*/*.txt", "*/*.safetensors")
"""Of a pipeline on the Hugging Face hub."""
SHIPPED_EFR = Path(__file__).parent / "assets" / "efr" / "raster.safetensors"


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
        recentre=section.recentre,
    )
    return replace(
        vehicle,
        paint=replace(vehicle.paint, **section.finish.model_dump()),
        glass=replace(vehicle.glass, transmission=section.glass_transmission),
    )


def build_worlds(scene: Scene) -> Callable[[Spot], World] | None:
    """What stands around the scene's vehicle at each spot, moved so that it is in the origin."""
    section = scene.world
    if section is None:
        return None

    return lambda spot: world_at(section, scene.base, spot)


def build_paint(scene: Scene, vehicle: Vehicle) -> Paint:
    """The vehicle's own texture and the mask of its paint, at the scene's texture size."""
    section, size = scene.vehicle, scene.vehicle.texture_size
    if section.paint_mask:
        drawn = read_mask(scene.base / section.paint_mask)
        if drawn.shape[0] != drawn.shape[1]:
            raise TextureError(f"{section.paint_mask}: paint masks are square; it is {drawn.shape}")
        padding = SEAM_PADDING * max(1, len(drawn) // size)
        mask = pad_mask(drawn, vehicle, padding).astype(np.float32)
        mask = cv2.resize(mask, (size, size), interpolation=cv2.INTER_AREA)
    else:
        mask = paint_mask(vehicle, size).astype(np.float32)
    if section.base_texture:
        base = read_texture_srgb(scene.base / section.base_texture)
        base = cv2.resize(base, (size, size), interpolation=cv2.INTER_AREA)
    else:
        base = np.full((size, size, 3), section.paint, np.float32)
    return Paint(
        SrgbTexture(torch.from_numpy(base).permute(2, 0, 1).contiguous().clamp(0, 1)),
        torch.from_numpy(mask)[None].clamp(0, 1),
    )


def build_renderer(
    scene: Scene,
    vehicle: Vehicle,
    *,
    backend: str = "mitsuba",
    samples: int | None = None,
    demand: Demand | None = None,
) -> PlanningRenderer:
    """The path tracer, whichever ``backend`` a loop has: it judges them all.

    Raises CncaError for an unknown name.
    """
    if not is_own_backend(backend):
        parse_backend(backend)
    return build_path_tracer(scene, vehicle, samples=samples, demand=demand)


def build_path_tracer(
    scene: Scene, vehicle: Vehicle, *, samples: int | None = None, demand: Demand | None = None
) -> MitsubaRenderer:
    """The path tracer with all that only Mitsuba knows.

    Args:
        samples: rays per pixel; by default the scene's.
        demand: which effects to render how; by default the usual ones.
    """
    from cnca.mi_bridge.renderer import MitsubaRenderer

    ground = decode(torch.tensor(scene.ground.color))
    return MitsubaRenderer(
        vehicle,
        ground_albedo=ground.tolist(),
        texture_size=scene.vehicle.texture_size,
        samples=samples or scene.image.samples,
        exposure=scene.image.exposure,
        demand=demand,
        worlds=build_worlds(scene),
        wetness=scene.ground.wetness,
    )


def build_loop_renderer(
    scene: Scene, vehicle: Vehicle, paint: Paint, *, backend: str, samples: int
) -> LoopRenderer:
    """The renderer of an optimization: it comes back to its views, so much of them is kept.

    ``backend`` is one of :mod:`cnca.mi_bridge.backends`; one of a user's own,
    ``module:attribute``, is called with scene, vehicle, paint and ``samples``, the rays per pixel.
    """
    if is_own_backend(backend):
        return load_plugin(backend, LoopRenderer, scene, vehicle, paint, samples=samples)
    from cnca.mi_bridge.backgrounds import KeptBackgrounds
    from cnca.mi_bridge.lookups import LookupRenderer
    from cnca.mi_bridge.raster import PlainShading
    from cnca.mi_bridge.shading_cache import TracedShading

    name, refresh = parse_backend(backend)
    kept = KeptBackgrounds(build_path_tracer(scene, vehicle, samples=samples), paint.apply())
    if name == "mitsuba":
        return kept
    if vehicle.glass.transmission > 0:
        raise CncaError(
            f"backend '{backend}': sees nothing behind glass; set vehicle.glass_transmission to 0, "
            "or take the backend mitsuba"
        )
    if name == "raster":
        return LookupRenderer(kept, PlainShading(kept))
    return LookupRenderer(kept, TracedShading(kept, CACHE_FACTOR * samples), refresh)


def build_generator(
    path: Path | None,
    *,
    device: str = "cpu",
    mixed_precision: bool = False,
    **options: Any,
) -> TextureGenerator:
    """The diffusion pipeline in a folder in diffusers format; None is the shipped one.

    ``hf:OWNER/NAME`` is fetched once from the Hugging Face hub.

    ``mixed_precision`` lets the U-Net multiply in bfloat16; ``options`` are those of
    :class:`cnca.gen.sampling.DiffusionTextureGenerator`.  A generator of a user's own,
    ``module:attribute``, has its own options and is given none.
    """
    if path is not None and is_plugin(str(path)) and not is_hub_name(str(path)):
        return load_plugin(str(path), TextureGenerator, error=GeneratorError)
    from cnca.gen.sampling import DiffusionTextureGenerator

    if path is not None and is_hub_name(str(path)):
        path = hub_folder(str(path), GENERATOR_FILES, GeneratorError)
    half = torch.bfloat16 if mixed_precision else None
    return DiffusionTextureGenerator.load(path, device=device, half=half, **options)


def build_residual(path: Path | None) -> Residual | None:
    """The trained EFR in a safetensors file, or the shipped one, which is called ``builtin``.

    Without a path nothing of it is even imported.
    """
    if path is None:
        return None
    from cnca.efr.unet import EnvironmentFeatureRenderer

    return EnvironmentFeatureRenderer.load(efr_file(path))


def efr_file(path: Path) -> Path:
    """Where the EFR called ``path`` lies."""
    return SHIPPED_EFR if path == Path("builtin") else path


def build_detector(spec: str) -> Detector:
    """The detector called ``spec``; see :func:`cnca.detect.load_detector`."""
    return load_detector(spec)


def build_targets(words: Sequence[str], label: str = CAR) -> list[Target]:
    """Detectors with their weights (:func:`cnca.attack.targets.parse_targets`) for one class.

    ``label`` is what the scene's vehicle is; raises DetectorError for a detector without it.
    """
    targets = []
    for name, weight in parse_targets(words).items():
        detector = build_detector(name)
        number = vehicle_label(detector.class_names, label, detector=f"detector {name}")
        targets.append(Target(name, detector, number, weight))
    return targets


def read_texture(path: str | Path) -> SrgbTexture:
    """A texture file as a tensor (3, height, width) in [0, 1]."""
    return SrgbTexture(torch.from_numpy(read_texture_srgb(path)).permute(2, 0, 1).contiguous())


def vehicle_label(
    class_names: Sequence[str], label: str = CAR, *, detector: str = "the detector"
) -> int:
    """The detector's number for the vehicle's class; see :func:`vehicle_labels`."""
    return vehicle_labels(class_names, label, detector=detector)[known_name(label)][0]


def input_files(
    scene: Scene,
    scene_file: Path,
    detectors: Iterable[str],
    generator: Path | None,
    efr: Path | None = None,
    parts: Iterable[str] = (),
) -> list[Path]:
    """Every file that a run reads, for its manifest.

    ``parts`` are names of further parts, of which those of a user's own lie in files.
    """
    files = [file for name in detectors for file in detector_files(name)]
    files += [efr_file(efr)] if efr else []
    plugins = [plugin_file(part) for part in parts if is_plugin(part)]
    files += [file for file in plugins if file]
    return [*scene_files(scene, scene_file), *generator_files(generator), *files]


def generator_files(path: Path | None) -> list[Path]:
    """What :func:`build_generator` reads: a folder, or where a user's own is written."""
    if path is not None and is_hub_name(str(path)):
        return [hub_folder(str(path), GENERATOR_FILES, GeneratorError)]
    if path is None or not is_plugin(str(path)):
        return [path or SHIPPED_GENERATOR]
    file = plugin_file(str(path))
    return [file] if file else []


def scene_files(scene: Scene, scene_file: Path) -> list[Path]:
    """The scene file, all that it names, and what these name in turn."""
    return [shipped.scene_file(scene_file), *files_behind(scene), SHIPPED_PRICES]


def files_behind(scene: Scene) -> list[Path]:
    """All files that a scene names, and those that these name in turn."""
    files = named = named_files(scene)
    if named:
        from cnca.vehicle.mesh.companions import mesh_companions  # loads trimesh

        files = named + [file for path in named for file in mesh_companions(path)]
    if scene.world and not scene.world.file.startswith("builtin:"):
        files += map(Path, resolve_world(scene.world, scene.base).source)
    return list(dict.fromkeys(files))
