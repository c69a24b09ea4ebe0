"""The parts of a ``cnca optimize``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from markupsafe import Markup

from cnca.attack.records import StepRecord
from cnca.core.images import read_texture_srgb
from cnca.core.pictures import SrgbPicture
from cnca.core.records import from_json, read_record
from cnca.judge.bootstrap import Sampled, resample
from cnca.judge.summary import Summary, TextureScores
from cnca.report import MEANING, shown_views
from cnca.report.blocks import Gallery, Part, Picture, Prose, Slider, Strip
from cnca.report.curves import draw
from cnca.report.markdown import as_html
from cnca.report.tables import cell, table
from cnca.report.webpage import file_uri, jpeg_uri


def attack_parts(path: Path) -> list[Part]:
    """Verdict, slider, textures, curves and seconds; ``path``: the ``summary.json`` of a run."""
    folder, summary = path.parent, read_record(Summary, path)
    log = folder / "log.jsonl"
    lines = log.read_text(encoding="utf-8").splitlines()
    records = [from_json(StepRecord, json.loads(line), log) for line in lines]
    title = f"“{summary.prompt}” against {', '.join(summary.by_detector)}"
    return [
        Part(title, [Prose(as_html(_verdict(summary)))]),
        Part("Before and after", [before_after([("camouflage", folder, summary)])]),
        Part("Texture", [_textures(folder)]),
        *([Part("Steps", _steps(records))] if records else []),
    ]


def before_after(runs: Sequence[tuple[str, Path, Summary]]) -> Slider:
    """Plain paint on the left, the camouflage of each run (name, folder, summary) on the right."""
    rights = []
    for name, folder, summary in runs:
        befores, afters = _tiles(folder, summary)
        rights.append(_strip(name, afters, summary, "after"))
        if len(rights) == 1:
            left = _strip(MEANING["before"], befores, summary, "before")
            height, width = befores[0].shape[:2]
    return Slider(left, rights, width, height)


def _verdict(summary: Summary) -> str:
    """Scores before each detector with intervals over the held-out views, as Markdown."""
    by_detector = summary.by_detector
    tables = [
        (f"## Before {name}\n\n" if len(by_detector) > 1 else "") + _scores(numbers)
        for name, numbers in by_detector.items()
    ]
    return (
        f"Scene {summary.scene}. Scores are means over {summary.held_out_views} held-out "
        "views: the highest confidence among detections of the class that overlap the vehicle's "
        "box by at least one half. In brackets: 95 %, percentile bootstrap over these views. "
        "In the pictures the vehicle's box is green, what the detector finds is red.\n\n"
        + "\n".join(tables)
        + "\nA loud texture alone can fool a small detector; only what goes beyond the controls is "
        "the attack.\n"
    )


def _scores(numbers: TextureScores) -> str:
    """One detector's table, and the ratio to the shuffled control over the same resamples."""
    scores = numbers.scores_per_view
    weights = resample([len(scores["before"])], seed=0)
    shares = weights / weights.sum(dim=1, keepdim=True)
    means = {
        n: shares @ torch.tensor(scores[n], dtype=torch.float64) for n in MEANING if n in scores
    }
    rows = [
        [meaning, cell(Sampled(means[name]).estimate()), f"{numbers.average_precision[name]:.3f}"]
        for name, meaning in MEANING.items()
        if name in means
    ]
    ratio = cell(Sampled(means["after"] / means["shuffled"]).estimate(), digits=2)
    head = ["texture", "detection score", "AP@0.5"]
    return f"{table(head, rows)}\nCamouflage over shuffled control: **{ratio}**.\n"


def _tiles(folder: Path, summary: Summary) -> tuple[list[SrgbPicture], ...]:
    """The pictures of ``before_after.png``, a contact sheet of two rows."""
    sheet = (read_texture_srgb(folder / "before_after.png") * 255).round().astype(np.uint8)
    height, columns = sheet.shape[0] // 2, len(shown_views(summary.held_out_views))
    width = sheet.shape[1] // columns
    return tuple(
        [sheet[top : top + height, left * width : (left + 1) * width] for left in range(columns)]
        for top in (0, height)
    )


def _strip(name: str, tiles: Sequence[SrgbPicture], summary: Summary, row: str) -> Strip:
    views = shown_views(summary.held_out_views)
    scores = [summary.scores_per_view[row][view] for view in views]
    captions = [f"{name}: score {score:.2f}" for score in scores]
    return Strip(
        name,
        [
            Picture(jpeg_uri(tile), f"view {number} with detections; {caption}", caption)
            for number, (tile, caption) in enumerate(zip(tiles, captions, strict=True), 1)
        ],
    )


def _textures(folder: Path) -> Gallery:
    words = {"texture_prompt.png": "the prompt alone", "texture.png": "with F_adv"}
    return Gallery(
        [Picture(file_uri(folder / name), f"texture, {text}", text) for name, text in words.items()]
    )


def _steps(records: Sequence[StepRecord]) -> list[Prose]:
    steps = [record.step for record in records]
    score = draw(steps, [record.D_s for record in records], "detection score, D_s")
    loss = draw(steps, [record.loss_adv for record in records], "loss, L_adv")
    curves = Markup('<div class="gallery">{}{}</div>').format(score, loss)
    return [Prose(curves), Prose(as_html(_seconds(records)))]


def _seconds(records: Sequence[StepRecord]) -> str:
    """Seconds of the parts of a step, as Markdown; the first step compiles and stands apart."""
    first, later = records[0], records[1:] or records
    total = np.array([record.seconds_total for record in later])
    names = dict.fromkeys(name for record in records for name in record.seconds)
    parts = {
        name: np.array([record.seconds.get(name, 0) for record in later])
        for name in names
        if name != "total"
    }
    parts["all else"] = total - sum(parts.values())
    rows = [
        [name, f"{part.mean():.2f}", f"{part.std():.2f}", f"{part.sum() / total.sum():.0%}"]
        for name, part in (parts | {"whole step": total}).items()
    ]
    return (
        f"{len(records)} steps took {(total.sum() + first.seconds_total) / 60:.1f} minutes, the "
        f"first {first.seconds_total:.1f} s. The others:\n\n"
        + table(["part of a step", "mean, s", "standard deviation", "share"], rows)
    )
