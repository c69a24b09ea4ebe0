"""Which LLVM the renderer compiles with.

Dr.Jit loads the first libLLVM that it finds, and LLVM 14, 15 and 16 abort the whole process
("Cannot select … fminimum") at the first compiled kernel.  So the library is chosen here, before
Dr.Jit is imported, and handed over in the environment variable ``DRJIT_LIBLLVM_PATH``.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from cnca.core.errors import BackendError

VARIABLE = "DRJIT_LIBLLVM_PATH"
OLDEST = 17
"""The first major version that compiles Mitsuba's kernels instead of aborting."""
REMEDY = f"install LLVM {OLDEST} or newer (Debian, Ubuntu: apt install libllvm19)"

_FOLDERS = (
    "/usr/lib/*-linux-gnu",
    "/usr/lib/llvm-*/lib",
    "/usr/lib64",
    "/usr/lib",
    "/usr/local/lib",
)
# libLLVM.so.19.1, libLLVM-19.so.1, libLLVM-14.0.6.so and libLLVM.so, but not libLLVM-C.so.
_FILE_NAME = re.compile(r"libLLVM(?:-(?P<dash>\d+)[^/]*)?\.so(?:\.(?P<suffix>\d+)\S*)?")


@dataclass(frozen=True)
class Library:
    """One libLLVM on this machine."""

    path: Path
    major: int | None
    """Major version, or None where it cannot be told."""
    refusal: str | None
    """Why the renderer cannot use it, or None if it can."""


def major_from_name(path: Path) -> int | None:
    """Return the major version that the file name states, or None if it states none."""
    match = _FILE_NAME.fullmatch(path.name)
    version = match and (match["dash"] or match["suffix"])
    return int(version) if version else None


def major_from_library(path: Path) -> int:
    """Load ``path`` in a process of its own and ask it for its major version.

    In a process of its own, because two LLVMs in one process clash and a broken library may crash.
    Raises OSError with one line if the library does not load; LLVM before 16 cannot say its version
    and counts as 15.
    """
    command = [sys.executable, "-I", "-c", _ASK_VERSION, str(path)]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    if answer.returncode != 0:
        lines = answer.stderr.strip().splitlines()
        raise OSError(lines[-1] if lines else f"loading ended with code {answer.returncode}")
    return int(answer.stdout)


_ASK_VERSION = """
import ctypes, sys
library = ctypes.CDLL(sys.argv[1])
major = ctypes.c_uint(15)
if hasattr(library, "LLVMGetVersion"):
    library.LLVMGetVersion(ctypes.byref(major), None, None)
print(major.value)
"""


def inspect(path: Path) -> Library:
    """Return what is known about the library at ``path``; never loads it into this process."""
    if not path.is_file():
        return Library(path, None, "no such file")
    major = major_from_name(path.resolve())
    if major is None or major >= OLDEST:
        try:
            major = major_from_library(path)
        except (OSError, subprocess.TimeoutExpired) as error:
            return Library(path, major, f"does not load ({error})")
    refusal = f"LLVM {major} is older than {OLDEST}" if major < OLDEST else None
    return Library(path, major, refusal)


def candidates() -> list[Path]:
    """Return every libLLVM on this machine once, links resolved, newest file name first."""
    found = {path.resolve() for path in _listed_by_loader() if path.exists()}
    for folder in (*_FOLDERS, f"{sys.prefix}/lib"):
        root, pattern = Path("/"), folder.lstrip("/") + "/libLLVM*.so*"
        found.update(path.resolve() for path in root.glob(pattern))
    named = {path for path in found if _FILE_NAME.fullmatch(path.name)}
    return sorted(named, key=lambda path: (-(major_from_name(path) or 0), str(path)))


def survey(paths: Iterable[Path] | None = None) -> list[Library]:
    """Return the verdict on each of ``paths`` (by default all candidates), best first."""
    libraries = [inspect(path) for path in (candidates() if paths is None else paths)]
    return sorted(libraries, key=lambda lib: (lib.refusal is not None, -(lib.major or 0)))


def choose() -> Library:
    """Return the library to render with: the user's ``DRJIT_LIBLLVM_PATH`` or the newest usable.

    Raises BackendError if the user's choice cannot be used or if this machine has none.
    """
    wanted = os.environ.get(VARIABLE)
    if wanted:
        library = inspect(Path(wanted))
        if library.refusal:
            raise BackendError(
                f"{VARIABLE}={wanted}: {library.refusal}; unset {VARIABLE} or {REMEDY}"
            )
        return library
    libraries = survey()
    if libraries and libraries[0].refusal is None:
        return libraries[0]
    refused = "; ".join(f"{lib.path}: {lib.refusal}" for lib in libraries)
    raise BackendError(f"no usable LLVM found ({refused or 'none installed'}); {REMEDY}")


def first_by_name() -> Path | None:
    """What :func:`choose` will take unless it fails to load: told from names alone, so at once."""
    wanted = os.environ.get(VARIABLE)
    named = [Path(wanted)] if wanted else candidates()
    return next((path for path in named if (major_from_name(path.resolve()) or 0) >= OLDEST), None)


def _listed_by_loader() -> list[Path]:
    """The libLLVM files in the dynamic loader's cache, those for this word size only."""
    ldconfig = shutil.which("ldconfig") or shutil.which("ldconfig", path="/sbin:/usr/sbin")
    if ldconfig is None:
        return []
    listing = subprocess.run([ldconfig, "-p"], capture_output=True, text=True, check=False).stdout
    wide = ctypes.sizeof(ctypes.c_void_p) == 8
    entries = re.findall(r"^\s*libLLVM\S*\s+\(([^)]*)\)\s+=>\s+(\S+)$", listing, re.MULTILINE)
    return [Path(path) for flags, path in entries if ("64" in flags) == wide]
