"""What checks the shapes of every array that passes into and out of ``cnca`` during the tests."""

from __future__ import annotations

import ast
import contextlib
import sys
from collections.abc import Callable, Iterator
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import CodeType, FunctionType, ModuleType
from typing import Any, get_args, get_origin

from beartype import BeartypeConf, beartype
from jaxtyping import AbstractArray, jaxtyped


def install() -> None:
    """Check all modules of the package that are imported from now on."""
    sys.meta_path.insert(0, _Finder())


class _Finder(MetaPathFinder):
    """As jaxtyping's import hook, but what a module imports from elsewhere keeps its bytecode."""

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        if fullname.partition(".")[0] != "cnca":
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(fullname, spec.loader.path)
        return spec


class _Loader(SourceFileLoader):
    """Puts a module's functions and classes through :func:`check`."""

    def get_code(self, fullname: str) -> CodeType:
        tree = ast.parse(self.get_data(self.path), self.path)
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):  # below all other decorators
                node.decorator_list.append(ast.Name("__check__", ast.Load()))
            elif isinstance(node, ast.ClassDef):  # above them: dataclasses make an __init__
                node.decorator_list.insert(0, ast.Name("__check__", ast.Load()))
        return compile(ast.fix_missing_locations(tree), self.path, "exec", dont_inherit=True)

    def exec_module(self, module: ModuleType) -> None:
        vars(module)["__check__"] = check
        super().exec_module(module)


def check(checked: Any) -> Any:
    """jaxtyping and beartype for what takes or returns arrays; mypy looks after all else.

    What has none stays as it is. That saves most of the checks' time, and leaves alone what does
    not bear a wrapper: kernels, which Dr.Jit compiles anew from their source, and methods of its
    custom operations. Nor are other annotations of a function checked: fakes of a test have the
    methods that it calls and no more, which mypy, who sees no test, does not mind.
    """
    if isinstance(checked, type):
        if "__init__" in vars(checked):  # a dataclass's
            checked.__init__ = check(checked.__init__)
        return checked
    if not isinstance(checked, FunctionType) or hasattr(checked, "__wrapped__"):  # done already
        return checked
    arrays = dict(_arrays(checked))
    if not arrays:
        return checked
    checked.__annotations__ = arrays
    # A whole number is a float, too (PEP 484), as mypy has it.
    checked = beartype(checked, conf=BeartypeConf(is_pep484_tower=True))
    return jaxtyped(checked, typechecker=None)


def _arrays(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """The annotations that hold arrays; names that only mypy knows hold none."""
    for name, hint in function.__annotations__.items():
        with contextlib.suppress(NameError, AttributeError):
            hint = eval(hint, function.__globals__) if isinstance(hint, str) else hint
            if _holds_arrays(hint):
                yield name, hint


def _holds_arrays(hint: Any) -> bool:
    hint = getattr(hint, "__supertype__", hint)  # of a NewType
    if isinstance(hint, type) and issubclass(hint, AbstractArray):
        return True
    # What a function takes and returns shows itself only when it is called.
    return get_origin(hint) is not Callable and any(map(_holds_arrays, get_args(hint)))
