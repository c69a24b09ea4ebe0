"""``cnca train-efr``: pairs of cheap and true pictures, rendered or photographed, and the training.

From renders, X_nr is what a backend draws and the truth what the path tracer does; test views,
weathers and *kinds* of textures differ from those of the training.  From CARLA frames, the truth is
the photograph: a few pictures of one car in one paint teach nothing about other textures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch
from rich.console import Console

from cnca import build
from cnca.core import parallel
from cnca.core.color import srgb_to_linear
from cnca.core.errors import RunError
from cnca.core.manifest import hashes, versions, write_json
from cnca.core.progress import bar
from cnca.core.records import as_json
from cnca.core.run_folder import RunFolder
from cnca.core.types import LinearImages, LinearTexture, PlainPictures, SrgbTexture
from cnca.gen import textures
from cnca.jobs.datasets.carla import fit_frame
from cnca.jobs.efr_request import EfrRequest
from cnca.judge.held_out import HELD_OUT_SEED
from cnca.mi_bridge.backends import BACKENDS
from cnca.mi_bridge.backgrounds import KeptBackgrounds
from cnca.mi_bridge.lookups import LookupRenderer
from cnca.mi_bridge.shading_cache import TracedShading
from cnca.scene import controls
from cnca.scene.cameras import View
from cnca.scene.carla import read_carla_frame
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import Scene
from cnca.scene.variation import draw_views, draw_weathers
from cnca.scene.weather import Weather
from cnca.train.efr import Outcome, Shot, train
from cnca.train.loop import TrainingLoop

WEATHERS, TEST_SHARE = 16, 0.25
TEXTURES = 6
"""Textures of each view."""
TRUTH_SAMPLES, TRUTH_SEED = 128, 0x51ED270B
"""Rays per pixel of the truth; a seed of its own, or X_ref would hold the truth's noise."""


class Studio:
    """One scene's vehicle, drawn by a cheap backend and by the path tracer."""

    def __init__(self, scene: Scene, backend: str, samples: int) -> None:
        vehicle = build.build_vehicle(scene)
        self.vehicle, self._paint = vehicle, build.build_paint(scene, vehicle)
        loop = build.build_loop_renderer(
            scene, vehicle, self._paint, backend=backend, samples=samples
        )
        if not isinstance(loop, KeptBackgrounds | LookupRenderer):
            raise RunError(f"--backend {backend}: an EFR corrects {', '.join(BACKENDS)}")
        self._loop = loop
        self._kept = loop if isinstance(loop, KeptBackgrounds) else loop.kept

    @torch.no_grad()
    def shoot(
        self, view: View, weather: Weather, paints: Sequence[SrgbTexture | None], *, seed: int
    ) -> Shot:
        """One view in several paints, the truth by the path tracer; None is the plain paint.

        What the paint throws on itself and its surroundings is the plain paint's in all truths.
        """
        albedos = [self._paint.apply(paint) for paint in paints]
        shading = TracedShading(self._kept, TRUTH_SAMPLES, seed=TRUTH_SEED)
        truth = LookupRenderer(self._kept, shading)
        renders, truths = (
            LinearImages(
                torch.cat([renderer.render(a, [view], weather, seed=seed) for a in albedos])
            )
            for renderer in (self._loop, truth)
        )
        return self._cut_out(view, weather, renders, truths, seed=seed)

    @torch.no_grad()
    def photograph(self, view: View, weather: Weather, photograph: LinearTexture) -> Shot:
        """One view in the plain paint, the truth a linear photograph (3, height, width)."""
        render = self._loop.render(self._paint.apply(), [view], weather, seed=0)
        return self._cut_out(view, weather, render, LinearImages(photograph[None]), seed=0)

    def _cut_out(
        self,
        view: View,
        weather: Weather,
        renders: LinearImages,
        truths: LinearImages,
        *,
        seed: int,
    ) -> Shot:
        """The part of all pictures that the vehicle touches."""
        mask = torch.zeros(view.height * view.width)
        mask[self._kept.background(view, weather).pixels] = 1
        mask = mask.reshape(1, view.height, view.width)
        rows, columns = (mask[0].any(dim=axis).nonzero()[:, 0] for axis in (1, 0))
        part = (
            ...,
            slice(int(rows[0]), int(rows[-1]) + 1),
            slice(int(columns[0]), int(columns[-1]) + 1),
        )
        (plain,) = self._loop.reference([view], weather, seed=seed)
        traced, drawn, renders, truths = (
            LinearImages(picture[part].clone())
            for picture in (plain.traced, plain.drawn, renders, truths)
        )
        return Shot(PlainPictures(traced, drawn), renders, truths, mask[part].clone())


@dataclass(frozen=True)
class EfrReport:
    """The result of a training; errors are mean absolute differences of display values."""

    error_before: float
    error_after: float
    remaining: float
    """The error after as a share of that before."""
    worse: float
    """Share of the test pictures that are worse after."""
    per_epoch: list[float]
    """The error after each epoch."""
    scenes: list[str]
    carla: str | None
    """Folder of the frames, where it was trained on them."""
    backend: str
    samples: int
    training_views: int
    test_views: int
    versions: dict[str, str]


def train_efr(request: EfrRequest, console: Console, *, resume: bool = False) -> EfrReport:
    """Train an EFR on renders of scenes or on CARLA's frames.

    Raises:
        RunError: the folder holds a training already (without ``resume``) or another one.
    """
    out, carla, views, seed = request.out, request.carla, request.views, request.seed
    folder = out.with_suffix("")
    loop = TrainingLoop(folder, seed, resume, console)
    inputs = _inputs([*request.scenes, *([request.carla_scene] if carla else [])], carla)
    claim = partial(RunFolder(folder, "train-efr").claim, resume=resume)
    asked = {name: value for name, value in asdict(request).items() if name != "out"}
    parallel.by_first(lambda: claim(asked, hashes(inputs)))
    backend, samples = request.backend, request.samples
    if carla is not None:
        shots = _frames(carla, request.carla_scene, backend, samples, console)
        split = max(1, round(TEST_SHARE * len(shots)))
        training, test = shots[split:], shots[:split]
    else:
        scenes = [load_scene(scene) for scene in request.scenes]
        draw = partial(_renders, scenes, backend, samples, console)
        training, test = draw(views, seed), draw(max(1, round(TEST_SHARE * views)), seed, test=True)
    outcome = train(loop, training, test, epochs=request.epochs)
    report = _report(request, outcome, training_views=len(training), test_views=len(test))
    if parallel.rank() == 0:
        outcome.network.save(out)
        write_json(out.with_suffix(".json"), as_json(report))
    return report


def _inputs(scenes: Sequence[Path], carla: Path | None) -> list[Path]:
    """Every file that the pairs are made from."""
    files = [file for scene in scenes for file in build.scene_files(load_scene(scene), scene)]
    return [*files, *(sorted(carla.glob("*.npz")) if carla else [])]


def _report(
    request: EfrRequest, outcome: Outcome, *, training_views: int, test_views: int
) -> EfrReport:
    before, after = float(outcome.before.mean()), float(outcome.best.mean())
    return EfrReport(
        error_before=round(before, 5),
        error_after=round(after, 5),
        remaining=round(after / before, 4),
        worse=round(float((outcome.best > outcome.before).float().mean()), 4),
        per_epoch=[round(float(errors.mean()), 5) for errors in outcome.after],
        scenes=[str(scene) for scene in request.scenes],
        carla=str(request.carla) if request.carla else None,
        backend=request.backend,
        samples=request.samples,
        training_views=training_views,
        test_views=test_views,
        versions=versions(),
    )


def _renders(
    scenes: Sequence[Scene],
    backend: str,
    samples: int,
    console: Console,
    views: int,
    seed: int,
    *,
    test: bool = False,
) -> list[Shot]:
    """Views of all scenes in turn, spread over their ranges of views and weathers."""
    seed += HELD_OUT_SEED if test else 0
    studios = [Studio(scene, backend, samples) for scene in scenes]
    weathers = [draw_weathers(scene, WEATHERS, seed=seed) for scene in scenes]
    every = [draw_views(scene, views, seed=seed) for scene in scenes]
    rng, shots, own = np.random.default_rng(seed), [], parallel.share(range(views))
    with bar(console) as shown:
        for k in shown.track(range(views), description="test views" if test else "views"):
            paints = [None, *(_texture(rng, natural=test) for _ in range(TEXTURES - 1))]
            if k in own:
                which = k % len(scenes)
                weather = weathers[which][k // len(scenes) % WEATHERS]
                shots.append(studios[which].shoot(every[which][k], weather, paints, seed=seed + k))
    return parallel.gathered(shots)


def _texture(rng: np.random.Generator, *, natural: bool) -> SrgbTexture:
    """For the training one color or random blocks; for the test patterns as prompts name them."""
    if natural:
        return SrgbTexture(torch.from_numpy(textures.sample(rng).picture).permute(2, 0, 1).float())
    chance = torch.Generator().manual_seed(int(rng.integers(2**31)))
    blocks = int(np.exp(rng.uniform(0, np.log(48))))
    return controls.random_blocks(256, chance, blocks=blocks)


def _frames(
    folder: Path, scene_file: Path, backend: str, samples: int, console: Console
) -> list[Shot]:
    """CARLA's photographs, and renders of the same poses."""
    sources = sorted(folder.glob("*.npz"))
    if len(sources) < 2:
        raise RunError(
            f"{folder}: {len(sources)} .npz frames; give two or more, for training and test"
        )
    scene = load_scene(scene_file)
    studio, shots = Studio(scene, backend, samples), []
    with bar(console) as shown:
        for source in shown.track(parallel.share(sources), description="frames"):
            frame = read_carla_frame(source)
            fit = fit_frame(studio.vehicle, frame, fov=90.0, name=source.stem)
            photograph = srgb_to_linear(SrgbTexture(torch.from_numpy(frame.image).permute(2, 0, 1)))
            shots.append(studio.photograph(fit.view, scene.weather(), photograph))
    return parallel.gathered(shots)
