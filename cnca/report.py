"""The report of a run: one HTML page beside its pictures."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt

from cnca.files import replacing

MEANING = {
    "before": "plain paint",
    "prompt": "prompt texture with F_adv = 0",
    "random": "random blocks (control)",
    "shuffled": "camouflage, shuffled in blocks (control: same palette)",
    "after": "camouflage",
}

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>CNCA: {prompt}</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; }}
img {{ max-width: 100%; }} table {{ border-collapse: collapse; }}
td, th {{ padding: .3rem .8rem; border-bottom: 1px solid #8886; text-align: left; }}
.textures img {{ width: 48%; }}
:root {{ color-scheme: light dark; }}
</style></head><body>
<h1>“{prompt}” against {detector}</h1>
<p>Scene {scene}; {steps} steps, τ = {tau}, seed {seed}. Scores are means over {views} held-out
views: the highest confidence among detections of the class that overlap the vehicle's box by at
least one half.</p>
<table><tr><th>texture</th><th>detection score</th><th>AP@0.5</th></tr>
{rows}</table>
<p>Camouflage over shuffled control: <b>{ratio:.2f}</b>. A loud texture alone can fool a small
detector; only what goes beyond the controls is the attack.</p>
<h2>Before and after</h2><img src="before_after.png" alt="views before and after, with boxes">
<h2>Texture</h2><p>Left the prompt alone, right with F_adv.</p>
<p class="textures"><img src="texture_prompt.png" alt="prompt texture">
<img src="texture.png" alt="camouflage"></p>
<h2>Steps</h2><img src="curve.png" alt="loss and detection score over the steps">
<p>This serves to measure and harden detectors. Configuration and hashes: manifest.json.</p>
</body></html>
"""


def write_report(out: Path, request: dict[str, Any], summary: dict[str, Any]) -> None:
    """Write ``curve.png`` and ``report.html`` into the run folder ``out``."""
    _plot(out)
    settings = request["settings"]
    rows = "\n".join(
        f"<tr><td>{meaning}</td><td>{summary[f'score_{name}']:.3f}</td>"
        f"<td>{summary['AP@0.5'][name]:.3f}</td></tr>"
        for name, meaning in MEANING.items()
    )
    page = _PAGE.format(
        prompt=escape(settings["prompt"]),
        detector=escape(request["detector"]),
        scene=escape(request["scene"]),
        steps=settings["steps"],
        tau=settings["tau"],
        seed=settings["seed"],
        views=summary["held_out_views"],
        rows=rows,
        ratio=summary["ratio_to_shuffled"],
    )
    with replacing(out / "report.html") as temporary:
        temporary.write_text(page, encoding="utf-8")


def _plot(out: Path) -> None:
    lines = (out / "log.jsonl").read_text(encoding="utf-8").splitlines()
    records = [json.loads(line) for line in lines]
    steps = [record["step"] for record in records]
    figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
    axes.plot(steps, [record["D_s"] for record in records], label="mean of max $D_s$")
    axes.plot(steps, [record["loss_adv"] for record in records], label="$L_{adv}$", alpha=0.6)
    axes.set(xlabel="step", ylim=(0, None))
    axes.legend()
    with replacing(out / "curve.png") as temporary:
        figure.savefig(temporary, dpi=120)
    plt.close(figure)
