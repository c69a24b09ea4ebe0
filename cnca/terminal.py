"""What the commands say: tables and closing lines."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

from cnca.attack import parallel
from cnca.attack.run import Request, run
from cnca.errors import RunError
from cnca.interrupts import resumable
from cnca.optimize import Settings
from cnca.report import MEANING

if TYPE_CHECKING:
    from cnca.evidence.parts import Request as EvidenceRequest
    from cnca.reorder_uv import Source

DEMO_SCENE = Path("builtin:sedan_clear")
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

    Ctrl-C or SIGTERM ends with the words that resume the run; see :mod:`cnca.interrupts`.
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
    from cnca.attack.runs import read_tau, under_tau

    if tau != "auto":
        if least is not None or scorer is not None:
            raise RunError("--min-prompt-score and --scorer belong to --tau auto; leave them out")
        attack(under_tau(request, read_tau(tau)))
        return
    if least is None:
        raise RunError("--tau auto: say --min-prompt-score, the cosine that must be kept")
    from cnca.attack.auto_tau import auto_tau
    from cnca.gen.scorer import load_scorer

    choice = auto_tau(request, least, load_scorer(scorer), Console(stderr=True))
    _print_table(request.out, "auto_tau")
    Console().print(f"chosen: τ = {choice.tau:g}, {len(choice.rows)} runs", soft_wrap=True)


def tradeoff(request: Request, taus: str, scorer: Path | None) -> None:
    """One attack per bound, then the table."""
    from cnca.attack.runs import read_taus, tradeoff
    from cnca.gen.scorer import load_scorer

    tradeoff(request, read_taus(taus), load_scorer(scorer), Console(stderr=True))
    _print_table(request.out, "tradeoff")


def prompts(request: Request, wanted: list[str], tau: str, scorer: Path | None) -> None:
    """One attack per prompt, then the table."""
    from cnca.attack.runs import prompts, read_tau, under_tau
    from cnca.gen.scorer import load_scorer

    request = under_tau(request, read_tau(tau))
    prompts(request, wanted, load_scorer(scorer), Console(stderr=True))
    _print_table(request.out, "prompts")


def _print_table(out: Path, name: str) -> None:
    shown = Console()
    shown.print((out / f"{name}.md").read_text(encoding="utf-8"), soft_wrap=True, markup=False)
    for ending in ("md", "png", "json"):
        shown.print(out / f"{name}.{ending}", soft_wrap=True)


def accuracy(scene: Path, out: Path, **options: Any) -> None:
    """Measure the price list with progress, then say how good its reference is."""
    from cnca.accuracy.ladder import (
        accuracy as measure_accuracy,  # loads colour-science, which is slow
    )
    from cnca.accuracy.price_list import describe_reference

    report, shown = measure_accuracy(scene, out, console=Console(stderr=True), **options), Console()
    shown.print(describe_reference(report["reference"]), soft_wrap=True)
    for rung in report["rungs"]:
        if rung["target"] is not None:
            spent = rung["seconds"]["steady"]["forward"]
            shown.print(f"{rung['name']}: error {rung['error']:.2%} in {spent:.2f} s")
    for ending in ("md", "png", "json"):
        shown.print(out / f"accuracy.{ending}", soft_wrap=True)


def generator_accuracy(out: Path, **options: Any) -> None:
    """Measure the generator's price list with progress, then print it."""
    from cnca.accuracy.generator import generator_accuracy as measure

    report, shown = measure(out, console=Console(stderr=True), **options), Console()
    listed = Table("last steps", "seconds", "cosine", "length")
    for row in report["prices"]:
        numbers = f"{row['seconds']:.2f}", f"{row['cosine']:.3f}", f"{row['length']:.3f}"
        listed.add_row(str(row["steps"]), *numbers)
    shown.print(listed)
    for ending in ("md", "png", "json"):
        shown.print(out / f"generator.{ending}", soft_wrap=True)


def evidence(request: EvidenceRequest) -> None:
    """Evaluate textures with progress, then say what each candidate reaches."""
    from cnca.evidence.evaluation import evaluate_scenes
    from cnca.evidence.report import headlines

    results = _gather(evaluate_scenes, request)
    shown = Console()
    shown.print(_evidence_table(results))
    for sentence in headlines(results):
        shown.print(sentence, soft_wrap=True)
    shown.print(f"tables and pictures: {request.out / 'results.md'}", soft_wrap=True)


def table1(request: EvidenceRequest, *, paper_figures: bool) -> None:
    """Make the paper's Table 1 with progress, then say where it is."""
    from cnca.evidence.evaluation import evaluate_scenes
    from cnca.evidence.paper_tables import write_table1

    results = _gather(evaluate_scenes, request)
    path = write_table1(request.out, results, paper_figures=paper_figures)
    shown = Console()
    shown.print(_evidence_table(results))
    shown.print(f"table: {path}; all else: {request.out / 'results.md'}", soft_wrap=True)


def photos(
    folder: Path | None, labels: Path | None, out: Path, detectors: tuple[str, ...], **options: Any
) -> None:
    """Judge detectors on photographs with progress, then print the paper's Table 2."""
    from cnca.evidence.photos import PhotoRequest, evaluate_photos
    from cnca.evidence.report import cell

    if folder is None or labels is None:
        raise RunError("--photos and --labels belong together: give both")
    results = _gather(evaluate_photos, PhotoRequest(folder, labels, out, detectors, **options))
    table = Table()
    for name in ("photographs", *results["detectors"]):
        table.add_column(name, no_wrap=True)
    for row, by_detector in results["all"].items():
        aps = (by_detector[name]["car"]["AP_voc"] for name in results["detectors"])
        table.add_row(row, *(cell(ap, digits=2) for ap in aps))
    shown = Console()
    shown.print(table)
    shown.print(f"AP@0.5 of the car (VOC); all else: {out / 'results.md'}", soft_wrap=True)


def _gather(work: Callable[[Any, Console], dict[str, Any]], request: Any) -> dict[str, Any]:
    """Results of an evaluation; after an interruption the same command goes on."""
    console = Console(stderr=True)
    with resumable(console, f"the same command goes on in {request.out}"):
        return work(request, console)


def _evidence_table(results: dict[str, Any]) -> Table:
    """Mean over the detectors, class car, with 95 % intervals."""
    from cnca.evidence.report import cell
    from cnca.evidence.verdict import TOTAL

    table = Table()
    for name in ("texture", "AP@0.5 (VOC)", "AP@0.5 (COCO)", "score"):
        table.add_column(name, no_wrap=True)
    for row in results["rows"]:
        total = results["all"][row][TOTAL]["car"]
        measures = ("AP_voc", "AP_coco", "score")
        table.add_row(row, *(cell(total[name], digits=2) for name in measures))
    return table


def dataset(scene: Path, out: Path, **options: Any) -> None:
    """Render a data set with progress, then say how far it has come."""
    from cnca.datasets.rendered import render_dataset

    report = render_dataset(scene, out, console=Console(stderr=True), **options)
    speed = report["per_second"]
    rate = f", {speed:.2f} a second" if speed else ""
    Console().print(
        f"{out}: {report['rendered']} pictures rendered{rate}, {report['done']} there in all",
        soft_wrap=True,
    )


def reorder_uv(source: Source, out: Path, size: int) -> None:
    """Write a vehicle with a new UV layout, then compare the layouts."""
    from cnca.reorder_uv import reorder_uv as write_reordered

    report, shown = write_reordered(source, out, size=size), Console()
    listed = Table("layout", f"before: {report['was']}", "after")
    for key, meaning in _LAYOUT.items():
        listed.add_row(meaning, *(f"{report[when][key]:.4g}" for when in ("before", "after")))
    shown.print(listed)
    shown.print(f"scene: vehicle: {json.dumps(report['vehicle'])}", soft_wrap=True)
    for ending in ("obj", "json", "png"):
        shown.print(out.with_suffix(f".{ending}"), soft_wrap=True)


def import_carla(folder: Path, out: Path, scene: Path, *, fov: float) -> None:
    """Turn frames into a data set with progress, then say how well the mesh meets them."""
    from cnca.datasets.carla import import_carla as import_frames

    listed = Table("frame", "lift, m", "outline, px: median", "90th percentile")
    for record in import_frames(folder, out, scene, fov=fov, console=Console(stderr=True)):
        if "problem" in record:
            listed.add_row(record["source"], record["problem"], "", "")
            continue
        pixels = record["outline_pixels"]
        numbers = (
            f"{record['lift']:.3f}",
            f"{pixels['median']:.1f}",
            f"{pixels['percentile_90']:.1f}",
        )
        listed.add_row(record["source"], *numbers)
    Console().print(listed)
    Console().print(out, soft_wrap=True)


def train_efr(out: Path, **options: Any) -> None:
    """Train with progress, then say what it came to."""
    from cnca.train_efr import train_efr as train  # loads the renderer

    report = train(out, console=Console(stderr=True), **options)
    print(
        f"{out}: mean absolute error {report['error_before']:.4f} before, "
        f"{report['error_after']:.4f} after, on {report['test_views']} views not trained on"
    )
    if options["carla"]:
        print("one car in one paint: says nothing about other textures, cars or weathers")


def demo(out: Path, steps: int) -> None:
    """The main job on the shipped sedan, generator and detector."""
    resume = (out / "manifest.json").exists() and not (out / "summary.json").exists()
    settings = Settings(DEMO_PROMPT, steps=steps, learning_rate=0.05, full_overlap=0.5)
    attack(Request(DEMO_SCENE, ("builtin",), out, settings, gradient_steps=5, resume=resume))


_RESULTS = {
    "before and after": "before_after.png",
    "texture": "texture.png",
    "scores": "summary.json",
    "report": "report.html",
}


_LAYOUT = {
    "charts": "charts",
    "seam_length": "seams, m",
    "stretch": "L² stretch",
    "density_spread": "texels per metre, 95th over 5th percentile",
    "used": "share of the texture in use",
    "overlap": "share of it used twice",
}
"""Of the painted faces that can be seen from outside."""


def _plan_table(plan: list[dict[str, Any]]) -> Table:
    """The plan; error and share of the time are predictions."""
    table = Table()
    for name in ("effect", "model", "why", "error", "time"):
        table.add_column(name, no_wrap=name != "why")
    for row in plan:
        numbers = f"{row['error']:.2%}", f"{row['time_share']:.0%}"
        table.add_row(row["effect"], row["model"], row["why"], *numbers)
    return table
