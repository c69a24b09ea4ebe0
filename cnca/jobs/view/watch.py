"""The page of ``cnca watch``: runs side by side, from what their folders hold at the moment."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cnca.attack.records import StepRecord
from cnca.core.errors import RunError
from cnca.core.manifest import Manifest
from cnca.core.records import as_json, from_json, read_record
from cnca.jobs.attack.now import TEXTURE_NOW, VIEWS_NOW
from cnca.jobs.view.serve import FOLLOW
from cnca.judge.summary import Summary
from cnca.report import MEANING
from cnca.report.webpage import jpeg_uri, render

POINTS = 400
"""Of a curve, at most."""
EVERY = 0.5
"""Seconds between two looks into the folders."""
WIDEST = {"before_after.png": 960, "texture.png": 256, VIEWS_NOW: 960, TEXTURE_NOW: 256}
"""Picture of a run → pixels per row at which it is shown."""


@dataclass(frozen=True)
class Curve:
    """Numbers over the steps."""

    name: str
    steps: list[int]
    values: list[float]


@dataclass(frozen=True)
class TextureRow:
    """What a finished run says of one texture."""

    meaning: str
    score: float
    average_precision: float


@dataclass(frozen=True)
class Watched:
    """One run as it is now."""

    name: str
    prompt: str
    scene: str
    step: int
    steps: int
    """That were asked for."""
    seconds_left: float | None
    """By the mean of its last steps; None where there is nothing to go by, or nothing left."""
    curves: list[Curve]
    rows: list[TextureRow]
    """Empty until it is judged."""
    pictures: dict[str, str]
    """Name → address of the picture, of those that are there."""


class WatchPage:
    """Runs in the browser; it only reads, so that it may watch a run of another machine's disk."""

    def __init__(self, folders: Sequence[Path]) -> None:
        """Raises RunError for a folder without a run."""
        self.folders = list(folders)
        for folder in self.folders:
            if not (folder / "manifest.json").is_file():
                raise RunError(f"{folder}: holds no run; give the --out of a cnca optimize")
        self._pictures: dict[Path, tuple[int, str]] = {}

    @cached_property
    def html(self) -> str:
        """The page."""
        title = ", ".join(folder.name for folder in self.folders)
        folder = Path(__file__).parent / "watching"
        return render(folder, connect="'self'", programs=[FOLLOW], title=title)

    def newer(self, than: int, timeout: float) -> Mapping[str, Any] | None:
        """All runs, as soon as one of them has changed."""
        end = time.monotonic() + timeout
        while True:
            runs = [as_json(self.read(folder)) for folder in self.folders]
            number = _fingerprint(runs)
            if number != than:
                return {"number": number, "runs": runs}
            if time.monotonic() >= end:
                return None
            time.sleep(EVERY)

    def post(self, path: str, content: Mapping[str, Any]) -> Mapping[str, Any] | None:
        """There is nothing to ask for."""
        return None

    def read(self, folder: Path) -> Watched:
        """One run's folder."""
        request = Manifest.read(folder / "manifest.json").request
        settings = request.get("settings", {})
        records = read_log(folder / "log.jsonl")
        step, steps = (records[-1].step if records else 0), int(settings.get("steps", 0))
        rows = _rows(folder / "summary.json")
        return Watched(
            name=folder.name,
            prompt=str(settings.get("prompt", "")),
            scene=str(request.get("scene", "")),
            step=step,
            steps=steps,
            seconds_left=None if rows else _seconds_left(records, steps - step),
            curves=curves_of(records),
            rows=rows,
            pictures={
                name: picture
                for name, width in WIDEST.items()
                if (picture := self._picture(folder / name, width))
            },
        )

    def _picture(self, path: Path, width: int) -> str:
        """The address of a picture, made again when its file has changed; empty without one."""
        try:
            written = path.stat().st_mtime_ns
            if self._pictures.get(path, (0, ""))[0] != written:
                self._pictures[path] = written, _shrunk(path, width)
        except FileNotFoundError:  # a run that ends removes what it showed on its way
            return ""
        return self._pictures[path][1]


def _shrunk(path: Path, width: int) -> str:
    content = np.frombuffer(path.read_bytes(), np.uint8)
    picture = cv2.imdecode(content, cv2.IMREAD_COLOR) if len(content) else None
    if picture is None:
        raise RunError(f"{path}: cannot be read as a picture; run its command again")
    shrink = min(width / picture.shape[1], 1.0)
    picture = cv2.resize(picture, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    return jpeg_uri(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))


def read_log(path: Path) -> list[StepRecord]:
    """The steps of a run so far; a last line that is being written is left for the next time."""
    if not path.is_file():
        return []
    *lines, _unfinished = path.read_text(encoding="utf-8").split("\n")
    return [from_json(StepRecord, json.loads(line), path) for line in lines]


def curves_of(records: Sequence[StepRecord]) -> list[Curve]:
    """Score and loss of the steps, and of the validation views where they were checked."""
    checked = [(r.step, r.validation) for r in records if r.validation is not None]
    steps, checks = [r.step for r in records], [step for step, _ in checked]
    return [
        _thinned("score", steps, [r.D_s for r in records]),
        _thinned("score, validation", checks, [seen.D_s for _, seen in checked]),
        _thinned("loss", steps, [r.loss_adv for r in records]),
        _thinned("loss, validation", checks, [seen.loss_adv for _, seen in checked]),
    ]


def _thinned(name: str, steps: Sequence[int], values: Sequence[float]) -> Curve:
    """At most about :data:`POINTS` points, evenly chosen, and the last."""
    stride = -(-len(steps) // POINTS) or 1
    chosen = sorted({*range(0, len(steps), stride), *([len(steps) - 1] if steps else [])})
    return Curve(name, [steps[k] for k in chosen], [round(values[k], 5) for k in chosen])


def _seconds_left(records: Sequence[StepRecord], left: int) -> float | None:
    last = records[-10:]
    if not last or left <= 0:
        return None
    return round(left * sum(record.seconds_total for record in last) / len(last), 1)


def _rows(path: Path) -> list[TextureRow]:
    if not path.is_file():
        return []
    summary = read_record(Summary, path)
    precision = summary.average_precision
    return [
        TextureRow(meaning, round(summary.score(name), 3), round(precision[name], 3))
        for name, meaning in MEANING.items()
        if name in precision
    ]


def _fingerprint(content: object) -> int:
    """A number from 1 on that stands for the content; JavaScript holds it exactly."""
    digest = hashlib.sha256(json.dumps(content).encode()).digest()
    return int.from_bytes(digest[:6]) + 1
