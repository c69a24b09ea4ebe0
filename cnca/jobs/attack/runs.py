"""Several attacks that differ in one thing: run what is missing, read what is there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import cv2
from pydantic import Field
from rich.console import Console

from cnca.core.errors import RunError
from cnca.core.files import replacing
from cnca.core.images import read_texture_srgb
from cnca.core.manifest import write_json
from cnca.core.pictures import side_by_side, write_png
from cnca.core.records import as_json, read_record
from cnca.core.run_folder import RunFolder
from cnca.gen.scorer import PromptScorer
from cnca.jobs.attack.budget import recorded
from cnca.jobs.attack.request import JOB, Request
from cnca.jobs.attack.run import claim, run
from cnca.judge.naturalness import Naturalness, of_run
from cnca.judge.summary import Summary
from cnca.scene.load_scene import load_scene

TILE = 224
"""Pixels per side of a texture in a table's picture."""


@dataclass(frozen=True, kw_only=True)
class RowNumbers(Naturalness):
    """The numbers of an attack of a table, with its naturalness.

    Detection scores and AP@0.5 are those on held-out views.
    """

    label: str
    folder: str
    """Below that of the table."""
    score: float
    score_shuffled: float
    score_prompt: float
    average_precision: Annotated[float, Field(alias="AP@0.5")]


@dataclass(frozen=True)
class Table:
    """Several attacks that differ in one thing."""

    rows: Sequence[RowNumbers]


@dataclass(frozen=True)
class Row:
    """One finished attack of a table."""

    label: str
    folder: Path
    summary: Summary
    naturalness: Naturalness

    @property
    def detection_score(self) -> float:
        """Mean on the held-out views."""
        return self.summary.score_after

    @property
    def numbers(self) -> RowNumbers:
        """As the table's file has them."""
        return RowNumbers(
            label=self.label,
            folder=self.folder.name,
            score=self.detection_score,
            score_shuffled=self.summary.score_shuffled,
            score_prompt=self.summary.score_prompt,
            average_precision=self.summary.average_precision["after"],
            **asdict(self.naturalness),
        )


def finished(request: Request, label: str, console: Console) -> Summary:
    """The attack in ``request.out``, run to its end unless it is there.

    Raises:
        RunError: the folder holds a run of another request, or of files that have changed since.
    """
    summary_file = request.out / "summary.json"
    if summary_file.exists() and RunFolder(request.out, JOB).occupied:
        claim(recorded(request), load_scene(request.scene), resume=True)
        return read_record(Summary, summary_file)
    console.print(f"{label}: {request.out}", soft_wrap=True)
    return run(replace(request, resume=True), console)


def row(request: Request, label: str, scorer: PromptScorer, console: Console) -> Row:
    """The attack in ``request.out``, as :func:`finished` has it; then measured."""
    summary = finished(request, label, console)
    return Row(label, request.out, summary, of_run(request.out, request.settings.prompt, scorer))


def under_tau(request: Request, tau: float) -> Request:
    """The same attack under another bound."""
    return replace(request, settings=replace(request.settings, tau=tau))


def bounded(request: Request, tau: str | None) -> Request:
    """The same attack under the bound that ``--tau`` says; raises RunError for anything else."""
    return request if tau is None else under_tau(request, read_tau(tau))


def with_tau(request: Request, tau: float) -> Request:
    """The same attack under another bound, in a folder of its own below ``request.out``."""
    return replace(under_tau(request, tau), out=request.out / tau_folder(tau))


def tau_folder(tau: float) -> str:
    """The name of that folder."""
    return f"tau_{tau:g}"


def with_prompt(request: Request, prompt: str) -> Request:
    """The same attack with another prompt, in a folder of its own below ``request.out``."""
    name = "_".join("".join(c if c.isalnum() else " " for c in prompt).split())
    if not name:
        raise RunError(f"prompt '{prompt}': has no letters; say what the paint is to look like")
    settings = replace(request.settings, prompt=prompt)
    return replace(request, settings=settings, out=request.out / name[:60])


def write_tables(out: Path, name: str, heading: str, rows: Sequence[Row]) -> None:
    """Write ``name`` as .json, .md and .png: numbers, table, and the row of textures."""
    write_json(out / f"{name}.json", as_json(Table([line.numbers for line in rows])))
    with replacing(out / f"{name}.md") as temporary:
        temporary.write_text(table(heading, rows), encoding="utf-8")
    textures, captions = [], []
    for line in rows:
        texture = read_texture_srgb(line.folder / "texture.png")
        small = cv2.resize(texture, (TILE, TILE), interpolation=cv2.INTER_AREA)
        textures.append((small * 255).round().astype("uint8"))
        captions.append(f"{line.label}: {line.detection_score:.2f}")
    write_png(out / f"{name}.png", side_by_side(textures, captions, columns=min(6, len(rows))))


COLUMNS = {
    "score": "detection score",
    "score_shuffled": "shuffled control",
    "AP@0.5": "AP@0.5",
    "prompt_score": "prompt score",
    "distance": "distance",
    "total_variation": "total variation",
    "real_colours": "real colors",
    "chroma": "chroma",
}
"""Number → heading; their meaning stands in :class:`cnca.judge.naturalness.Naturalness`."""


def table(heading: str, rows: Sequence[Row]) -> str:
    """The rows in Markdown."""
    lines = [f"| {heading} | " + " | ".join(COLUMNS.values()) + " |"]
    lines.append("|---" * (1 + len(COLUMNS)) + "|")
    for line in rows:
        numbers = as_json(line.numbers)
        lines.append(f"| {line.label} | " + " | ".join(f"{numbers[c]:.3f}" for c in COLUMNS) + " |")
    return "\n".join(lines) + "\n"


def tradeoff(
    request: Request, taus: Sequence[float], scorer: PromptScorer, console: Console
) -> list[Row]:
    """The paper's trade-off table: one attack per τ; ``tradeoff.md``, ``.json``, ``.png``."""
    rows = [row(with_tau(request, tau), f"τ = {tau:g}", scorer, console) for tau in taus]
    write_tables(request.out, "tradeoff", "τ", rows)
    return rows


def prompts(
    request: Request, wanted: Sequence[str], scorer: PromptScorer, console: Console
) -> list[Row]:
    """The paper's table of styles: one attack per prompt; ``prompts.md``, ``.json``, ``.png``."""
    rows = [row(with_prompt(request, prompt), prompt, scorer, console) for prompt in wanted]
    write_tables(request.out, "prompts", "prompt", rows)
    return rows


def read_taus(text: str) -> list[float]:
    """Comma-separated bounds, such as ``0.1,0.5,inf``; raises RunError for anything else."""
    taus = [read_tau(word) for word in text.split(",")]
    if len(set(taus)) < len(taus):
        raise RunError(f"--taus {text}: a bound is there twice; leave it out once")
    return taus


def read_tau(text: str) -> float:
    """A bound on F_adv, 0 or more; raises RunError for anything else."""
    try:
        tau = float(text)
    except ValueError:
        raise RunError(f"tau '{text}': give a number of 0 or more, or inf") from None
    if not tau >= 0:
        raise RunError(f"tau is {text.strip()}: give a number of 0 or more, or inf for no bound")
    return tau
