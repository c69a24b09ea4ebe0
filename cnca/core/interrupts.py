"""SIGTERM, which schedulers send, ends a command as Ctrl-C does: half-written files are removed."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from rich.console import Console


class Terminated(KeyboardInterrupt):
    """SIGTERM has been received."""


def _interrupt(error: BaseException | None) -> KeyboardInterrupt | None:
    """The interrupt behind an error: Dr.Jit makes a RuntimeError of one that hits its callbacks."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__
    return error


@contextmanager
def resumable(console: Console, advice: str) -> Iterator[None]:
    """After Ctrl-C print ``advice`` and exit with code 130, after SIGTERM with 143."""

    def terminate(_number: int, _frame: FrameType | None) -> None:
        raise Terminated

    previous = signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    except BaseException as error:
        interrupt = _interrupt(error)
        if interrupt is None:
            raise
        console.print(f"interrupted; {advice}", soft_wrap=True)
        raise SystemExit(143 if isinstance(interrupt, Terminated) else 130) from None
    finally:
        signal.signal(signal.SIGTERM, previous)
