"""What each backend of the loop gets right, and what a step costs.

    python benchmarks/backends.py scenes/sedan_clear.yaml scenes/sedan_fog.yaml \
      --efr raster=out/efr/raster.safetensors --efr mitsuba=out/efr/mitsuba.safetensors \
      --out docs/backends.md

Held-out views of each scene show a pattern that no EFR was trained on; the reference is the path
tracer in two independent halves.  ``error`` is the relative one of :mod:`cnca.fidelity` over the
vehicle's pixels; ``gradient`` the cosine between the texture gradients that the detector's loss at
the reference picture gets through the backend and through the path tracer; ``score`` the mean
absolute change of the detector's confidence in the vehicle; ``s/view`` a render with its backward
pass, the fastest of three; ``first`` the first one, in which a view's kept parts are made.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from cnca import build
from cnca.color import linear_to_srgb
from cnca.fidelity import Pixels, gradient_agreement, root, squared_error, vehicle_pixels
from cnca.files import replacing
from cnca.gen import textures
from cnca.loss import detection_loss
from cnca.mi_bridge.backgrounds import KeptBackgrounds
from cnca.mi_bridge.lookups import LookupRenderer
from cnca.protocols import Detector, LoopRenderer, Residual
from cnca.run import HELD_OUT_SEED
from cnca.scene.cameras import View
from cnca.scene.schema import load_scene
from cnca.scene.variation import draw_views, draw_weathers
from cnca.scene.weather import Weather
from cnca.scores import detection_score

VIEWS, REPEATS = 4, 3
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
INTRO = """# Backends of the loop

`cnca optimize --backend NAME` draws its pictures by one of these; the verdict is always the path
tracer's. All keep their backgrounds, drawn in the plain paint.

- `mitsuba`: the vehicle path-traced in each step, the default and the truth.
- `raster`: plain shading, as the paper's renderer does it. First hits once per view, then matt
  paint in sun and sky, without shadows, gloss, interreflection or fog.
- `cached`: path-traced shading of each view and weather, kept as a picture without the texture and
  a sparse matrix from texels to pixels. What is missing is the light that a new texture throws on
  itself; `cached:8` shades a view anew after it has served eight renders.
- `--efr PATH` corrects the pictures of any of them by the paper's network (`cnca train-efr`), which
  also sees X_ref, the vehicle in its plain paint, path-traced once per view.

Held-out views show a pattern that no EFR was trained on; the reference is the path tracer in two
independent halves. **error**: √mean((L − L_ref)² / (L_ref² + 0.01)) over the vehicle's pixels.
**gradient**: cosine between the texture gradients that the detector's loss at the reference picture
gets through the backend and through the path tracer. **score**: mean absolute change of the
detector's confidence in the vehicle. **s/view**: a render with its backward pass, the fastest of
three; **first**: the first one, in which a view's kept parts are made and kernels compiled.

```sh
{command}
```
"""
HEADINGS = ("backend", "error", "gradient", "score", "s/view", "first, s/view", "MB/view")


class Bench:
    """One scene with its reference."""

    def __init__(self, path: Path, detector: Detector):
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
        mean = (torch.cat(first) + torch.cat(second)) / 2
        self.adjoint = self._adjoint(mean)
        self.score = self.scores(mean)
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
        detection_loss(candidates, self.boxes, self.label, full_overlap=0.5)[0].backward()
        assert images.grad is not None
        return images.grad


def measure(bench: Bench, row: Row, residual: Residual | None) -> list[str]:
    """The cells of one row."""
    loop, seconds = bench.loop(row.backend, row.samples), []
    if row.present:  # shaded once in the plain paint, then in what comes next
        with torch.no_grad():
            loop.render(bench.albedo, bench.views, bench.weather, seed=0)
    for repeat in range(1 + REPEATS):
        if repeat == 2 and isinstance(loop, LookupRenderer):
            loop.refresh = None
        albedo, started = bench.albedo.clone().requires_grad_(), time.perf_counter()
        images = loop.render(albedo, bench.views, bench.weather, seed=repeat)
        if residual is not None:
            images = residual(images, loop.reference(bench.views, bench.weather))
        (images * bench.adjoint).sum().backward()
        seconds.append((time.perf_counter() - started) / len(bench.views))
    assert albedo.grad is not None
    error = root(squared_error(bench.pixels(images), bench.halves)[0])
    cosine, _ = gradient_agreement(albedo.grad, bench.gradients)
    change = float((bench.scores(images) - bench.score).abs().mean())
    size = loop.megabytes / len(bench.views) if isinstance(loop, LookupRenderer) else None
    return [
        row.name,
        f"{error:.1%}",
        f"{cosine:.3f}",
        f"{change:.3f}",
        f"{min(seconds[1:]):.4f}",
        f"{seconds[0]:.1f}",
        f"{size:.1f}" if size is not None else "–",
    ]


def main() -> None:
    """Measure all rows of all scenes and write them as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", type=Path, nargs="+")
    parser.add_argument("--efr", action="append", default=[], help="BACKEND=PATH; repeatable")
    parser.add_argument("--detector", default="builtin")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    residuals = {
        name: build.build_residual(Path(path))
        for name, _, path in (item.partition("=") for item in options.efr)
    }
    detector = build.build_detector(options.detector)
    lines = [line for path in options.scenes for line in _section(path, detector, residuals)]
    intro = INTRO.format(command="python " + " ".join(sys.argv))
    with replacing(options.out) as temporary:
        temporary.write_text("\n".join([intro, *lines]), encoding="utf-8")


def _section(
    path: Path, detector: Detector, residuals: dict[str, Residual | None]
) -> Sequence[str]:
    bench = Bench(path, detector)
    width, height = bench.scene.image.width, bench.scene.image.height
    halves = gradient_agreement(bench.gradients[0], (bench.gradients[1], bench.gradients[1]))[0]
    lines = [
        f"`{path}`, {VIEWS} views of {width}×{height} pixels; the reference's halves of "
        f"{REFERENCE_SAMPLES} rays per pixel have gradients of cosine {halves:.3f}.",
        "",
        "| " + " | ".join(HEADINGS) + " |",
        "|" + "---|" * len(HEADINGS),
    ]
    for row in ROWS:
        if row.efr is None or row.efr in residuals:
            cells = measure(bench, row, residuals[row.efr] if row.efr else None)
            print(*cells, sep=" | ", flush=True)
            lines.append("| " + " | ".join(cells) + " |")
    return [*lines, ""]


if __name__ == "__main__":
    main()
