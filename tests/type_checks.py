"""What checks the shapes of every array that passes into and out of ``cnca`` during the tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

from beartype import BeartypeConf, beartype
from jaxtyping import AbstractArray

PACKAGE = Path(__file__).parents[1] / "cnca"
UNCHECKED = ("integrator.py", "panes.py", "bridge.py", "meshes.py", "site.py")
"""Kernels, which Dr.Jit compiles anew from their source: it would compile the check; and the custom
operation, whose gradient is lost when its methods are wrapped. They take no arrays but one, only
Dr.Jit's own types. The meshes of built-in worlds: checks of thousands of calls take longer than
they do."""
UNCHECKED_ROOMS = ("gen", "mi_bridge", "train")
"""Their annotations have not been tried yet, or not all of them are right."""

Function = TypeVar("Function", bound=Callable[..., Any])


def modules() -> list[str]:
    """The modules of the package whose shapes are checked: all but the kernels."""
    files = [file for file in PACKAGE.rglob("*.py") if file.name not in UNCHECKED]
    paths = [file.relative_to(PACKAGE.parent).with_suffix("") for file in files]
    checked = [path for path in paths if path.parts[1] not in UNCHECKED_ROOMS]
    return [".".join(path.parts) for path in checked if path.name != "__init__"]


def check(function: Function) -> Function:
    """beartype for the annotations that hold arrays; mypy looks after all others.

    Fakes of a test have the methods that it calls and no more: mypy, which sees no test, does not
    mind, and beartype would.
    """
    hints = function.__annotations__
    arrays = {name for name, hint in hints.items() if _holds_arrays(hint)}
    if not arrays:
        return function
    for name in hints.keys() - arrays:
        hints[name] = Any
    # A whole number is a float, too (PEP 484), as mypy has it.
    return beartype(function, conf=BeartypeConf(is_pep484_tower=True))


def _holds_arrays(hint: Any) -> bool:
    hint = getattr(hint, "__supertype__", hint)  # of a NewType
    if isinstance(hint, type) and issubclass(hint, AbstractArray):
        return True
    # What a function takes and returns shows itself only when it is called.
    return get_origin(hint) is not Callable and any(map(_holds_arrays, get_args(hint)))
