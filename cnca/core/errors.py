"""What a user can get wrong, as one family of errors.

The command line prints the message of a :class:`CncaError` as one line and exits with code 2.
Anything else that is raised is a bug and shows its traceback.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class CncaError(Exception):
    """Bad input: the message says in one line what is wrong, where, and what to do."""

    def __init__(self, message: str) -> None:
        """What a message quotes of a file may hold anything: only what can be printed stays."""
        printable = (c if c.isprintable() else repr(c)[1:-1] for c in " ".join(message.split()))
        super().__init__("".join(printable))


class SceneError(CncaError):
    """A scene file or a value in it cannot be used."""


class MeshError(CncaError):
    """A vehicle mesh cannot be used."""


class TextureError(CncaError):
    """A texture or mask cannot be used."""


class DetectorError(CncaError):
    """A detector file or specification cannot be used."""


class GeneratorError(CncaError):
    """A diffusion pipeline, prompt or adversarial feature cannot be used."""


class RunError(CncaError):
    """An output folder or an interrupted run cannot be used."""


class BackendError(CncaError):
    """The renderer cannot work on this machine (no usable LLVM, no variant)."""


class NonFiniteError(CncaError):
    """A computation produced NaN or infinity; the message names where it happened."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the known word nearest to ``word``, or ``""``."""
    nearest = difflib.get_close_matches(word, list(known), n=1, cutoff=0.5)
    return f"; did you mean '{nearest[0]}'?" if nearest else ""
