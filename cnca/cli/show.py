"""What the terminal says: tables that fit its width, where results are, and what to try next."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from cnca.core import parallel
from cnca.report import MEANING

if TYPE_CHECKING:
    from cnca.jobs.accuracy.generator import GeneratorReport
    from cnca.jobs.accuracy.records import AccuracyReport
    from cnca.jobs.attack.auto_tau import Choice
    from cnca.jobs.attack.forecast import Forecast
    from cnca.jobs.attack.request import Request
    from cnca.jobs.attack.rerun import Rerun
    from cnca.jobs.datasets.carla import FrameProblem, FrameRecord
    from cnca.jobs.datasets.rendered import Rendered
    from cnca.jobs.efr_request import EfrRequest
    from cnca.jobs.hardening_request import HardeningRequest
    from cnca.jobs.render_request import RenderRequest
    from cnca.jobs.render_scene import RenderRecord
    from cnca.jobs.train_efr import EfrReport
    from cnca.jobs.vehicle.reorder_uv import Reordering
    from cnca.judge.records import Evidence, PhotoEvidence
    from cnca.judge.summary import Summary

LAYOUT = {
    "charts": "charts",
    "seam_length": "seams, m",
    "stretch": "L² stretch",
    "density_spread": "texels per metre, 95th over 5th percentile",
    "used": "share of the texture in use",
    "overlap": "share of it used twice",
}
"""Measures of a UV layout, of the painted faces that can be seen from outside."""
TURNED = 2
"""Columns that a table may have without being turned, however narrow the terminal."""
GRADIENT = {"seconds": ".2f", "cosine": ".3f", "length": ".3f"}
"""Measures of a shortened gradient, with their digits."""


def messages() -> Console:
    """Where progress and warnings go: stderr, of the first of several processes."""
    return Console(stderr=True, quiet=parallel.rank() > 0)


def line(text: object) -> None:
    """One line, however long, so that what it names can be copied."""
    Console().print(str(text), soft_wrap=True, markup=False, highlight=False)


def table(headings: list[str], rows: list[list[str]]) -> None:
    """Rows under their headings; what is wider than the terminal wraps between words.

    Where a column would be narrower than its longest word, names and numbers would be cut: then
    each row becomes a table of its own below its name, with the headings at the left.
    """
    console = Console()
    widths = [max(map(_longest_word, column)) for column in zip(headings, *rows, strict=True)]
    if sum(widths) + 3 * len(widths) + 1 <= console.width or len(headings) <= TURNED:
        console.print(_drawn(headings, rows))
        return
    for row in rows:
        line(row[0])
        pairs = list(zip(headings, row, strict=True))[1:]
        console.print(_drawn(["", ""], [list(pair) for pair in pairs]))


def _drawn(headings: list[str], rows: list[list[str]]) -> Table:
    """The headings are left out where all are empty."""
    shown = Table(show_header=any(headings))
    for heading in headings:
        shown.add_column(Text(heading), overflow="fold")
    for row in rows:
        shown.add_row(*map(Text, row))
    return shown


def _longest_word(text: str) -> int:
    return max(map(cell_len, text.split()), default=0)


def ending(results: Mapping[str, Path], *following: list[object]) -> None:
    """The last lines: where the results are, and commands to try next, ready to copy."""
    for what, path in results.items():
        line(f"{what}: {path}")
    for number, words in enumerate(following):
        command = shlex.join(["cnca", *map(str, words)])
        line(f"{'or' if number else 'next'}: {command}")


def measured(path: Path, *following: list[object]) -> None:
    """The last lines of a measurement, which writes ``path`` as .md, .json and .png."""
    files = {"table": ".md", "numbers": ".json", "picture": ".png"}
    ending({what: path.with_suffix(suffix) for what, suffix in files.items()}, *following)


def attack(request: Request, summary: Summary) -> None:
    """How an attack went."""
    rows = [
        [meaning, f"{summary.score(name):.3f}", f"{summary.average_precision[name]:.3f}"]
        for name, meaning in MEANING.items()
        if name in summary.average_precision
    ]
    table(["texture", "detection score", "AP@0.5"], rows)
    line(f"camouflage over shuffled control: {summary.ratio_to_shuffled:.2f}")
    line(f"camouflage over the strongest control: {summary.ratio_to_controls:.2f}")
    out, scene = request.out, request.scene
    ending(
        {
            "texture": out / "texture.png",
            "scores": out / "summary.json",
            "report": out / "report.html",
            "before and after": out / "before_after.png",
        },
        ["evaluate", "--scene", scene, "--texture", out, "--out", f"{out}_evidence"],
        ["turntable", out],
        ["print-sheets", out, "--out", f"{out}.pdf"],
    )


def forecast(expected: Forecast) -> None:
    """What an attack will take."""
    Console().print(expected.table())
    line(expected.sentence())


def attack_table(out: Path, name: str) -> None:
    """The table of several attacks."""
    line((out / f"{name}.md").read_text(encoding="utf-8"))
    measured(out / name)


def chosen_tau(out: Path, choice: Choice) -> None:
    """The bound that a search chose."""
    attack_table(out, "auto_tau")
    line(f"chosen: τ = {choice.tau:g}, {len(choice.rows)} runs")


def rerun(again: Rerun) -> None:
    """Whether a run came out the same."""
    for name, (was, now) in again.other_versions.items():
        line(f"{name}: was {was}, is {now}")
    if again.difference is not None:
        same = "the same to the bit"
        apart = f"differs by up to {again.difference * 255:.0f} of 255"
        line(f"texture: {apart if again.difference else same}")
    ending({"texture": again.out / "texture.png"})


def evidence(results: Evidence) -> None:
    """What each row reaches: mean of the detectors, the vehicle's class, 95 % intervals."""
    from cnca.judge.verdict import TOTAL
    from cnca.report.tables import cell

    rows = []
    for row in results.rows:
        total = results.all[row][TOTAL][results.label]
        measures = ("AP_voc", "AP_coco", "score")
        rows.append([row, *(cell(total[name], digits=2) for name in measures)])
    table(["texture", "AP@0.5 (VOC)", "AP@0.5 (COCO)", "score"], rows)


def photographs(results: PhotoEvidence) -> None:
    """AP@0.5 (VOC) of the car in each row of photographs, by detector."""
    from cnca.detect.classes import CAR
    from cnca.report.tables import cell

    rows = [
        [row, *(cell(detectors[name][CAR]["AP_voc"], digits=2) for name in results.detectors)]
        for row, detectors in results.all.items()
    ]
    table(["photographs", *results.detectors], rows)


def hardening(request: HardeningRequest) -> None:
    """The table of a hardening, and what names the detector that came of it."""
    line((request.out / "hardening.md").read_text(encoding="utf-8"))
    line(f"hardened detector: --detector {request.hardened}")
    ending({"table": request.out / "hardening.md"}, ["report", request.out])


def renders(request: RenderRequest, records: Sequence[RenderRecord], *, explain: bool) -> None:
    """Where the pictures are and what they took; with ``explain`` the plan, whose errors and shares
    of the time are predictions.
    """
    if explain:
        rows = [
            [row.effect, str(row.model), row.why, f"{row.error:.2%}", f"{row.time_share:.0%}"]
            for row in records[0].plan
        ]
        table(["effect", "model", "why", "error", "time"], rows)
    for record in records:
        measured, took = record.measured, f"first call {record.seconds.first:.2f} s"
        if measured is None:
            took += f", steady {record.seconds.steady:.2f} s"
        else:
            took = (
                f"error {measured.error:.2%}, {measured.samples:.0f} rays per pixel, in "
                f"{measured.seconds:.1f} processor seconds, pilot {measured.pilot_seconds:.1f}"
            )
        line(f"{request.out.parent / record.picture}: {took}")
    if not explain:
        again: list[object] = ["render-scene", request.scene, "-o", request.out, "--explain"]
        ending({}, again, ["view", request.scene])


def price_list(out: Path, report: AccuracyReport) -> None:
    """How good the reference is, and what the plans reach."""
    from cnca.jobs.accuracy.price_list import describe_reference

    line(describe_reference(report.reference))
    for rung in report.rungs:
        if rung.target is not None:
            spent = rung.seconds.steady.forward
            line(f"{rung.name}: error {rung.error:.2%} in {spent:.2f} processor seconds")
    measured(out / "accuracy")


def gradient_prices(out: Path, report: GeneratorReport) -> None:
    """What going back through fewer denoising steps costs."""
    rows = [
        [str(row.steps), *(f"{getattr(row, key):{how}}" for key, how in GRADIENT.items())]
        for row in report.prices
    ]
    table(["last steps", *GRADIENT], rows)
    measured(out / "generator")


def dataset(out: Path, report: Rendered) -> None:
    """How far a data set has come."""
    speed = report.per_second
    rate = f", {parallel.count() * speed:.2f} a second" if speed else ""
    line(f"{out}: {report.rendered} pictures rendered{rate}, {report.done} there in all")


def frames(out: Path, records: Sequence[FrameRecord | FrameProblem]) -> None:
    """How well the mesh meets CARLA's frames."""
    from cnca.jobs.datasets.carla import FrameProblem

    rows = []
    for record in records:
        if isinstance(record, FrameProblem):
            rows.append([record.source, record.problem, "", ""])
            continue
        pixels = record.outline_pixels
        numbers = f"{record.lift:.3f}", f"{pixels.median:.1f}", f"{pixels.percentile_90:.1f}"
        rows.append([record.source, *numbers])
    table(["frame", "lift, m", "outline, px: median", "90th percentile"], rows)
    ending({"data set": out})


def layouts(out: Path, report: Reordering) -> None:
    """The layouts before and after."""
    both = report.before, report.after
    rows = [
        [meaning, *(f"{getattr(layout, key):.4g}" for layout in both)]
        for key, meaning in LAYOUT.items()
    ]
    table(["layout", f"before: {report.was}", "after"], rows)
    line(f"scene: vehicle: {json.dumps(report.vehicle)}")
    ending(
        {"numbers": out.with_suffix(".json"), "picture": out.with_suffix(".png"), "mesh": out},
        ["check-vehicle", out, "--up", "z"],
    )


def corrections(request: EfrRequest, report: EfrReport) -> None:
    """The result of training an EFR."""
    line(
        f"{request.out}: mean absolute error {report.error_before:.4f} before, "
        f"{report.error_after:.4f} after, on {report.test_views} views not trained on"
    )
    if request.carla is not None:
        line("one car in one paint: says nothing about other textures, cars or weathers")
