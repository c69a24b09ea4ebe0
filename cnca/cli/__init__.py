"""The ``cnca`` command.  Commands import what they need inside, so that ``--help`` is instant."""

from __future__ import annotations

import atexit
import gc
import os
import sys

from cnca.cli import attack, data, evaluate, render, report, style, train, vehicle  # noqa: F401
from cnca.cli.app import app
from cnca.cli.examples import add_examples
from cnca.core.errors import CncaError

add_examples(app)


def main() -> None:
    """Run the command line; bad input ends with one line on stderr and exit code 2."""
    # torch's idle threads spin by default, on the cores that Dr.Jit's threads then need.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    # The libraries' million objects live to the end: looking for garbage among them took a second.
    gc.set_threshold(10_000)
    atexit.register(gc.freeze)
    try:
        app(prog_name="cnca")
    except Exception as error:
        message = _user_message(error)
        if message is None:
            raise
        print(f"error: {message}", file=sys.stderr)
        raise SystemExit(2) from None


def _user_message(error: Exception) -> str | None:
    """The one line to show for ``error``, or None if it is a bug that deserves its traceback."""
    if isinstance(error, CncaError):
        return " ".join(str(error).split())
    if _is_out_of_memory(error):
        reason = (str(error) or type(error).__name__).splitlines()[0]
        advice = "take smaller or fewer pictures at once, or cnca --memory-budget 100MiB …"
        return f"not enough memory ({reason}); {advice}"
    pydantic = sys.modules.get("pydantic")  # who has not imported it cannot have raised its error
    if pydantic is not None and isinstance(error, pydantic.ValidationError):
        places = (
            f"{'.'.join(map(str, problem['loc']))}: {problem['msg']}, got {problem['input']!r}"
            for problem in error.errors()
        )
        return f"{error.title}: " + "; ".join(places)
    return None


def _is_out_of_memory(error: BaseException | None) -> bool:
    """Whether Python, numpy, torch or Dr.Jit, which wraps it, found no more memory."""
    words = "out of memory", "can't allocate memory"
    while error is not None:
        if isinstance(error, MemoryError) or any(word in str(error) for word in words):
            return True
        error = error.__cause__
    return False
