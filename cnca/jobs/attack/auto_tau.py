"""The strongest bound τ that keeps a prompt score (the paper's future work, section 5)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rich.console import Console

from cnca.attack.variables import origin
from cnca.core.errors import RunError
from cnca.core.manifest import write_json
from cnca.core.records import as_json
from cnca.core.types import SrgbImages
from cnca.gen.scorer import PromptScorer
from cnca.jobs.attack.request import Request
from cnca.jobs.attack.run import build_generator
from cnca.jobs.attack.runs import Row, Table, row, with_tau, write_tables

GRID = (0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)
"""Bounds among which the search decides; the paper's table lies within."""


@dataclass(frozen=True)
class Choice:
    """The bound that was chosen, and every run of the search, weakest bound first."""

    tau: float
    rows: list[Row]


@dataclass(frozen=True)
class Search(Table):
    """The content of ``auto_tau.json``."""

    tau: float
    min_prompt_score: float
    score_unattacked: float
    """Prompt score with F_adv = 0."""


def auto_tau(request: Request, least: float, scorer: PromptScorer, console: Console) -> Choice:
    """Bisect :data:`GRID` for the bound up to which camouflages keep the prompt score ``least``.

    Assumes that the score falls as τ grows, and so about log₂ of the grid's length runs.  Of those
    that keep the score the strongest is chosen, by its detection score on held-out views: a larger
    τ is not always stronger.  These views thus help to choose one of at most four; quote a
    detection score from others (``cnca evaluate --seed``).  Writes ``auto_tau.json``, ``.md`` and
    ``.png`` into ``request.out``; each run has a folder in there.

    Raises:
        RunError: not even F_adv = 0, or the smallest τ, keeps the score.
    """
    prompt = request.settings.prompt
    unattacked = _score_of_prompt(request, scorer)
    if not unattacked >= least:
        raise RunError(
            f"--min-prompt-score {least:g}: with F_adv = 0 '{prompt}' scores {unattacked:.3f}; "
            "ask for less"
        )
    rows: dict[float, Row] = {}

    def keeps(tau: float) -> bool:
        rows[tau] = row(with_tau(request, tau), f"τ = {tau:g}", scorer, console)
        return rows[tau].naturalness.prompt_score >= least

    bisect(GRID, keeps)
    known = [rows[tau] for tau in sorted(rows)]
    write_tables(request.out, "auto_tau", "τ", known)
    tau = strongest(
        {tau: (line.naturalness.prompt_score, line.detection_score) for tau, line in rows.items()},
        least,
    )
    if tau is None:
        raise RunError(
            f"--min-prompt-score {least:g}: τ = {GRID[0]:g} already scores "
            f"{rows[GRID[0]].naturalness.prompt_score:.3f}; ask for less"
        )
    content = Search([line.numbers for line in known], tau, least, unattacked)
    write_json(request.out / "auto_tau.json", as_json(content))
    return Choice(tau, known)


def bisect(grid: tuple[float, ...], keeps: Callable[[float], bool]) -> None:
    """Ask ``keeps`` where it turns from true to false, assuming that it does so once."""
    low, high = -1, len(grid)  # the last known to keep, the first known not to
    while high - low > 1:
        middle = (low + high) // 2
        if keeps(grid[middle]):
            low = middle
        else:
            high = middle


def strongest(found: Mapping[float, tuple[float, float]], least: float) -> float | None:
    """The τ of the lowest detection score among those that keep the prompt score ``least``.

    ``found``: τ → prompt score, detection score.  None where none keeps it.
    """
    kept = {tau: detection for tau, (prompt, detection) in found.items() if prompt >= least}
    return min(kept, key=kept.__getitem__, default=None)


def _score_of_prompt(request: Request, scorer: PromptScorer) -> float:
    """Prompt score of the texture without an attack."""
    settings, generator = request.settings, build_generator(request)
    prompt = settings.prompt
    texture = origin(generator, settings).texture(generator, prompt, settings.seed)
    return scorer.score(SrgbImages(texture[None]), [prompt]).item()
