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


def _plan_table(plan: list[dict[str, str]]) -> Table:
    table = Table("effect", "model", "why")
    for row in plan:
        table.add_row(row["effect"], row["model"], row["why"])
    return table
