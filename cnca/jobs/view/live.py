"""The page of ``cnca view``: what it shows, what it may ask for, and the loop that renders."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from cnca.core.errors import CncaError
from cnca.core.records import Omitted, as_json
from cnca.detect import BUILTINS
from cnca.jobs.view.controls import CLEAREST, Controls, changed, controls_of
from cnca.jobs.view.costs import EffectCost, TargetCost
from cnca.jobs.view.desk import Desk
from cnca.jobs.view.keep import save_picture, save_scene
from cnca.jobs.view.request import ViewRequest
from cnca.jobs.view.serve import FOLLOW
from cnca.jobs.view.stage import Box, Frame, Stage
from cnca.report.webpage import jpeg_uri, render
from cnca.scene.schema import Scene

IDLE = 0.5
"""Seconds that a finished picture waits for the next change at a time."""


@dataclass(frozen=True)
class Shown:
    """A frame, or what is going on instead, for the controls that it belongs to."""

    controls: Controls
    frame: Frame | None
    note: str = ""
    """What is being made, or what went wrong, in words."""


@dataclass(frozen=True)
class News:
    """What the page is told: all that it shows, and, once there is a picture, what it is of."""

    number: int
    controls: Controls
    note: str
    picture: Omitted[str] = None
    """Its address."""
    samples: Omitted[int] = None
    planned: Omitted[int] = None
    milliseconds: Omitted[float] = None
    boxes: Omitted[list[Box]] = None
    plan: Omitted[list[EffectCost]] = None
    targets: Omitted[list[TargetCost]] = None


class LivePage:
    """A scene in the browser; :meth:`run` renders in the thread that calls it."""

    def __init__(self, request: ViewRequest, scene: Scene) -> None:
        self.request, self.scene = request, scene
        controls = replace(
            controls_of(scene),
            texture=request.texture,
            prompt=request.prompt,
            detector=request.detector,
            target_error=request.target_error,
        )
        self._desk: Desk[Controls, Shown] = Desk(controls)
        self._stage = Stage(scene, width=request.width)
        self._frame: Frame | None = None

    @cached_property
    def html(self) -> str:
        """The page."""
        image, world = self._stage.original.image, self.scene.world
        content = {
            "width": image.width,
            "height": image.height,
            "clearest": CLEAREST,
            "measured": bool(self.scene.sky.map),
            "builtin_world": bool(world and world.file.startswith("builtin:")),
            "world": bool(world),
            "wettable": not self.scene.sky.map or bool(world),
        }
        title = self.request.scene.stem.removeprefix("builtin:")
        return render(
            FOLLOW.parent,
            connect="'self'",
            programs=[FOLLOW],
            title=title,
            content=content,
            detectors=BUILTINS,
        )

    def newer(self, than: int, timeout: float) -> Mapping[str, Any] | None:
        """The newest frame with all that stands beside it."""
        published = self._desk.newer(than, timeout)
        if published is None:
            return None
        shown, frame = published.shown, published.shown.frame
        news = News(published.number, shown.controls, shown.note)
        if frame is not None:
            news = replace(
                news,
                picture=jpeg_uri(frame.picture),
                samples=frame.samples,
                planned=frame.planned,
                milliseconds=frame.milliseconds,
                boxes=frame.boxes,
                plan=frame.plan,
                targets=frame.targets,
            )
        return as_json(news)

    def post(self, path: str, content: Mapping[str, Any]) -> Mapping[str, Any] | None:
        """``/controls`` moves some of them; ``/save`` writes the scene or the picture."""
        if path == "/controls":
            return asdict(self._desk.ask(changed, content))
        if path == "/save":
            what = self._save_picture if content.get("what") == "picture" else self._save_scene
            return {"saved": str(self._desk.do(what))}
        return None

    def run(self, pictures: int | None = None) -> None:
        """Render what is asked for, as often as it is asked for; until Ctrl-C.

        Args:
            pictures: end after so many frames.
        """
        version, drawn = -1, 0
        while pictures is None or drawn < pictures:
            idle = self._frame is not None and self._frame.done
            controls, newest = self._desk.wait(version, IDLE if idle else 0.0)
            self._desk.work()
            if newest != version:
                version = newest
                self._turn(controls)
            elif idle or self._frame is None:
                self._desk.wait(version, IDLE)
                continue
            if self._step(controls):
                drawn += 1

    def _turn(self, controls: Controls) -> None:
        """Show other controls; say what is going on where that takes a while."""
        slow = self._stage.slow(controls)
        if slow:
            self._desk.publish(Shown(controls, self._frame, slow))
        try:
            self._stage.show(controls)
        except CncaError as error:
            self._failed(controls, error)

    def _step(self, controls: Controls) -> bool:
        if not self._stage.ready:
            return False
        try:
            self._frame = self._stage.step()
        except CncaError as error:
            self._failed(controls, error)
            return False
        self._desk.publish(Shown(controls, self._frame, self._stage.complaint))
        return True

    def _failed(self, controls: Controls, error: CncaError) -> None:
        self._stage.complaint = str(error)
        self._desk.publish(Shown(controls, self._frame, str(error)))

    def _save_picture(self) -> Path:
        assert self._frame is not None, "nothing is shown yet"
        return save_picture(self.request.out, self._frame.picture)

    def _save_scene(self) -> Path:
        albedo = self._stage.albedo if self._stage.is_painted else None
        return save_scene(self.request.out, self._stage.scene, albedo)
