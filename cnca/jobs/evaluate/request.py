"""What ``cnca evaluate`` is asked for: textures on scenes, or labelled photographs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cnca.core.errors import RunError, did_you_mean
from cnca.core.options import COST, OUTPUT, WHAT, Flag
from cnca.judge.protocol_names import PROTOCOLS
from cnca.judge.rows import CONTROLS, IGNORE, OTHERS

OUT = Flag("Folder for results; a rerun goes on in it.", OUTPUT)
DETECTORS = Flag("[NAME=]builtin, .cfg or .onnx; repeatable.", name="detector")
SEED = Flag("Seed of everything random.")
PAPER_FIGURES = Flag("With --photos: the paper's Table 2 beside.", OUTPUT)


@dataclass(frozen=True)
class EvaluationRequest:
    """Textures to be judged on rendered views, or on CARLA's frames."""

    out: Annotated[Path, OUT]
    scenes: Annotated[tuple[Path, ...], Flag("Scene file; repeatable.", name="scene")] = ()
    textures: Annotated[
        tuple[str, ...],
        Flag(
            "[NAME=]PATH: UV picture, a run's folder, .npy colors of faces, or PATH@1.5m, a "
            "pattern that repeats every 1.5 m; repeatable.",
            name="texture",
        ),
    ] = ()
    detectors: Annotated[tuple[str, ...], DETECTORS] = ("builtin",)
    views: Annotated[int, Flag("Views of each scene.", COST)] = 96
    grid: Annotated[
        str | None, Flag("paper: a sample of its 8192 views; by default the scene's ranges.", WHAT)
    ] = None
    """A preset of :mod:`cnca.scene.paper_grid`."""
    carla: Annotated[
        Path | None, Flag("Folder of CARLA frames to draw the textures into.", WHAT)
    ] = None
    """They are drawn onto the vehicle in all of them."""
    fov: Annotated[float, Flag("Horizontal field of view of these frames.")] = 90.0
    """In degrees."""
    prompt: Annotated[
        str | None, Flag("Adds its texture with F_adv = 0 to the controls.", WHAT)
    ] = None
    generator: Annotated[
        Path | None, Flag("Folder in diffusers format; by default the shipped one.")
    ] = None
    controls: tuple[str, ...] = CONTROLS
    """Which of :data:`cnca.judge.rows.CONTROLS` stand beside the normal paint."""
    backend: str = "mitsuba"
    samples: Annotated[
        int | None, Flag("Rays per pixel instead of the scene's.", COST, name="spp")
    ] = None
    seed: Annotated[int, SEED] = 0
    others: Annotated[
        str, Flag("Other vehicles in the pictures: ignore them, or count as objects to find.", WHAT)
    ] = IGNORE
    protocol: Annotated[
        str | None,
        Flag("Show the measures of others alone: rpga, fca, padetbench or coco.", OUTPUT),
    ] = None
    """One of :data:`cnca.judge.protocol_names.PROTOCOLS`; the files hold all of them."""

    def __post_init__(self) -> None:
        """Raises RunError for what cannot be evaluated, SceneError for an unknown grid."""
        if not self.scenes:
            raise RunError("no --scene: give a scene file, or --photos with --labels")
        if self.others not in OTHERS:
            hint = did_you_mean(self.others, OTHERS)
            raise RunError(f"--others {self.others}: there are {' and '.join(OTHERS)}{hint}")
        if self.protocol is not None and self.protocol not in PROTOCOLS:
            hint = did_you_mean(self.protocol, PROTOCOLS)
            raise RunError(f"--protocol {self.protocol}: there are {', '.join(PROTOCOLS)}{hint}")
        if self.views < 2:
            raise RunError(f"--views {self.views}: an interval needs at least two views")
        if self.grid is not None:
            from cnca.scene.paper_grid import find_grid  # loads numpy

            find_grid(self.grid)
        if self.carla is not None and (self.grid is not None or len(self.scenes) != 1):
            raise RunError("--carla: frames have their own views; give one --scene and no --grid")
        if self.samples is not None and self.samples < 1:
            raise RunError(f"--spp {self.samples}: a picture needs at least one ray per pixel")


@dataclass(frozen=True)
class PhotoRequest:
    """Labelled photographs on which detectors are judged."""

    photos: Annotated[Path, Flag("Folder of photographs, one row for each folder in it.", WHAT)]
    labels: Annotated[Path, Flag("Their COCO .json, or a folder of VOC .xml or YOLO .txt.", WHAT)]
    out: Annotated[Path, OUT]
    detectors: Annotated[tuple[str, ...], DETECTORS] = ("builtin",)
    label_names: Annotated[
        str | None,
        Flag("Classes of .txt labels: coco, voc, a file of names, or names with commas.", WHAT),
    ] = None
    seed: Annotated[int, SEED] = 0
    paper_figures: Annotated[bool, PAPER_FIGURES] = False
