"""A survey's folder: the page with all pictures in it, and the key to their sources."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2

from cnca.core.errors import RunError
from cnca.core.files import replacing, write_text
from cnca.core.manifest import hashes, write_json
from cnca.core.pictures import SrgbPicture
from cnca.core.records import as_json
from cnca.core.run_folder import RunFolder
from cnca.jobs.survey.answers import KEY, STORE, Survey
from cnca.judge.candidates import named
from cnca.judge.gallery import digest
from cnca.report.webpage import as_jpeg, jpeg_uri, render

QUESTION = "How natural does this vehicle look?"
ENDINGS = (".png", ".jpg", ".jpeg")
SIDE = 960
"""Pixels of a picture's longer side, at most."""
MOST_PICTURES = 300


@dataclass(frozen=True)
class Rated:
    """A picture to be rated, from one of the sources that are compared."""

    source: str
    file: Path
    picture: SrgbPicture

    @property
    def name(self) -> str:
        """Of its file: sources that are compared in equal views share their names."""
        return self.file.name

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
            another survey: what differs is named.
    """
    question = question or QUESTION
    pictures = [picture for spec in images for picture in _read(spec)]
    sources = list(dict.fromkeys(picture.source for picture in pictures))
    if len(sources) < 2:
        raise RunError(f"--images: one source ({sources[0]}); give at least two to compare")
    if len(pictures) > MOST_PICTURES:
        raise RunError(f"--images: {len(pictures)} pictures; nobody rates over {MOST_PICTURES}")
    _claim(out, {"question": question, "images": list(images)}, pictures)
    keys = {picture.key: picture for picture in pictures}
    survey = Survey(
        digest(question, sorted(keys))[:16],
        question,
        {key: picture.source for key, picture in keys.items()},
        {key: picture.name for key, picture in keys.items()},
    )
    for key, picture in keys.items():
        with replacing(out / "pictures" / f"{key}.jpg") as temporary:
            temporary.write_bytes(as_jpeg(picture.picture))
    content = {
        "survey": survey.id,
        # By key, so that their order says nothing about their sources either.
        "pictures": [{"key": key, "src": jpeg_uri(keys[key].picture)} for key in sorted(keys)],
    }
    page = render(Path(__file__).parent, question=question, content=content, connect="'self'")
    write_text(out / "index.html", page)
    write_json(out / KEY, as_json(survey))
    return survey


def _claim(out: Path, request: Mapping[str, Any], pictures: Sequence[Rated]) -> None:
    """Say what the survey is made from; once there are answers, they keep it as it is."""
    folder, inputs = RunFolder(out, "survey"), hashes(picture.file for picture in pictures)
    if (out / STORE).exists():
        folder.claim(request, inputs, resume=True)
    else:
        folder.renew(request, inputs)


def uneven(survey: Survey) -> str | None:
    """The first source that lacks a file which another has: the paper shows all in equal views."""
    names: dict[str, set[str]] = {}
    for key, source in survey.sources.items():
        names.setdefault(source, set()).add(survey.names[key])
    all_names = set().union(*names.values())
    return next((source for source, of_source in names.items() if of_source != all_names), None)


def _read(spec: str) -> Iterator[Rated]:
    """The pictures of one ``[NAME=]PATH``, folders and files in the order of their names."""
    name, rest = named(spec)
    path = Path(rest)
    folders = sorted(inner for inner in path.iterdir() if inner.is_dir()) if path.is_dir() else []
    if folders and name is None:
        for folder in folders:
            yield from _source(folder.name, folder)
    else:
        yield from _source(name or (path.name if path.is_dir() else path.stem), path)


def _source(source: str, path: Path) -> Iterator[Rated]:
    if not re.fullmatch(r"[\w.+-]+(?: [\w.+-]+)*", source):
        raise RunError(f"--images {path}: give it a name of letters and digits: NAME={path}")
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    files = [file for file in files if file.suffix.lower() in ENDINGS]
    if not files:
        raise RunError(
            f"--images {path}: no {', '.join(ENDINGS)} there; give a picture or a folder"
        )
    for file in files:
        yield Rated(source, file, _read_picture(file))


def _read_picture(file: Path) -> SrgbPicture:
    picture = cv2.imread(str(file), cv2.IMREAD_COLOR)
    if picture is None:
        raise RunError(f"{file}: cannot be read as a picture; save it anew as PNG or JPEG")
    shrink = SIDE / max(picture.shape[:2])
    if shrink < 1:
        picture = cv2.resize(picture, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)
