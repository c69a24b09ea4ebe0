"""SIGTERM, which schedulers send, ends a command as Ctrl-C does: whatever is half written goes."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from rich.console import Console


class Terminated(KeyboardInterrupt):
    """SIGTERM has come."""


@contextmanager
def resumable(console: Console, advice: str) -> Iterator[None]:
    """After Ctrl-C print ``advice`` and exit with code 130, after SIGTERM with 143."""

    def terminate(number: int, frame: FrameType | None) -> None:
        raise Terminated

    previous = signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    except KeyboardInterrupt as interrupt:
        console.print(f"interrupted; {advice}", soft_wrap=True)
        raise SystemExit(143 if isinstance(interrupt, Terminated) else 130) from None
    finally:
        signal.signal(signal.SIGTERM, previous)
