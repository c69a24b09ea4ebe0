"""The scene files that ship with the package: ``builtin:NAME``."""

from __future__ import annotations

from pathlib import Path

from cnca.core.errors import SceneError, did_you_mean

FOLDER = Path(__file__).parents[1] / "assets" / "scenes"
"""In a checkout a link to ``scenes/``."""
PREFIX = "builtin:"


def scene_file(path: str | Path) -> Path:
    """The file that ``builtin:NAME`` stands for; any other path as it is.

    Raises SceneError for a name that does not ship.
    """
    name = str(path)
    if not name.startswith(PREFIX):
        return Path(path)
    shipped_file = FOLDER / f"{name.removeprefix(PREFIX)}.yaml"
    if not shipped_file.is_file():
        names = [PREFIX + shipped_file.stem for shipped_file in sorted(FOLDER.glob("*.yaml"))]
        raise SceneError(f"scene '{name}': there is {', '.join(names)}{did_you_mean(name, names)}")
    return shipped_file
