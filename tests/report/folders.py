"""Run folders in which every picture has a color of its own: a browser shows which it is."""

import json
from pathlib import Path

import numpy as np

from cnca.core.pictures import side_by_side, write_png
from cnca.report import MEANING

RED, BLUE, GREEN, WHITE = (220, 0, 0), (0, 0, 220), (0, 160, 0), (255, 255, 255)
SIDE, VIEWS = 96, 8
SCORES = {
    name: [round(0.9 - 0.1 * k + 0.01 * view, 4) for view in range(VIEWS)]
    for k, name in enumerate(MEANING)
}
SUMMARY = {
    "prompt": "zebra & <script>document.title = 'obeyed'</script>",
    "detector": "builtin",
    "scene": "scene.yaml",
    "held_out_views": VIEWS,
    "ratio_to_shuffled": 0.5,
    "AP@0.5": dict.fromkeys(MEANING, 1.0),
    "scores_per_view": SCORES,
    **{f"score_{name}": float(np.mean(own)) for name, own in SCORES.items()},
}
MANIFEST = {
    "request": {"scene": "scene.yaml", "settings": {"prompt": "zebra", "tau": 1.0, "efr": None}},
    "versions": {"cnca": "0.1.0"},
    "inputs": {"scene.yaml": "8414b63cf3a1af00d8508863c3913dbb0987f89744e472ed7c9aab30a2fc1004"},
}


def flat(color) -> np.ndarray:
    return np.full((SIDE, SIDE, 3), color, np.uint8)


def attack(folder: Path, after=BLUE) -> Path:
    """A ``cnca optimize``: plain paint is red, save in the second view, where it is white."""
    steps = [
        {"step": step, "loss_adv": 3.0 / step, "D_s": 0.9 / step, "seconds_generate": 1.0}
        | {"seconds_render": 2.0, "seconds_detect": 0.5, "seconds_backward": 4.0}
        | {"seconds_total": 8.0}
        for step in range(1, 5)
    ]
    folder.mkdir(parents=True)
    (folder / "log.jsonl").write_text("".join(json.dumps(step) + "\n" for step in steps))
    (folder / "summary.json").write_text(json.dumps(SUMMARY))
    (folder / "manifest.json").write_text(json.dumps(MANIFEST))
    tiles = [flat(c) for c in (RED, WHITE, RED, RED, after, GREEN, after, after)]
    write_png(folder / "before_after.png", side_by_side(tiles, columns=4))
    for name in ("texture.png", "texture_prompt.png"):
        write_png(folder / name, flat(after))
    return folder


def evaluation(folder: Path) -> Path:
    """A ``cnca evaluate`` of one texture: normal is red, random green, the texture blue."""
    rows = {"normal": RED, "random": GREEN, "my prompt": WHITE, "my": BLUE}
    for row, color in rows.items():
        own = folder / "pictures" / "sunny" / row.replace(" ", "~")
        own.mkdir(parents=True)
        pictures = np.stack([flat(color).transpose(2, 0, 1)] * 3)
        for weather in range(2):
            np.savez(own / f"weather{weather:02d}.npz", key="", pictures=pictures)
    (folder / "results.json").write_text(json.dumps({"scenes": ["sunny"], "rows": list(rows)}))
    (folder / "results.md").write_text(
        "# Evaluation\n\n## AP\n\n| texture | builtin |\n| --- | --- |\n"
        + "".join(f"| {row} | 0.900 [0.850, 0.950] |\n" for row in rows)
        + "\n## Pictures\n\n![sections.png](sections.png)\n"
    )
    write_png(folder / "sections.png", np.full((100, 900, 3), 255, np.uint8))
    return folder


def tradeoff(folder: Path) -> Path:
    """Two attacks, blue and green."""
    rows = [{"label": "τ = 0.1", "folder": "weak"}, {"label": "τ = 1", "folder": "strong"}]
    attack(folder / "weak", BLUE)
    attack(folder / "strong", GREEN)
    (folder / "tradeoff.json").write_text(json.dumps({"rows": rows}))
    (folder / "tradeoff.md").write_text("| τ | score |\n|---|---|\n| τ = 0.1 | 0.9 |\n")
    return folder


def prices(folder: Path) -> Path:
    """A ``cnca accuracy``."""
    folder.mkdir()
    (folder / "accuracy.json").write_text("{}")
    (folder / "accuracy.md").write_text(
        "A view.\n\n| rung | error |\n|---|---|\n| **1 spp** | 9% |\n"
    )
    write_png(folder / "accuracy.png", flat(WHITE))
    return folder
