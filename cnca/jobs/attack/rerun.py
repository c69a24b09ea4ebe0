"""A run once more, from nothing but its manifest."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter, ValidationError
from rich.console import Console

from cnca.attack.settings import Settings
from cnca.core.errors import RunError, did_you_mean
from cnca.core.images import read_texture_srgb
from cnca.core.manifest import Manifest, hashes
from cnca.core.run_folder import refuse_changed_inputs
from cnca.jobs.attack.request import JOB, Request
from cnca.jobs.attack.run import run

ADVICE = "bring it back, and start from the folder in which that run was started"


@dataclass(frozen=True)
class Rerun:
    """The outcome of a run that was repeated."""

    out: Path
    other_versions: dict[str, tuple[str, str]]
    """Package → its version then and now, where they differ."""
    difference: float | None
    """Largest difference of the two textures in sRGB, 0 to 1; None where the first has none."""


def rerun(manifest: Path, out: Path, console: Console) -> Rerun:
    """Repeat the run of ``manifest`` into ``out``.

    Paths in it start where its run was started.  With the same versions on the same machine and one
    renderer thread the texture is the same to the bit; several threads add up in varying order.

    Raises:
        RunError: no manifest of ``cnca optimize``, or a file that the run read is gone or changed.
    """
    content = Manifest.read(manifest)
    request = read_request(manifest, content, out)
    here = [Path(name) for name in content.inputs if Path(name).is_file()]
    refuse_changed_inputs(content.inputs, hashes(here), manifest, advice=ADVICE)
    run(request, console)
    first = manifest.with_name("texture.png")
    difference = None
    if first.exists():
        textures = [read_texture_srgb(path) for path in (first, out / "texture.png")]
        difference = float(np.abs(textures[0] - textures[1]).max())
    return Rerun(out, content.other_versions(), difference)


def read_request(manifest: Path, content: Manifest, out: Path) -> Request:
    """The request that :meth:`cnca.jobs.attack.request.Request.as_dict` wrote, for another folder.

    Raises RunError for keys and values that are not a request's.
    """
    request = content.request
    if content.job not in ("", JOB) or not isinstance(request.get("settings"), dict):
        raise RunError(f"{manifest}: not the manifest of a cnca optimize")
    for part, kind in ((request, Request), (request["settings"], Settings)):
        known = [field.name for field in fields(kind)]
        for key in part:
            if key not in known:
                raise RunError(f"{manifest}: {key}: unknown key{did_you_mean(key, known)}")
    try:
        return TypeAdapter(Request).validate_python({**request, "out": out})
    except ValidationError as error:
        problem = error.errors()[0]
        where = ".".join(str(part) for part in problem["loc"])
        raise RunError(f"{manifest}: {where}: {problem['msg']}") from None
