"""Text files as people have them: byte order marks, line ends of every system, other encodings."""

from __future__ import annotations

import codecs
from pathlib import Path

from cnca.core.errors import CncaError

MARKS = (  # UTF-32's little-endian mark begins with that of UTF-16
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
"""Byte order marks and what they say."""

BEGINNING = 32
"""Bytes by which UTF-16 without a mark is known: text begins with ASCII in all our files."""


def decode_text(data: bytes, name: str | Path, error: type[CncaError] = CncaError) -> str:
    """Text whose lines end with a line feed; in UTF-8 unless a byte order mark says otherwise.

    UTF-16 is also known without one, by the zeros in every second of its first bytes.

    Raises ``error``, in which ``name`` stands, with the first byte that is not of that encoding.
    """
    mark, encoding = next(((m, e) for m, e in MARKS if data.startswith(m)), _unmarked(data))
    try:
        text = data[len(mark) :].decode(encoding)
    except UnicodeDecodeError as problem:
        at = problem.start + len(mark)
        line = data.count(b"\n", 0, at) + 1
        raise error(
            f"{name}: byte {at} (0x{data[at]:02x}, line {line}) is not {encoding.upper()}; "
            "save the file as UTF-8"
        ) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _unmarked(data: bytes) -> tuple[bytes, str]:
    even, odd = data[:BEGINNING:2], data[1:BEGINNING:2]
    if not any(odd) and all(even) and odd:
        return b"", "utf-16-le"
    if not any(even) and all(odd) and odd:
        return b"", "utf-16-be"
    return b"", "utf-8"


def decode_names(data: bytes) -> str:
    """Text of which only names are not ASCII; it is always read, and no two names become one.

    What is neither UTF-8 nor marked is taken as Latin-1, which has a character for every byte.
    """
    try:
        return decode_text(data, "")
    except CncaError:
        return data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")


def read_text(path: str | Path, error: type[CncaError] = CncaError) -> str:
    """The text of a file; raises OSError, or ``error`` as :func:`decode_text` does."""
    return decode_text(Path(path).read_bytes(), path, error)
