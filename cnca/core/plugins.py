"""A user's own parts: ``module:attribute`` in place of a name that the program knows.

The module is imported as Python imports any other; the folder that the command was started in is
searched last.  The attribute is the part itself, or a class or function that makes it.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

from cnca.core.errors import CncaError, did_you_mean

_SPEC = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")


def is_plugin(spec: str) -> bool:
    """Whether ``spec`` has the form ``module:attribute`` and is no file; names come before it."""
    return _SPEC.fullmatch(spec) is not None and not Path(spec).exists()


def load_plugin(
    spec: str,
    protocol: type[Any],
    *arguments: Any,
    error: type[CncaError] = CncaError,
    **options: Any,
) -> Any:
    """Return the part that ``spec`` names; a class or function is called with the arguments.

    Raises ``error``, in one line, where the module or the attribute is missing, or where what comes
    of it lacks something of ``protocol``.
    """
    module_name, _, attribute = spec.partition(":")
    with _current_folder():
        try:
            target: Any = import_module(module_name)
        except Exception as problem:  # a user's module may fail in any way while it is imported
            raise error(
                f"{spec}: cannot import {module_name} ({type(problem).__name__}: {problem}); "
                "start where it lies, or add its folder to PYTHONPATH"
            ) from problem
        for name in attribute.split("."):
            if not hasattr(target, name):
                hint = did_you_mean(name, dir(target))
                raise error(f"{spec}: {module_name} has no attribute '{name}'{hint}")
            target = getattr(target, name)
        if isinstance(target, type) or not _has_all(target, protocol):
            if not callable(target):
                raise error(f"{spec}: {_lacks(target, protocol)}")
            target = target(*arguments, **options)
    if not _has_all(target, protocol):
        raise error(f"{spec}: {_lacks(target, protocol)}")
    return target


def plugin_file(spec: str) -> Path | None:
    """The file that the module of ``spec`` is imported from, where it has one."""
    with _current_folder():
        try:
            module = find_spec(spec.partition(":")[0])
        except (ImportError, ValueError):
            return None
    return Path(module.origin) if module and module.has_location and module.origin else None


@contextmanager
def _current_folder() -> Iterator[None]:
    """Let modules lie in the folder that a command is started in, as with ``python -m``."""
    sys.path.append("")
    try:
        yield
    finally:
        sys.path.remove("")


def _members(protocol: type[Any]) -> list[str]:
    """The names that a protocol asks for, inherited ones included."""
    names: dict[str, None] = {}
    for base in protocol.__mro__:
        if base not in (Protocol, object) and getattr(base, "_is_protocol", False):
            for name in [*vars(base).get("__annotations__", {}), *vars(base)]:
                if name == "__call__" or not name.startswith("_"):
                    names[name] = None
    return list(names)


def _missing(target: object, protocol: type[Any]) -> list[str]:
    return [name for name in _members(protocol) if not hasattr(target, name)]


def _has_all(target: object, protocol: type[Any]) -> bool:
    return not isinstance(target, type) and not _missing(target, protocol)


def _lacks(target: object, protocol: type[Any]) -> str:
    missing = ", ".join(_missing(target, protocol))
    return f"is no {protocol.__name__}: it lacks {missing}; see cnca.{_home(protocol)}"


def _home(protocol: type[Any]) -> str:
    return f"{protocol.__module__.removeprefix('cnca.')}.{protocol.__name__}"
