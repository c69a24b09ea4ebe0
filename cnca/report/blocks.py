"""What a report is made of: records, each with the template that shows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from markupsafe import Markup


@dataclass(frozen=True)
class Prose:
    """Text, tables and drawings that are HTML already."""

    template: ClassVar[str] = "prose.html"
    html: Markup


@dataclass(frozen=True)
class Picture:
    """One picture: its ``src``, what blind readers hear, and the words below it."""

    src: str
    alt: str
    caption: str = ""


@dataclass(frozen=True)
class Gallery:
    """Pictures side by side."""

    template: ClassVar[str] = "gallery.html"
    pictures: Sequence[Picture]


@dataclass(frozen=True)
class Strip:
    """One texture in the views of a slider."""

    name: str
    pictures: Sequence[Picture]


@dataclass(frozen=True)
class Slider:
    """Two textures in one frame with a divider between them; one of several on the right."""

    template: ClassVar[str] = "slider.html"
    left: Strip
    rights: Sequence[Strip]
    width: int
    """Of a picture in pixels."""
    height: int


@dataclass(frozen=True)
class Turntable:
    """A vehicle seen from all around, frame by frame."""

    template: ClassVar[str] = "turntable.html"
    name: str
    frames: Sequence[str]
    """The ``src`` of each."""


@dataclass(frozen=True)
class Details:
    """What stays folded until someone asks, or prints."""

    template: ClassVar[str] = "details.html"
    summary: str
    html: Markup


Block = Prose | Gallery | Slider | Turntable | Details


@dataclass(frozen=True)
class Part:
    """A section of the page."""

    title: str
    blocks: Sequence[Block]
