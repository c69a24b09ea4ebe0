"""Loads one malformed file under limits, and says what must not have happened."""

from __future__ import annotations

import faulthandler
import os
import resource
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cnca.core.errors import CncaError

SECONDS = 10
BYTES = 2**31
RUNNING = {"os.exec", "os.fork", "os.posix_spawn", "os.system", "pickle.find_class"}
RUNNING |= {"socket.connect", "subprocess.Popen"}
"""Audit events (PEP 578) of code or a connection that only a file can have asked for."""
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT

_watched: Path | None = None
_offences: list[str] = []


def _audit(event: str, arguments: tuple[Any, ...]) -> None:
    if _watched is None:
        return
    if event in RUNNING:
        _offences.append(f"{event}{arguments!r:.200}")
    elif event == "open" and isinstance(arguments[0], str | bytes) and _writes(*arguments[1:]):
        path = Path(os.fsdecode(arguments[0])).resolve()
        if not path.is_relative_to(_watched) and path != Path(os.devnull):
            _offences.append(f"writes {path}")


def _writes(mode: str | None, flags: int) -> bool:
    return bool(set(mode or "") & set("wax+")) or bool(flags & WRITING)


sys.addaudithook(_audit)  # once for all: a hook cannot be taken away


@contextmanager
def limits(folder: Path) -> Iterator[None]:
    """Audit, stop after ``SECONDS``, and allow ``BYTES`` more of address space."""
    global _watched

    def out_of_time(*_: object) -> None:
        raise TimeoutError(f"took more than {SECONDS} s of the processor")

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    before = signal.signal(signal.SIGPROF, out_of_time)
    _offences.clear()
    _watched = folder.resolve()
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    # Native code hears no signal, and what waits takes no processor.
    faulthandler.dump_traceback_later(30 * SECONDS, exit=True, file=sys.__stderr__)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + BYTES, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
        _watched = None


def survives(load: Callable[[Path], object], files: Mapping[str, bytes]) -> str | None:
    """Load the first of ``files``; return the complaint, or None where it could be used.

    Anything but success or a CncaError of one line is an AssertionError or goes through.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, content in files.items():
            (folder / file).write_bytes(content)
        found: CncaError | None = None
        with limits(folder):
            try:
                load(folder / next(iter(files)))
            except CncaError as error:
                found = error
        assert not _offences, _offences
        assert sorted(path.name for path in folder.iterdir()) == sorted(files)
    if found is None:
        return None
    assert not _hides_lack_of_memory(found), f"asked for too much memory: {found}"
    assert str(found).isprintable(), repr(str(found))  # and so it is one line
    return str(found)


def _hides_lack_of_memory(error: BaseException | None) -> bool:
    while error is not None:
        if isinstance(error, MemoryError) or "alloc" in str(error):
            return True
        error = error.__context__
    return False
