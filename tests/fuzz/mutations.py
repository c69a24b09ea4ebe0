"""What may happen to a file: bytes that change, and parts of its structure that do."""

from __future__ import annotations

import copy
import json
import re
import struct
from typing import Any

from hypothesis import strategies as st

NUMBERS = ("nan", "-inf", "1e999", "0", "-1", "-0.0", "1e-320", "65537", "4294967296", "9" * 25)
WORDS = (
    "",
    "null",
    "true",
    "[]",
    "{}",
    "[[[]]]",
    "../../x",
    "/etc/passwd",
    "\x00",
    "ß🚗",
    "a" * 3000,
)
VALUES: tuple[Any, ...] = (
    *(None, True, -1, 0, 3, 2**31, 2**63, 10**30, 1e308, float("nan"), 0.5),
    *("", "../../x", "data:,", "SCALAR", "U8", [], [0], [-1, 2], [2**40, 2**40], {}, {"a": [None]}),
)
"""For structured files."""


@st.composite
def damaged(draw: st.DrawFn, content: bytes) -> bytes:
    """Some bytes replaced, removed, repeated or put in; or the end cut off."""
    changed = bytearray(content)
    for _ in range(draw(st.integers(1, 6))):
        at = draw(st.integers(0, max(len(changed) - 1, 0)))
        length = draw(st.integers(1, 16))
        match draw(st.sampled_from(("replace", "put in", "remove", "repeat", "cut"))):
            case "replace":
                changed[at : at + length] = draw(st.binary(min_size=length, max_size=length))
            case "put in":
                changed[at:at] = draw(st.binary(min_size=1, max_size=length))
            case "remove":
                del changed[at : at + length]
            case "repeat":
                changed[at:at] = changed[at : at + length] * draw(st.sampled_from((1, 7, 200)))
            case "cut":
                del changed[at:]
    return bytes(changed)


@st.composite
def rewritten(draw: st.DrawFn, content: bytes, extra: tuple[str, ...] = ()) -> bytes:
    """Numbers, words and lines of a text that others stand in for."""
    lines = content.decode().splitlines()
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(lines) - 1))
        match draw(st.sampled_from(("number", "word", "line", "remove", "repeat", "swap"))):
            case "number" | "word" as kind:
                pattern = r"[-+]?\d[\d.e]*" if kind == "number" else r"[A-Za-z_]\w*"
                found = list(re.finditer(pattern, lines[at]))
                if found:
                    one = draw(st.sampled_from(found))
                    new = draw(st.sampled_from(NUMBERS + WORDS))
                    lines[at] = lines[at][: one.start()] + new + lines[at][one.end() :]
            case "line":
                lines.insert(at, draw(st.sampled_from(extra + WORDS)))
            case "remove":
                del lines[at]
            case "repeat":
                lines[at:at] = [lines[at]] * draw(st.sampled_from((1, 50)))
            case "swap":
                other = draw(st.integers(0, len(lines) - 1))
                lines[at], lines[other] = lines[other], lines[at]
        lines = lines or [""]
    return "\n".join(lines).encode()


@st.composite
def restructured(draw: st.DrawFn, tree: Any) -> Any:
    """A tree of dictionaries and lists with a few values replaced, removed or renamed."""
    tree = json.loads(json.dumps(tree))
    for _ in range(draw(st.integers(1, 3))):
        places = list(_places(tree))
        if not places:
            break
        parent, key = draw(st.sampled_from(places))
        if draw(st.integers(0, 4)):
            # A copy, or a later change would go into all cases to come.
            parent[key] = copy.deepcopy(draw(st.sampled_from(VALUES)))
        else:
            del parent[key]
    return tree


def _places(tree: Any) -> Any:
    """Every (container, key) of the tree."""
    keys = (
        list(tree) if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else ()
    )
    for key in keys:
        yield tree, key
        yield from _places(tree[key])


@st.composite
def safetensors(draw: st.DrawFn, content: bytes) -> bytes:
    """Another header, of the right length, before the same tensors."""
    (length,) = struct.unpack("<Q", content[:8])
    header = draw(restructured(json.loads(content[8 : 8 + length])))
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + content[8 + length :]


@st.composite
def glb(draw: st.DrawFn, content: bytes) -> bytes:
    """Another JSON chunk, of the right length, before the same binary one."""
    (length,) = struct.unpack("<I", content[12:16])
    text = json.dumps(draw(restructured(json.loads(content[20 : 20 + length])))).encode()
    text += b" " * (-len(text) % 4)
    rest = content[20 + length :]
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    return head + text + rest


@st.composite
def json_text(draw: st.DrawFn, content: bytes) -> bytes:
    """Another tree in the same notation."""
    return json.dumps(draw(restructured(json.loads(content)))).encode()
