"""Tables that a benchmark puts into a document, between two marks that stay there."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cnca.core.errors import RunError
from cnca.core.files import write_text


def markdown(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """The lines of a table."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (headings, *rows)]
    return [lines[0], "|" + "---|" * len(headings), *lines[1:]]


def put(document: Path, name: str, lines: Sequence[str]) -> None:
    """Replace what stands between ``<!-- NAME -->`` and ``<!-- end of NAME -->``.

    Raises RunError where the document lacks these lines.
    """
    start, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"
    before, begun, rest = document.read_text(encoding="utf-8").partition(start)
    _, ended, after = rest.partition(end)
    if not (begun and ended):
        raise RunError(f"{document}: lacks the lines {start.strip()} and {end.strip()}; add them")
    table = "".join(f"{line}\n" for line in lines)
    write_text(document, f"{before}{start}\n{table}\n{end}{after}")
