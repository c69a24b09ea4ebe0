"""The results of an evaluation as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cnca.core.files import replacing
from cnca.detect.classes import counted
from cnca.judge import protocol_names
from cnca.judge.records import Estimate, Evidence, FrameFit, Scores
from cnca.judge.rows import NORMAL
from cnca.judge.verdict import LEAST_VIEWS, MEASURES, TOO_FEW, TOTAL

LEAST_AP = 0.05
"""Below it a detector counts as one that does not find the vehicle."""


def cell(number: Estimate, *, digits: int = 3) -> str:
    """``value [low, high]``, or a dash where the value is undefined."""
    if number.value is None:
        return "–"
    if number.low is None or number.high is None:
        return f"{number.value:.{digits}f}"
    return f"{number.value:.{digits}f} [{number.low:.{digits}f}, {number.high:.{digits}f}]"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def write_markdown(path: Path, results: Evidence, pictures: Sequence[str]) -> None:
    """Write ``results.md``: the tables, the comparisons and the pictures beside it."""
    parts = [
        "# Evaluation\n",
        f"{results.views} views; scenes: {', '.join(results.scenes)}. In brackets: "
        f"{results.interval}. {_meaning(results)}\n",
        *(f"**{warning}**\n" for warning in blind(results)),
    ]
    for column, title in column_titles(results.label).items():
        parts += [
            f"## AP@0.5 {title} (Pascal VOC 2010–2012, area)\n",
            by_detector(results.all, column, results),
        ]
    parts += [
        "## All measures, mean over the detectors\n",
        by_measure(results),
        "## By the measures of others, mean over the detectors\n",
        "What each is, its rule and its source: docs/evaluation.md.\n",
        by_protocols(results),
    ]
    if results.comparisons:
        parts += ["## Against the controls\n", _comparisons(results)]
    for scene, measured in (results.by_scene or {}).items():
        title = f"## {scene}: AP@0.5 of the {results.label}\n"
        parts += [title, by_detector(measured, results.label, results)]
    if results.frames is not None:
        parts += ["## Frames\n", _frames(results.frames)]
    parts += ["## Pictures\n", *(f"![{name}]({name})\n" for name in pictures)]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(parts), encoding="utf-8")


def column_titles(label: str) -> dict[str, str]:
    """Column of the results → what its AP is of."""
    return {
        column: f"of the {label}" if column == label else f"as any vehicle ({', '.join(classes)})"
        for column, classes in counted(label).items()
    }


def headlines(results: Evidence) -> list[str]:
    """For each candidate one sentence: which controls it beats in total, and which it does not."""
    sentences = []
    for candidate in results.candidates:
        compared = [
            comparison
            for comparison in results.comparisons
            if comparison.candidate == candidate and comparison.detector == TOTAL
        ]
        if any(comparison.verdict == TOO_FEW for comparison in compared):
            sentences.append(f"{candidate}: {TOO_FEW} to compare; take {LEAST_VIEWS} or more.")
            continue
        beaten = [c.control for c in compared if c.verdict == "lower"]
        others = [c.control for c in compared if c.verdict != "lower"]
        sentence = f"{candidate}: AP@0.5 lower than {_listed(beaten)}"
        if others:
            sentence += f"; not lower than {_listed(others)}"
        sentences.append(sentence + ".")
    return sentences


def blind(results: Evidence) -> list[str]:
    """A warning for each detector that finds next to nothing in plain paint, with likely causes."""
    plain = results.all.get(NORMAL, {})
    warnings = []
    for detector in results.detectors:
        found = plain[detector][results.label]["AP_voc"].value if detector in plain else None
        if found is not None and found < LEAST_AP:
            warnings.append(
                f"warning: {detector} finds no {results.label} in plain paint (AP@0.5 {found:.2f}):"
                " its numbers say nothing about textures. Likely: its classes are numbered"
                " otherwise, its boxes are in another order or unit, its input wants other colors"
                " (classes, boxes, units, channels, white in the .yaml beside an .onnx); or the"
                " vehicle is too small or unlike what it was trained on."
            )
    return warnings


def _frames(fits: Sequence[FrameFit]) -> str:
    """How well the vehicle's mesh meets each frame."""
    rows = []
    for fit in fits:
        outline = fit.outline_pixels
        numbers = (fit.lift, outline and outline.median, outline and outline.percentile_90)
        cells = ["–" if number is None else str(number) for number in numbers]
        rows.append([fit.frame, *cells, "yes" if fit.used else "no"])
    note = "Distances between the drawn and the photographed outline, in pixels.\n\n"
    return note + table(["frame", "lift (m)", "median", "90th percentile", "used"], rows)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "none of its controls"


def _meaning(results: Evidence) -> str:
    return (
        "The score of a view is the highest confidence of a detection that overlaps the vehicle's "
        "box by at least one half. The attack success rate is the share of the views with a "
        "vehicle found in normal paint (confidence 0.25) in which it is no longer found. "
        f"The total is the mean over {len(results.detectors)} detector(s)."
    )


def by_detector(measured: Scores, column: str, results: Evidence) -> str:
    """AP of every texture before every detector, ``measured`` as ``results.all`` is.

    ``column`` is the vehicle's class, or ``vehicle`` for any vehicle.
    """
    detectors = with_total(results.detectors)
    rows = [
        [row, *(cell(measured[row][detector][column]["AP_voc"]) for detector in detectors)]
        for row in results.rows
    ]
    return table(["texture", *detectors], rows)


def by_measure(results: Evidence) -> str:
    """All measures of every texture, mean over the detectors."""
    rows = []
    for row in results.rows:
        total = results.all[row][TOTAL][results.label]
        rows.append([row, *(cell(total[name]) if name in total else "–" for name in MEASURES)])
    return table(["texture", *MEASURES.values()], rows)


def by_protocols(results: Evidence) -> str:
    """The measures that others use, one to a row, of every texture; mean over the detectors."""
    totals = [results.all[row][TOTAL][results.label] for row in results.rows]
    rows = [
        [meaning, *(cell(total[name]) if name in total else "–" for total in totals)]
        for name, meaning in protocol_names.MEASURES.items()
    ]
    return table(["measure", *results.rows], rows)


def protocol_rows(results: Evidence, protocol: str) -> tuple[list[str], list[list[str]]]:
    """Head and rows of the table of one protocol: every texture before every detector."""
    names = protocol_names.PROTOCOLS[protocol]
    rows = []
    for row in results.rows:
        for detector in with_total(results.detectors):
            measures = results.all[row][detector][results.label]
            rows.append([row, detector, *(cell(measures[name], digits=2) for name in names)])
    return ["texture", "detector", *(protocol_names.MEASURES[name] for name in names)], rows


def _comparisons(results: Evidence) -> str:
    sentences = "\n".join(f"- {sentence}" for sentence in headlines(results))
    note = (
        "\nThe interval is that of the difference over the same views; where it holds 0, there is "
        "no difference to speak of.\n"
    )
    return sentences + "\n" + note + "\n" + comparison_table(results)


def comparison_table(results: Evidence) -> str:
    """The difference of each candidate from each of its controls, with its verdict."""
    rows = [
        [c.candidate, c.control, c.detector, cell(c), c.verdict]
        for c in results.comparisons
        if c.detector in with_total(results.detectors)
    ]
    head = [
        "texture",
        "control",
        "detector",
        f"difference of AP@0.5 (VOC, {results.label})",
        "verdict",
    ]
    return table(head, rows)


def with_total(detectors: Sequence[str]) -> list[str]:
    """The columns of a table: the detectors, and their mean where there are several."""
    return [*detectors, *([TOTAL] if len(detectors) > 1 else [])]
