"""What the terminal says: tables that fit its width, where results are, and what to try next."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from cnca.core import parallel
from cnca.report import MEANING

if TYPE_CHECKING:
    from cnca.jobs.attack.auto_tau import Choice
    from cnca.jobs.attack.forecast import Forecast
    from cnca.jobs.attack.request import Request
    from cnca.jobs.attack.rerun import Rerun
    from cnca.jobs.hardening_request import HardeningRequest
    from cnca.judge.records import Evidence, PhotoEvidence


def messages() -> Console:
    """Where progress and warnings go: stderr, of the first of several processes."""
    return Console(stderr=True, quiet=parallel.rank() > 0)


def line(text: object) -> None:
    """One line, however long, so that what it names can be copied."""
    Console().print(str(text), soft_wrap=True, markup=False, highlight=False)


def table(headings: list[str], rows: list[list[str]]) -> None:
    """Rows under their headings; what is wider than the terminal wraps."""
    shown = Table(*headings)
    for row in rows:
        shown.add_row(*map(Text, row))
    Console().print(shown)


def ending(results: Mapping[str, Path], *following: list[object]) -> None:
    """The last lines: where the results are, and commands to try next, ready to copy."""
    for what, path in results.items():
        line(f"{what}: {path}")
    for number, words in enumerate(following):
        command = shlex.join(["cnca", *map(str, words)])
        line(f"{'or' if number else 'next'}: {command}")


def attack(request: Request, summary: dict[str, Any]) -> None:
    """How an attack went."""
    rows = [
        [meaning, f"{summary[f'score_{name}']:.3f}", f"{summary['AP@0.5'][name]:.3f}"]
        for name, meaning in MEANING.items()
        if name in summary["AP@0.5"]
    ]
    table(["texture", "detection score", "AP@0.5"], rows)
    line(f"camouflage over shuffled control: {summary['ratio_to_shuffled']:.2f}")
    line(f"camouflage over the strongest control: {summary['ratio_to_controls']:.2f}")
    out, scene = request.out, request.scene
    ending(
        {
            "texture": out / "texture.png",
            "scores": out / "summary.json",
            "report": out / "report.html",
            "before and after": out / "before_after.png",
        },
        ["evaluate", "--scene", scene, "--texture", out, "--out", f"{out}_evidence"],
        ["print-sheets", out, "--out", f"{out}.pdf"],
    )


def forecast(expected: Forecast) -> None:
    """What an attack will take."""
    Console().print(expected.table())
    line(expected.sentence())


def attack_table(out: Path, name: str) -> None:
    """The table of several attacks."""
    line((out / f"{name}.md").read_text(encoding="utf-8"))
    path = out / name
    ending(
        {
            "table": path.with_suffix(".md"),
            "numbers": path.with_suffix(".json"),
            "picture": path.with_suffix(".png"),
        },
    )


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
