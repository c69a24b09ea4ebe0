"""What each backend of the loop gets right, and what a step costs.

    python benchmarks/backends.py scenes/sedan_clear.yaml scenes/sedan_fog.yaml \
      --efr raster=out/efr/raster.safetensors --efr mitsuba=out/efr/mitsuba.safetensors

writes the tables of docs/backends.md, which says what the columns mean.  Held-out views of each
scene show a pattern that no EFR was trained on; the reference is the path tracer in two independent
halves.  Both kinds of seconds are of a render with its backward pass, the fastest of nine.
"""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from tables import markdown, put
from torch import Tensor

from cnca import build
from cnca.attack.objectives import paper
from cnca.core.color import linear_to_srgb
from cnca.core.pictures import SrgbPicture, as_pictures, side_by_side, write_png
from cnca.gen import textures
from cnca.jobs.accuracy.fidelity import (
    Pixels,
    gradient_agreement,
    root,
    squared_error,
    vehicle_pixels,
)
from cnca.judge.held_out import HELD_OUT_SEED
from cnca.judge.scores import detection_score
from cnca.mi_bridge.backgrounds import KeptBackgrounds
from cnca.mi_bridge.lookups import LookupRenderer
from cnca.scene.cameras import View
from cnca.scene.load_scene import load_scene
from cnca.scene.protocols import Detector, LoopRenderer, Residual
from cnca.scene.variation import draw_views, draw_weathers
from cnca.scene.weather import Weather

VIEWS, REPEATS = 4, 9
REFERENCE_SAMPLES, REFERENCE_SEED = 512, 1 << 20
"""Rays per pixel of each half of the reference."""


@dataclass(frozen=True)
class Row:
    """A line of the table."""

    name: str
    backend: str
    samples: int = 16
    efr: str | None = None
    present: bool = False
    """Whether the cache was shaded in the texture that is shown, not in the plain paint."""


ROWS = (
    Row("raster", "raster"),
    Row("raster + EFR", "raster", efr="raster"),
    Row("cached", "cached"),
    Row("cached, refreshed", "cached:1", present=True),
    Row("mitsuba, 4 spp", "mitsuba", 4),
    Row("mitsuba, 4 spp + EFR", "mitsuba", 4, efr="mitsuba"),
    Row("mitsuba, 16 spp", "mitsuba", 16),
    Row("mitsuba, 64 spp", "mitsuba", 64),
)
SHOWN = ("raster", "raster + EFR", "mitsuba, 4 spp", "mitsuba, 4 spp + EFR")
"""Rows of the picture, beside the reference."""
MARGIN, ENLARGED = 6, 3
"""Pixels around the vehicle, and how often each is repeated."""
HEADINGS = (
    "backend",
    "error",
    "gradient",
    "score",
    "CPU s/view",
    "wall s/view",
    "first, CPU s/view",
    "MB/view",
)


class Bench:
    """One scene with its reference."""

    def __init__(self, path: Path, detector: Detector) -> None:
        self.scene, self.detector = load_scene(path), detector
        self.vehicle = build.build_vehicle(self.scene)
        self.paint = build.build_paint(self.scene, self.vehicle)
        rng = np.random.default_rng(HELD_OUT_SEED)
        pattern = torch.from_numpy(textures.sample(rng).picture).permute(2, 0, 1).float()
        self.albedo = self.paint.apply(pattern)
        self.views = draw_views(self.scene, VIEWS, seed=HELD_OUT_SEED)
        self.weather: Weather = draw_weathers(self.scene, 1, seed=HELD_OUT_SEED)[0]
        self.label = build.vehicle_label(detector.class_names)
        kept = self.loop("mitsuba", 64)
        assert isinstance(kept, KeptBackgrounds)
        self.boxes = kept.vehicle_boxes(self.views)
        self.masks = kept.renderer.vehicle_mask(self.views) == 1
        first, second = ([self._true(kept, v, half)[0] for v in self.views] for half in range(2))
        self.halves = self.pixels(torch.cat(first)), self.pixels(torch.cat(second))
        self.truth = (torch.cat(first) + torch.cat(second)) / 2
        self.adjoint = self._adjoint(self.truth)
        self.score = self.scores(self.truth)
        self.gradients = self._gradient(kept, 0), self._gradient(kept, 1)

    def loop(self, backend: str, samples: int) -> LoopRenderer:
        """The scene's renderer of that name."""
        parts = self.scene, self.vehicle, self.paint
        return build.build_loop_renderer(*parts, backend=backend, samples=samples)

    def pixels(self, images: Tensor) -> Pixels:
        """Those of all views that show nothing but the vehicle."""
        pairs = zip(images.detach(), self.masks, strict=True)
        return np.concatenate([vehicle_pixels(image[None], mask) for image, mask in pairs])

    def scores(self, images: Tensor) -> Tensor:
        """The detector's confidence in the vehicle of each view."""
        found = self.detector.detect(linear_to_srgb(images.detach()), score_threshold=0.01)
        pairs = zip(found, self.boxes, strict=True)
        return torch.tensor([detection_score(d, box, self.label) for d, box in pairs])

    def _true(
        self, kept: KeptBackgrounds, view: View, half: int, adjoint: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """One view's reference picture and, for an adjoint picture, the texture's gradient."""
        background, albedo = kept.background(view, self.weather), self.albedo.clone()
        vehicle = kept.renderer.render_pixels(
            albedo.requires_grad_(adjoint is not None),
            [view],
            self.weather,
            background.pixels,
            seed=REFERENCE_SEED + half,
            samples=REFERENCE_SAMPLES,
        )
        pixels = torch.from_numpy(background.pixels)
        image = background.image.permute(1, 2, 0).reshape(-1, 3).index_copy(0, pixels, vehicle)
        image = image.reshape(view.height, view.width, 3).permute(2, 0, 1)[None]
        if adjoint is None:
            return image, torch.zeros(())
        (image[0] * adjoint).sum().backward()
        assert albedo.grad is not None
        return image.detach(), albedo.grad

    def _gradient(self, kept: KeptBackgrounds, half: int) -> Tensor:
        """The texture's gradient, all views together."""
        pairs = zip(self.views, self.adjoint, strict=True)
        each = [self._true(kept, view, half, adjoint)[1] for view, adjoint in pairs]
        return torch.stack(each).sum(dim=0)

    def _adjoint(self, images: Tensor) -> Tensor:
        """What the attack's loss sends back into the reference pictures."""
        images = images.clone().requires_grad_()
        candidates = self.detector.candidates(linear_to_srgb(images))
        paper.Loss(full_overlap=0.5)(candidates, self.boxes, self.label).mean().backward()
        assert images.grad is not None
        return images.grad


@dataclass(frozen=True)
class Measured:
    """One row's pictures, gradient and costs."""

    images: Tensor
    gradient: Tensor
    seconds: list[tuple[float, float]]
    """Processor and wall seconds a view, of the first render and those after it."""
    megabytes: float | None
    """Kept for each view, by backends that keep their shading."""


def measure(bench: Bench, row: Row, residual: Residual | None) -> Measured:
    """Render all views a few times, with backward passes."""
    loop, seconds = bench.loop(row.backend, row.samples), []
    if row.present:  # shaded once in the plain paint, then in what comes next
        with torch.no_grad():
            loop.render(bench.albedo, bench.views, bench.weather, seed=0)
    for repeat in range(1 + REPEATS):
        if repeat == 2 and isinstance(loop, LookupRenderer):
            loop.refresh = None
        albedo = bench.albedo.clone().requires_grad_()
        cpu, wall = time.process_time(), time.perf_counter()
        images = loop.render(albedo, bench.views, bench.weather, seed=repeat)
        if residual is not None:
            images = residual(images, loop.reference(bench.views, bench.weather, seed=repeat))
        (images * bench.adjoint).sum().backward()
        spent = time.process_time() - cpu, time.perf_counter() - wall
        seconds.append((spent[0] / VIEWS, spent[1] / VIEWS))
    assert albedo.grad is not None
    size = loop.megabytes / VIEWS if isinstance(loop, LookupRenderer) else None
    return Measured(images.detach(), albedo.grad, seconds, size)


def cells(bench: Bench, row: Row, found: Measured) -> list[str]:
    """One line of the table."""
    error = root(squared_error(bench.pixels(found.images), bench.halves)[0])
    cosine, _ = gradient_agreement(found.gradient, bench.gradients)
    change = float((bench.scores(found.images) - bench.score).abs().mean())
    cpu, wall = (min(each) for each in zip(*found.seconds[1:], strict=True))
    return [
        row.name,
        f"{error:.1%}",
        f"{cosine:.3f}",
        f"{change:.3f}",
        f"{cpu:.4f}",
        f"{wall:.4f}",
        f"{found.seconds[0][0]:.1f}",
        f"{found.megabytes:.1f}" if found.megabytes is not None else "–",
    ]


def stale(bench: Bench, old: Measured, new: Measured) -> str:
    """What a cache lacks that was shaded in the plain paint; both have the same random numbers."""
    a, b = bench.pixels(old.images), bench.pixels(new.images)
    error = root(squared_error(a, (b, b))[0])
    cosine = torch.cosine_similarity(old.gradient.flatten(), new.gradient.flatten(), dim=0)
    mask = bench.paint.mask.expand_as(bench.albedo) > 0
    change = (bench.albedo - bench.paint.apply())[mask].square().mean().sqrt()
    return (
        f"Shaded in the plain paint, from which the pattern's albedo differs by {change:.2f} "
        f"(root mean square), the cached picture is {error:.2%} off the one shaded anew with the "
        f"same random numbers, its gradient has a cosine of {float(cosine):.4f} to that one's."
    )


def gallery(bench: Bench, found: dict[str, Measured]) -> list[SrgbPicture]:
    """The first view as some rows draw it, and as it is; around the vehicle, enlarged."""
    left, top, right, bottom = (round(edge) for edge in bench.boxes[0].tolist())
    part = (
        slice(max(top - MARGIN, 0), bottom + MARGIN),
        slice(max(left - MARGIN, 0), right + MARGIN),
    )
    images = [found[name].images[:1] for name in SHOWN if name in found] + [bench.truth[:1]]
    pictures = as_pictures(linear_to_srgb(torch.cat(images)))
    return [p[part].repeat(ENLARGED, axis=0).repeat(ENLARGED, axis=1) for p in pictures]


def section(
    path: Path, detector: Detector, residuals: dict[str, Residual | None]
) -> tuple[list[str], list[SrgbPicture]]:
    """The table of one scene, and what it looks like."""
    bench = Bench(path, detector)
    width, height = bench.scene.image.width, bench.scene.image.height
    halves = gradient_agreement(bench.gradients[0], (bench.gradients[1], bench.gradients[1]))[0]
    lines, found = [], {}
    for row, residual in corrected(residuals):
        found[row.name] = measure(bench, row, residual)
        lines.append(cells(bench, row, found[row.name]))
        print(*lines[-1], sep=" | ", flush=True)
    text = [
        f"`{path}`, {VIEWS} views of {width}×{height} pixels; the reference's halves of "
        f"{REFERENCE_SAMPLES} rays per pixel have gradients of cosine {halves:.3f}.",
        "",
        *markdown(HEADINGS, lines),
        "",
        stale(bench, found["cached"], found["cached, refreshed"]),
    ]
    return text, gallery(bench, found)


def read_residuals(specs: Sequence[str]) -> dict[str, Residual | None]:
    """The networks of ``BACKEND=PATH``, by backend."""
    parts = (spec.partition("=") for spec in specs)
    return {backend: build.build_residual(Path(path)) for backend, _, path in parts}


def corrected(residuals: dict[str, Residual | None]) -> list[tuple[Row, Residual | None]]:
    """The rows that can be run, with what corrects them."""
    rows = [row for row in ROWS if row.efr is None or row.efr in residuals]
    return [(row, residuals[row.efr] if row.efr else None) for row in rows]


def main() -> None:
    """Measure all rows of all scenes and put them into the document."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", type=Path, nargs="+")
    parser.add_argument("--efr", action="append", default=[], help="BACKEND=PATH; repeatable")
    parser.add_argument("--detector", default="builtin")
    parser.add_argument("--document", type=Path, default=Path("docs/backends.md"))
    parser.add_argument("--picture", type=Path, default=Path("docs/images/backends.png"))
    options = parser.parse_args()
    residuals = read_residuals(options.efr)
    detector = build.build_detector(options.detector)
    lines, pictures = ["```sh", f"python {shlex.join(sys.argv)}", "```"], []
    for path in options.scenes:
        table, shown = section(path, detector, residuals)
        lines += ["", *table]
        pictures += shown
    put(options.document, "backends", lines)
    run = {row.name for row, _ in corrected(residuals)}
    names = [name for name in SHOWN if name in run] + ["reference"]
    sheet = side_by_side(pictures, len(options.scenes) * names, columns=len(names))
    write_png(options.picture, sheet)


if __name__ == "__main__":
    main()
