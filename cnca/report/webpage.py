"""HTML pages that hold all they need: style, program and pictures; browsers fetch nothing."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from cnca.core.pictures import SrgbPicture

QUALITY = 90
"""Of JPEG, with full resolution of colors."""


SHELL = Path(__file__).parent / "shell"
"""Folder of ``shell.html``, which every page extends."""


def render(
    folder: Path,
    /,
    *,
    connect: str = "'none'",
    programs: Sequence[Path] = (),
    **content: Any,
) -> str:
    """Fill ``page.html`` of ``folder`` with ``content``, ``page.css`` and ``page.js``.

    ``programs`` are further ones, which that one uses.  Whatever is not :class:`Markup` is
    escaped.  The policy lets these very programs run, no others, and connect to nothing but
    ``connect``.
    """
    loader = FileSystemLoader([folder, SHELL])
    pages = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    files = *programs, folder / "page.js"
    script = "\n".join(file.read_text(encoding="utf-8") for file in files)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return pages.get_template("page.html").render(
        content,
        style=Markup((folder / "page.css").read_text(encoding="utf-8")),
        script=Markup(script),
        policy=(
            "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
            f"script-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'; "
            f"connect-src {connect}"
        ),
    )


def as_jpeg(picture: SrgbPicture) -> bytes:
    """The picture as a JPEG without any metadata."""
    settings = [
        *(cv2.IMWRITE_JPEG_QUALITY, QUALITY),
        *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
    ]
    _, encoded = cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), settings)
    return encoded.tobytes()


def jpeg_uri(picture: SrgbPicture) -> str:
    """The picture as the address of an ``img``."""
    return f"data:image/jpeg;base64,{base64.b64encode(as_jpeg(picture)).decode()}"


def file_uri(path: Path) -> str:
    """A PNG or JPEG file as the address of an ``img``."""
    kind = "png" if path.suffix.lower() == ".png" else "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"
