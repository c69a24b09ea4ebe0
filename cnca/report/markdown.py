"""Markdown of our own tables as HTML."""

from __future__ import annotations

import re
from collections.abc import Sequence

from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup


def as_html(text: str) -> Markup:
    """CommonMark with tables; HTML in it is shown, not obeyed.

    Tables wider than the page scroll in a box of their own; their first column names the rows.
    """
    reader = MarkdownIt("commonmark", {"html": False}).enable("table")
    # Intervals stay on one line.
    tokens = reader.parse(re.sub(r"(\[[^\s,]+), (\S+\])", "\\1,\N{NO-BREAK SPACE}\\2", text))
    _name_rows(tokens)
    pieces, heading = [], ""
    for i, token in enumerate(tokens):
        if token.type == "table_open":
            box = '<div class="wide" role="region" tabindex="0" aria-label="{}">'
            pieces.append(Markup(box).format(heading or "table"))
        if token.type == "inline" and tokens[i - 1].type == "heading_open":
            heading = token.content
        pieces.append(Markup(reader.renderer.render([token], reader.options, {})))
        if token.type == "table_close":
            pieces.append(Markup("</div>"))
    return Markup("").join(pieces)


def _name_rows(tokens: Sequence[Token]) -> None:
    """Make the first cell of each row its heading."""
    for i, token in enumerate(tokens):
        if token.type == "th_open":
            token.attrSet("scope", "col")
        if token.type == "tr_open" and tokens[i + 1].type == "td_open":
            tokens[i + 1].tag = tokens[i + 3].tag = "th"
            tokens[i + 1].attrSet("scope", "row")
