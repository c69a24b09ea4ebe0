"""What the commands say: tables and closing lines."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from cnca.errors import RunError
from cnca.optimize import Settings
from cnca.report import MEANING
from cnca.run import Request, run

DEMO_SCENE = Path(__file__).parents[1] / "scenes" / "sedan_clear.yaml"
DEMO_PROMPT = "colorful camouflage"


def show_renders(
    folder: Path, records: list[dict[str, Any]], *, explain: bool, as_json: bool
) -> None:
    """Print where the pictures are, or the records themselves."""
    if as_json:
        print(json.dumps(records, indent=2))
        return
    console = Console()
    if explain:
        console.print(_plan_table(records[0]["plan"]))
    for record in records:
        seconds = record["seconds"]
        console.print(
            f"{folder / record['picture']}: first call {seconds['first']:.2f} s, "
            f"steady {seconds['steady']:.2f} s",
            soft_wrap=True,
        )


def attack(request: Request) -> None:
    """Run an attack with progress, then say how it went and where everything is.

    Ctrl-C ends with exit code 130 and the words that resume the run.
    """
    console = Console(stderr=True)
    try:
        summary = run(request, console)
    except KeyboardInterrupt:
        console.print(f"interrupted; the same command with --resume goes on in {request.out}")
        raise SystemExit(130) from None
    table = Table("texture", "detection score", "AP@0.5")
    for name, meaning in MEANING.items():
        precision = summary["AP@0.5"][name]
        table.add_row(meaning, f"{summary[f'score_{name}']:.3f}", f"{precision:.3f}")
    shown = Console()
    shown.print(table)
    shown.print(f"camouflage over shuffled control: {summary['ratio_to_shuffled']:.2f}")
    for what, name in _RESULTS.items():
        shown.print(f"{what}: {request.out / name}", soft_wrap=True)


def accuracy(scene: Path, out: Path, *, seconds: float, view: str | None, detector: str) -> None:
    """Measure the price list with progress, then say how good its reference is."""
    from cnca.accuracy import accuracy as measure_accuracy  # loads colour-science, which is slow

    console = Console(stderr=True)
    report = measure_accuracy(
        scene, out, seconds=seconds, view=view, detector=detector, console=console
    )
    reference, shown = report["reference"], Console()
    shown.print(
        f"reference of {reference['samples']} rays per pixel: standard error "
        f"{reference['standard_error']:.2%}, halves {reference['difference_of_means']:+.2%} apart"
    )
    for rung in report["rungs"]:
        if rung["target"] is not None:
            spent = rung["seconds"]["steady"]["forward"]
            shown.print(f"{rung['name']}: error {rung['error']:.2%} in {spent:.2f} s")
    for ending in ("md", "png", "json"):
        shown.print(out / f"accuracy.{ending}", soft_wrap=True)


def demo(out: Path, steps: int) -> None:
    """The main job on the shipped sedan, generator and detector.

    Raises RunError where the scenes are not beside the package (not a checkout).
    """
    if not DEMO_SCENE.exists():
        raise RunError(f"{DEMO_SCENE}: not there; run the demo from a checkout of the repository")
    settings = Settings(DEMO_PROMPT, tau=1.0, steps=steps, learning_rate=0.2)
    resume = (out / "manifest.json").exists() and not (out / "summary.json").exists()
    attack(Request(DEMO_SCENE, "builtin", out, settings, held_out_views=16, resume=resume))


_RESULTS = {
    "before and after": "before_after.png",
    "texture": "texture.png",
    "scores": "summary.json",
    "report": "report.html",
}


def _plan_table(plan: list[dict[str, Any]]) -> Table:
    """The plan; error and share of the time are predictions."""
    table = Table()
    for name in ("effect", "model", "why", "error", "time"):
        table.add_column(name, no_wrap=name != "why")
    for row in plan:
        numbers = f"{row['error']:.2%}", f"{row['time_share']:.0%}"
        table.add_row(row["effect"], row["model"], row["why"], *numbers)
    return table
