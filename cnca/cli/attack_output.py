"""What the attacks say: scores, tables, and where everything is."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.table import Table

from cnca.attack.settings import Settings
from cnca.core import parallel
from cnca.core.errors import RunError
from cnca.core.interrupts import resumable
from cnca.jobs.attack.request import Request
from cnca.jobs.attack.run import run
from cnca.report import MEANING

DEMO_SCENE, DEMO_PROMPT = Path("builtin:sedan_clear"), "colorful camouflage"

_RESULTS = {
    "before and after": "before_after.png",
    "texture": "texture.png",
    "scores": "summary.json",
    "report": "report.html",
}


def attack(request: Request) -> None:
    """Run an attack with progress, then say how it went and where everything is.

    Ctrl-C or SIGTERM ends with the words that resume the run; see :mod:`cnca.core.interrupts`.
    """
    console = Console(stderr=True, quiet=parallel.rank() > 0)
    with resumable(console, f"the same command with --resume goes on in {request.out}"):
        summary = run(request, console)
    table = Table("texture", "detection score", "AP@0.5")
    for name, meaning in MEANING.items():
        precision = summary["AP@0.5"][name]
        table.add_row(meaning, f"{summary[f'score_{name}']:.3f}", f"{precision:.3f}")
    shown = Console()
    shown.print(table)
    shown.print(f"camouflage over shuffled control: {summary['ratio_to_shuffled']:.2f}")
    for what, name in _RESULTS.items():
        shown.print(f"{what}: {request.out / name}", soft_wrap=True)


def optimize(request: Request, tau: str, least: float | None, scorer: Path | None) -> None:
    """Attack under the bound ``tau``; "auto" searches it so that the prompt score stays.

    Raises RunError for a bound that is none, or where "auto" and ``least`` do not come together.
    """
    from cnca.jobs.attack.runs import read_tau, under_tau

    if tau != "auto":
        if least is not None or scorer is not None:
            raise RunError("--min-prompt-score and --scorer belong to --tau auto; leave them out")
        attack(under_tau(request, read_tau(tau)))
        return
    if least is None:
        raise RunError("--tau auto: say --min-prompt-score, the cosine that must be kept")
    from cnca.gen.scorer import load_scorer
    from cnca.jobs.attack.auto_tau import auto_tau

    choice = auto_tau(request, least, load_scorer(scorer), Console(stderr=True))
    _print_table(request.out, "auto_tau")
    Console().print(f"chosen: τ = {choice.tau:g}, {len(choice.rows)} runs", soft_wrap=True)


def tradeoff(request: Request, taus: str, scorer: Path | None) -> None:
    """One attack per bound, then the table."""
    from cnca.gen.scorer import load_scorer
    from cnca.jobs.attack.runs import read_taus, tradeoff

    tradeoff(request, read_taus(taus), load_scorer(scorer), Console(stderr=True))
    _print_table(request.out, "tradeoff")


def prompts(request: Request, wanted: list[str], tau: str, scorer: Path | None) -> None:
    """One attack per prompt, then the table."""
    from cnca.gen.scorer import load_scorer
    from cnca.jobs.attack.runs import prompts, read_tau, under_tau

    request = under_tau(request, read_tau(tau))
    prompts(request, wanted, load_scorer(scorer), Console(stderr=True))
    _print_table(request.out, "prompts")


def _print_table(out: Path, name: str) -> None:
    shown = Console()
    shown.print((out / f"{name}.md").read_text(encoding="utf-8"), soft_wrap=True, markup=False)
    for ending in ("md", "png", "json"):
        shown.print(out / f"{name}.{ending}", soft_wrap=True)


def demo(out: Path, steps: int) -> None:
    """The main job on the shipped sedan, generator and detector."""
    resume = (out / "manifest.json").exists() and not (out / "summary.json").exists()
    settings = Settings(DEMO_PROMPT, steps=steps, learning_rate=0.05)
    attack(
        Request(
            DEMO_SCENE,
            out,
            settings,
            full_overlap=0.5,
            gradient_steps=10,
            gradient_checkpointing=False,
            resume=resume,
        )
    )
