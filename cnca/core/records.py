"""Records as JSON and back: the one place where frozen dataclasses meet files.

A record's fields are the keys of its JSON object.  A key that is no Python name, or one that is
left out where there is nothing to say, is annotated beside the field::

    precision: Annotated[float, Field(alias="AP@0.5")]
    problem: Omitted[str] = None
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import Field, TypeAdapter, ValidationError

from cnca.core.errors import RunError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Kind = TypeVar("Kind")
Omitted = Annotated[Kind | None, Field(exclude_if=lambda value: value is None)]
"""A field whose key is left out of the file where its value is None."""
AGAIN = "run its command again"
"""What to do about a damaged file, where nothing else is said."""


def as_json(record: DataclassInstance) -> dict[str, Any]:
    """The record as JSON holds it: plain dictionaries, lists, texts and numbers."""
    return _adapter(type(record)).dump_python(record, mode="json", by_alias=True)


def from_json(kind: type[Kind], content: object, path: Path, *, advice: str = AGAIN) -> Kind:
    """The record that :func:`as_json` made ``content`` of; keys that it does not know are ignored.

    Raises RunError, which names ``path``, the key and what to do, where the content does not fit.
    """
    try:
        return _adapter(kind).validate_python(content)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(step) for step in first["loc"]) or "the file"
        raise RunError(f"{path}: {where}: {first['msg']}; {advice}") from None


def read_record(kind: type[Kind], path: Path, *, advice: str = AGAIN) -> Kind:
    """A record from a file; raises RunError where it cannot be read or holds something else."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RunError(f"{path}: damaged or not there ({error}); {advice}") from None
    return from_json(kind, content, path, advice=advice)


_ADAPTERS: dict[type, TypeAdapter[Any]] = {}


def _adapter(kind: type) -> TypeAdapter[Any]:
    """Made once for each kind: that takes longer than reading a record."""
    if kind not in _ADAPTERS:
        _ADAPTERS[kind] = TypeAdapter(kind)
    return _ADAPTERS[kind]
