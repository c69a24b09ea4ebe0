"""The price list that ``cnca accuracy`` measures, as a table."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cnca.core.files import replacing
from cnca.jobs.accuracy.figure import seconds_of
from cnca.jobs.accuracy.records import AccuracyReport, MeasuredRung, ReferenceRecord

COLUMNS: dict[str, Callable[[MeasuredRung], str]] = {
    "rung": lambda r: r.name,
    "first call, CPU s": lambda r: f"{r.seconds.first.forward:.2f}",
    "forward, CPU s": lambda r: f"{r.seconds.steady.forward:.3f}",
    "backward, CPU s": lambda r: f"{r.seconds.steady.backward:.3f}",
    "error": lambda r: f"{r.error:.2%}",
    "bias": lambda r: _bias(r),
    "mean": lambda r: f"{r.mean:+.2%} ± {r.mean_error:.2%}",
    "noise": lambda r: f"{r.noise:.2%}",
    "ΔE2000": lambda r: f"{r.delta_e:.2f}",
    "gradient: cosine": lambda r: f"{r.gradient_cosine:.3f}",
    "length": lambda r: f"{r.gradient_length:.3f}",
    "score": lambda r: f"{r.score_change:.3f}",
}
"""Heading → cell of a rung; a bias that noise hides is said to be smaller than what it hides.

*mean* is the signed bias of the vehicle's mean radiance, with its standard error.
"""


def write_table(path: Path, report: AccuracyReport) -> None:
    """Markdown: the reference, then all rungs from fast to slow, the Pareto front in bold."""
    reference, view = report.reference, report.view
    lines = [
        f"`{report.scene}`, view {view.name}, {view.width}×{view.height} pixels.",
        describe_reference(reference),
        f"Not reached in the time given: {', '.join(report.not_reached) or 'nothing'}.",
        "",
        "| " + " | ".join(COLUMNS) + " |",
        "|" + "---|" * len(COLUMNS),
    ]
    for rung in sorted(report.rungs, key=seconds_of):
        cells = [cell(rung) for cell in COLUMNS.values()]
        if rung.name in report.front:
            cells[0] = f"**{cells[0]}**"
        lines.append("| " + " | ".join(cells) + " |")
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def describe_reference(reference: ReferenceRecord) -> str:
    """What it is, whether it has converged, and whether its halves agree."""
    what = "our own renderer"
    if reference.volpath:
        what = "`volpath` (the gradients' is our own renderer, for `volpath` has none)"
    agree = "agree" if reference.halves_agree else "DO NOT AGREE"
    return (
        f"Reference: {what}, {reference.samples} rays per pixel, standard error "
        f"{reference.standard_error:.2%}{'' if reference.converged else ' (not converged)'}; "
        f"its halves {agree}: their means are {reference.difference_of_means:+.2%} apart, "
        f"cosine of their gradients {reference.gradient_cosine:.3f}."
    )


def _bias(rung: MeasuredRung) -> str:
    sign = "" if rung.bias > rung.bias_hidden else "< "
    return f"{sign}{max(rung.bias, rung.bias_hidden):.2%}"
