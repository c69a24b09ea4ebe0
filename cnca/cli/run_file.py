"""A YAML file with the flags of a command: ``--config RUN.yaml``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from cnca.core.errors import RunError, did_you_mean


def _read(context: typer.Context, file: Path | None) -> Path | None:
    """Let what the file says stand in for flags that are not given.

    Raises RunError where the file cannot be read or a key in it is no flag of the command.
    """
    if file is not None:
        flags = {flag.name or "": flag for flag in context.command.params if flag.name != "config"}
        given = _flags(file)
        for key, value in given.items():
            if key not in flags:
                hint = did_you_mean(key, flags)
                raise RunError(f"{file}: {key}: not a flag of cnca {context.info_name}{hint}")
            if getattr(flags[key], "multiple", False) and not isinstance(value, list):
                given[key] = [value]  # a repeatable flag, given once
        context.default_map = given
    return file


def _flags(file: Path) -> dict[str, Any]:
    """Names of flags, with underscores, and their values."""
    given: dict[str, Any] = {}
    for key, value in _content(file).items():
        name = str(key).replace("-", "_")
        if name in given:
            raise RunError(f"{file}: {key}: stands there twice, with - and with _; keep one")
        given[name] = value
    return given


def _content(file: Path) -> dict[Any, Any]:
    import yaml

    from cnca.core.yaml_text import read_yaml

    try:
        content = read_yaml(file, RunError)
    except (OSError, yaml.YAMLError) as error:
        reason = " ".join(str(error).split())
        raise RunError(f"{file}: cannot be read as YAML: {reason}") from None
    if not isinstance(content, dict):
        raise RunError(f"{file}: a run file maps flags to values, got {content!r:.60}")
    return content


Config = Annotated[
    Path | None,
    typer.Option(
        "--config",
        callback=_read,
        is_eager=True,
        help="YAML file with flags, such as seed: 1; flags that are given override it.",
    ),
]
