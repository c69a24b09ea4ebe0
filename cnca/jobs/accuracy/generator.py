"""What a shorter way back costs the gradient: the generator's price list."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from matplotlib import pyplot as plt
from rich.console import Console
from torch import Tensor

from cnca import build
from cnca.core.files import replacing
from cnca.core.manifest import hashes, versions, write_json
from cnca.core.progress import bar
from cnca.core.records import as_json
from cnca.core.run_folder import RunFolder
from cnca.gen.feature import initial
from cnca.jobs.accuracy.request import GradientRequest
from cnca.report import figures
from cnca.scene.controls import random_blocks
from cnca.scene.protocols import TextureGenerator

STEPS = 20
CHOICES = (1, 2, 5, 10, 15, 20)
"""Numbers of last steps that the gradient goes back through; the largest is the full gradient."""
SPREAD = 0.1
"""Standard deviation of the F_adv at which gradients are taken."""


@dataclass(frozen=True)
class GradientPrice:
    """The gradient through the last ``steps`` steps beside the full one; means of the probes."""

    steps: int
    seconds: float
    """Of one texture and its gradient, with gradient checkpointing."""
    seconds_kept: float
    """The same with all activations kept."""
    cosine: float
    length: float
    """Relative to the full gradient's."""


@dataclass(frozen=True)
class GeneratorReport:
    """The content of ``generator.json``."""

    prompt: str
    generator: str
    feature: str
    guidance: float
    probes: int
    seed: int
    versions: dict[str, str]
    prices: list[GradientPrice]


def generator_accuracy(request: GradientRequest, console: Console) -> GeneratorReport:
    """Compare gradients through the last K steps with that through all; return the report.

    Writes ``generator.json``, ``.md`` and ``.png`` into ``out``.  A probe is what a loss might ask
    of the texture: the mean of its texels, weighted at random in 16×16 blocks.  Seconds are
    those of one texture and its gradient, the fastest of the probes, with gradient checkpointing
    and without.
    """
    out = request.out
    gradients: dict[int, list[Tensor]] = {}
    seconds: dict[int, list[float]] = {}
    inputs = hashes(build.generator_files(request.generator))
    RunFolder(out, "accuracy-generator").renew(request, inputs)
    with bar(console) as progress:
        for last in progress.track(CHOICES, description="gradients"):
            seconds[last] = []
            for checkpointing in (True, False):
                shortened = build.build_generator(
                    request.generator,
                    feature=request.feature,
                    guidance=request.guidance,
                    gradient_steps=last,
                    gradient_checkpointing=checkpointing,
                )
                gradients[last], fastest = _gradients(
                    shortened, request.prompt, request.probes, request.seed
                )
                seconds[last].append(fastest)
    report = GeneratorReport(
        prompt=request.prompt,
        generator=str(request.generator or "shipped"),
        feature=request.feature,
        guidance=request.guidance,
        probes=request.probes,
        seed=request.seed,
        versions=versions(),
        prices=prices(gradients, seconds),
    )
    write_json(out / "generator.json", as_json(report))
    with replacing(out / "generator.md") as temporary:
        temporary.write_text(table(report.prices), encoding="utf-8")
    _write_picture(out / "generator.png", report)
    return report


def prices(
    gradients: dict[int, list[Tensor]], seconds: dict[int, list[float]]
) -> list[GradientPrice]:
    """One row for each K, fewest steps first.

    ``seconds`` are those with gradient checkpointing and without.
    """
    full = gradients[max(gradients)]
    rows = []
    for last, short in sorted(gradients.items()):
        pairs = [(s.flatten(), f.flatten()) for s, f in zip(short, full, strict=True)]
        cosines = [torch.cosine_similarity(s, f, dim=0) for s, f in pairs]
        lengths = [s.norm() / f.norm() for s, f in pairs]
        checkpointed, kept = seconds[last]
        rows.append(GradientPrice(last, checkpointed, kept, _mean(cosines), _mean(lengths)))
    return rows


def table(rows: Sequence[GradientPrice]) -> str:
    """The price list in Markdown."""
    lines = [
        "| last steps | seconds | with all activations kept | cosine | length |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {r.steps} | {r.seconds:.2f} | {r.seconds_kept:.2f} | {r.cosine:.3f} | {r.length:.3f} |"
        for r in rows
    ]
    return "\n".join(lines) + "\n"


def _gradients(
    generator: TextureGenerator, prompt: str, probes: int, seed: int
) -> tuple[list[Tensor], float]:
    """The gradient of every probe in double precision, and the seconds of the fastest."""
    text, chance = generator.encode(prompt), torch.Generator().manual_seed(seed)
    feature = initial(generator.feature_shape, spread=SPREAD, generator=chance).requires_grad_()
    gradients, seconds = [], []
    for _ in range(probes):
        started = time.perf_counter()
        texture = generator.generate(text, feature, torch.Generator().manual_seed(seed))
        weights = random_blocks(texture.shape[-1], chance, blocks=16) - 0.5
        (gradient,) = torch.autograd.grad((weights * texture).mean(), feature)
        seconds.append(time.perf_counter() - started)
        gradients.append(gradient.double())
    return gradients, min(seconds)


def _mean(values: Sequence[Tensor]) -> float:
    return torch.stack(list(values)).mean().item()


@figures.style()
def _write_picture(path: Path, report: GeneratorReport) -> None:
    rows = report.prices
    seconds = [row.seconds for row in rows]
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    axes.plot(seconds, [row.cosine for row in rows], "o-", label="cosine")
    axes.plot(seconds, [row.length for row in rows], "s--", label="relative length")
    for row in rows:
        where = row.seconds, row.cosine
        axes.annotate(f"K = {row.steps}", where, (4, -12), textcoords="offset points")
    axes.set(xlabel="seconds per texture and gradient", ylim=(None, 1.05))
    axes.legend()
    figures.save(figure, path)
