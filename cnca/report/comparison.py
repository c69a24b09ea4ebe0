"""The parts of several attacks that differ in one thing: ``tradeoff``, ``prompts``, auto τ."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cnca.report.attack import before_after
from cnca.report.blocks import Gallery, Part, Picture, Prose
from cnca.report.markdown import as_html
from cnca.report.webpage import file_uri

TITLES = {
    "tradeoff": "Naturalness against strength",
    "prompts": "Prompts compared",
    "auto_tau": "Search for the strongest bound",
}


def comparison_parts(folder: Path, content: Mapping[str, Any], *, name: str) -> list[Part]:
    """The table, the textures and a slider through all runs of ``name``.json."""
    runs = []
    for row in content["rows"]:
        own = folder / row["folder"]
        summary = json.loads((own / "summary.json").read_text(encoding="utf-8"))
        runs.append((row["label"], own, summary))
    textures = [
        Picture(file_uri(own / "texture.png"), f"texture, {label}", label) for label, own, _ in runs
    ]
    numbers = (folder / f"{name}.md").read_text(encoding="utf-8")
    return [
        Part(TITLES[name], [Prose(as_html(numbers))]),
        Part("Textures", [Gallery(textures)]),
        Part("Before and after", [before_after(runs)]),
    ]
