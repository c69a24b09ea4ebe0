"""A survey's folder: the page with all pictures in it, and the key to their sources."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2

from cnca.core.errors import RunError
from cnca.core.files import replacing, write_text
from cnca.core.manifest import write_json
from cnca.core.pictures import SrgbPicture
from cnca.core.records import as_json
from cnca.jobs.survey.answers import KEY, STORE, Survey, read_survey
from cnca.judge.candidates import named
from cnca.judge.gallery import digest
from cnca.report.webpage import as_jpeg, jpeg_uri, render

QUESTION = "How natural does this vehicle look?"
ENDINGS = (".png", ".jpg", ".jpeg")
SIDE = 960
"""Pixels of a picture's longer side, at most."""
MOST_PICTURES = 300


@dataclass(frozen=True)
class Shown:
    """A picture to be rated; ``name`` is that of its file."""

    source: str
    name: str
    picture: SrgbPicture

    @property
    def key(self) -> str:
        """What stands for it on the page, where its source must not."""
        return digest(self.source, self.name, self.picture)[:12]


def build_survey(images: Sequence[str], out: Path, *, question: str | None = None) -> Survey:
    """Write ``index.html``, ``survey.json`` and ``pictures/`` into ``out``.

    Each of ``images`` is ``[NAME=]PATH``: a folder with one folder for each source, a folder with
    the pictures of one source, or one picture.  ``question`` is by default :data:`QUESTION`.

    Raises:
        RunError: a picture cannot be read, fewer than two sources, or ``out`` holds the answers to
            another survey.
    """
    question = question or QUESTION
    shown = [one for spec in images for one in _read(spec)]
    sources = list(dict.fromkeys(one.source for one in shown))
    if len(sources) < 2:
        raise RunError(f"--images: one source ({sources[0]}); give at least two to compare")
    if len(shown) > MOST_PICTURES:
        raise RunError(f"--images: {len(shown)} pictures; nobody rates over {MOST_PICTURES}")
    keys = {one.key: one for one in shown}
    survey = Survey(
        digest(question, sorted(keys))[:16],
        question,
        {key: one.source for key, one in keys.items()},
        {key: one.name for key, one in keys.items()},
    )
    if (out / KEY).exists() and read_survey(out).id != survey.id and (out / STORE).exists():
        raise RunError(f"{out}: holds answers to another survey; choose another --out")
    for key, one in keys.items():
        with replacing(out / "pictures" / f"{key}.jpg") as temporary:
            temporary.write_bytes(as_jpeg(one.picture))
    content = {
        "survey": survey.id,
        # By key, so that their order says nothing about their sources either.
        "pictures": [{"key": key, "src": jpeg_uri(keys[key].picture)} for key in sorted(keys)],
    }
    page = render(Path(__file__).parent, question=question, content=content, connect="'self'")
    write_text(out / "index.html", page)
    write_json(out / KEY, as_json(survey))
    return survey


def uneven(survey: Survey) -> str | None:
    """The first source that lacks a file which another has: the paper shows all in equal views."""
    names: dict[str, set[str]] = {}
    for key, source in survey.sources.items():
        names.setdefault(source, set()).add(survey.names[key])
    every = set().union(*names.values())
    return next((source for source, own in names.items() if own != every), None)


def _read(spec: str) -> Iterator[Shown]:
    """The pictures of one ``[NAME=]PATH``, folders and files in the order of their names."""
    name, rest = named(spec)
    path = Path(rest)
    folders = sorted(each for each in path.iterdir() if each.is_dir()) if path.is_dir() else []
    if folders and name is None:
        for folder in folders:
            yield from _source(folder.name, folder)
    else:
        yield from _source(name or (path.name if path.is_dir() else path.stem), path)


def _source(source: str, path: Path) -> Iterator[Shown]:
    if not re.fullmatch(r"[\w.+-]+(?: [\w.+-]+)*", source):
        raise RunError(f"--images {path}: give it a name of letters and digits: NAME={path}")
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    files = [file for file in files if file.suffix.lower() in ENDINGS]
    if not files:
        raise RunError(
            f"--images {path}: no {', '.join(ENDINGS)} there; give a picture or a folder"
        )
    for file in files:
        yield Shown(source, file.name, _read_picture(file))


def _read_picture(file: Path) -> SrgbPicture:
    picture = cv2.imread(str(file), cv2.IMREAD_COLOR)
    if picture is None:
        raise RunError(f"{file}: cannot be read as a picture; save it anew as PNG or JPEG")
    shrink = SIDE / max(picture.shape[:2])
    if shrink < 1:
        picture = cv2.resize(picture, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)
