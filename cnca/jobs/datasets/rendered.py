"""``cnca render-dataset``: the grid of a scene as labelled pictures.

Picture number k shows setting number k of :class:`cnca.scene.grid.Grid`, the vehicle with the noise
of seed k, so it is the same however the work is split, interrupted or continued.  Some colors of
one pose and weather share what lies around the vehicle, seen beside its plain paint.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from rich.console import Console
from torch import Tensor

from cnca import build
from cnca.core import parallel
from cnca.core.color import linear_to_srgb
from cnca.core.errors import RunError
from cnca.core.manifest import hashes
from cnca.core.pictures import SrgbPicture, as_pictures
from cnca.core.progress import bar
from cnca.core.run_folder import RunFolder
from cnca.core.types import LinearImages, LinearTexture, SrgbTexture
from cnca.effects.plan import Demand
from cnca.jobs.datasets.coco import Mask
from cnca.jobs.datasets.layout import DataSet
from cnca.jobs.datasets.request import DatasetRequest
from cnca.mi_bridge.backgrounds import BACKGROUND_SEED
from cnca.scene.cameras import View
from cnca.scene.grid import COLOURS, SHARING, Grid, Setting
from cnca.scene.layers import Sighting
from cnca.scene.load_scene import load_scene
from cnca.scene.protocols import SightingRenderer
from cnca.scene.schema import Scene
from cnca.scene.weather import Weather


def parse_shard(text: str) -> tuple[int, int]:
    """``i/n`` with 1 ≤ i ≤ n; raises RunError for anything else."""
    i, slash, n = text.partition("/")
    if slash and i.isdecimal() and n.isdecimal() and 1 <= int(i) <= int(n):
        return int(i), int(n)
    raise RunError(f"--shard {text}: give I/N such as 2/4, the second of four parts")


def render_dataset(request: DatasetRequest, console: Console) -> Rendered:
    """Render what is missing of the first ``request.images`` pictures; see :mod:`.layout`.

    Raises:
        RunError: the folder holds another data set, or a number is out of range.
    """
    scene = load_scene(request.scene)
    grid, (part, parts) = Grid(scene), parse_shard(request.shard)
    count = len(grid) if request.images is None else request.images
    if not 1 <= count <= len(grid):
        raise RunError(f"--images {count}: the scene's grid has 1 to {len(grid)}")
    samples = request.samples or scene.image.samples
    data = DataSet(request.out, scene.vehicle.label)
    content = {"scene": scene.model_dump(mode="json"), "samples": samples}
    inputs = hashes(build.scene_files(scene, request.scene))
    # The same command goes on without a word: its parts run side by side, in any order.
    folder = RunFolder(request.out, "render-dataset")
    parallel.by_first(lambda: folder.claim(content, inputs, resume=True))
    part, parts = part - 1 + parts * parallel.rank(), parts * parallel.count()
    mine = [k for k in range(count) if k // SHARING % parts == part]
    missing = [k for k in mine if not data.has(k)]
    stage = _Stage(scene, samples)
    with bar(console) as shown:
        for index in shown.track(missing, description="pictures"):
            occluded, others = stage.surroundings(grid[index].view)
            shot = stage.shoot(grid[index], seed=index)
            data.add(index, *shot, occluded=occluded, others=others)
        per_second = shown.tasks[0].speed
    rendered = sum(parallel.gathered([len(missing)]))
    parallel.by_first(lambda: data.finish(tar=request.tar))
    return Rendered(rendered, len(data.indices()), per_second)


@dataclass(frozen=True)
class Rendered:
    """What one call has done for a data set."""

    rendered: int
    done: int
    """Pictures that are there now."""
    per_second: float | None
    """This process's last rate; None where fewer than two were rendered."""


@dataclass(frozen=True)
class RenderedRecord(Setting):
    """What the data set says of one picture."""

    srgb: tuple[float, float, float]
    seed: int
    caption: str


class _Stage:
    """The scene's vehicle, ready for its settings."""

    def __init__(self, scene: Scene, samples: int) -> None:
        vehicle = build.build_vehicle(scene)
        demand = Demand(forced={"gradient": "off"})
        self._renderer = build.build_renderer(scene, vehicle, samples=samples, demand=demand)
        self._paint = build.build_paint(scene, vehicle)
        self._albedo = lru_cache(self._make_albedo)
        # One place for the last surroundings: no pose comes back once it is left.
        self._around = lru_cache(1)(self._render_around)
        self.surroundings = lru_cache(1)(self._look_around)

    @torch.no_grad()
    def shoot(self, setting: Setting, *, seed: int) -> tuple[SrgbPicture, Mask, RenderedRecord]:
        """Picture, mask and record."""
        view, weather = setting.view, setting.weather
        around, mask = self._around(view, weather)
        on_vehicle = np.flatnonzero(mask)
        vehicle = self._renderer.render_pixels(
            self._albedo(setting.colour), [view], weather, on_vehicle, seed=seed
        )
        image = around.index_copy(0, torch.from_numpy(on_vehicle), vehicle)
        image = LinearImages(image.reshape(1, *mask.shape, 3).permute(0, 3, 1, 2))
        fog = setting.weather.fog
        sight = f", {fog.visibility:.0f} m" if fog else ""
        record = RenderedRecord(
            **vars(setting),
            srgb=COLOURS[setting.colour],
            seed=seed,
            caption=f"{setting.colour}, sun {setting.weather.sun_altitude:.0f}{sight}",
        )
        return as_pictures(linear_to_srgb(image))[0], mask, record

    def _look_around(self, view: View) -> tuple[float, list[Sighting]]:
        """Share of the vehicle that the world hides, and what else of it the view shows."""
        renderer = self._renderer
        if not isinstance(renderer, SightingRenderer):
            return 0.0, []
        return 1 - renderer.visible_shares([view])[0], renderer.sightings([view])[0]

    def _make_albedo(self, colour: str) -> LinearTexture:
        return self._paint.apply(SrgbTexture(torch.tensor(COLOURS[colour]).reshape(3, 1, 1)))

    def _render_around(self, view: View, weather: Weather) -> tuple[Tensor, Mask]:
        """All pixels (height · width, 3), black where the vehicle's mask is not 0, and the mask."""
        mask = self._renderer.vehicle_mask([view])[0]
        image, beside = torch.zeros(mask.size, 3), np.flatnonzero(mask == 0)
        if len(beside):
            image[torch.from_numpy(beside)] = self._renderer.render_pixels(
                self._paint.apply(), [view], weather, beside, seed=BACKGROUND_SEED
            )
        return image, mask
