"""Between the page's requests and the one thread that renders: controls in, frames out."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

State = TypeVar("State")
Shown = TypeVar("Shown")
Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Published(Generic[Shown]):
    """What the page gets, numbered from 1."""

    number: int
    shown: Shown


class Desk(Generic[State, Shown]):
    """Holds the newest state that was asked for and the newest thing to show."""

    def __init__(self, state: State) -> None:
        self._lock = threading.Condition()
        self._state, self._version = state, 0
        self._published: Published[Shown] | None = None
        self._work: list[tuple[Callable[[], Any], Future[Any]]] = []

    def ask(self, change: Callable[[State, Mapping[str, Any]], State], update: Any) -> State:
        """Change the state; whatever ``change`` raises leaves it as it was."""
        with self._lock:
            self._state = change(self._state, update)
            self._version += 1
            self._lock.notify_all()
            return self._state

    def wait(self, seen: int, timeout: float) -> tuple[State, int]:
        """The state and its version, at once if it is another than ``seen`` or there is work."""
        with self._lock:
            self._lock.wait_for(lambda: self._version != seen or self._work, timeout)
            return self._state, self._version

    def publish(self, shown: Shown) -> None:
        """Hand over the newest thing to show."""
        with self._lock:
            number = self._published.number if self._published else 0
            self._published = Published(number + 1, shown)
            self._lock.notify_all()

    def newer(self, than: int, timeout: float) -> Published[Shown] | None:
        """What was published after number ``than``, as soon as there is such; None after a while.

        A number that is not there yet is one of an earlier server: whatever there is is newer.
        """

        def fresh() -> bool:
            return self._published is not None and self._published.number != than

        with self._lock:
            self._lock.wait_for(fresh, timeout)
            return self._published if fresh() else None

    def do(self, job: Callable[[], Answer], timeout: float = 60.0) -> Answer:
        """Let the rendering thread do something and wait for its answer, or what it raises.

        Raises TimeoutError if it does not come to it.
        """
        answer: Future[Answer] = Future()
        with self._lock:
            self._work.append((job, answer))
            self._lock.notify_all()
        return answer.result(timeout)

    def work(self) -> None:
        """Do what :meth:`do` asks for; the rendering thread calls it between its steps."""
        with self._lock:
            waiting, self._work = self._work, []
        for job, answer in waiting:
            try:
                answer.set_result(job())
            except Exception as error:
                answer.set_exception(error)
