"""All numbers of an evaluation, with their intervals, as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from cnca.judge.bootstrap import resample
from cnca.judge.candidates import NORMAL, controls_of
from cnca.judge.sections import AXES, parameters, sections
from cnca.judge.stage import Eye, Stage
from cnca.judge.verdict import MEASURES, Seen, by_section, measure_all, word_for


def judge(
    stages: Sequence[Stage],
    eyes: Sequence[Eye],
    seen: dict[str, dict[str, Seen]],
    candidates: Sequence[str],
    seed: int,
) -> dict[str, Any]:
    """All numbers with their intervals, as JSON."""
    boxes = torch.cat([stage.boxes() for stage in stages])
    table = [row for stage in stages for row in parameters(stage.shots)]
    counts = [len(stage.places) for stage in stages]
    weights = resample(counts, seed=seed)
    measured = measure_all(seen, boxes, weights, normal=NORMAL)
    results: dict[str, Any] = {
        "views": len(boxes),
        "interval": f"95 %, percentile bootstrap over views, {len(weights) - 1} resamples",
        "seed": seed,
        "scenes": [stage.name for stage in stages],
        "detectors": [eye.name for eye in eyes],
        "candidates": list(candidates),
        "rows": list(seen),
        "measures": MEASURES,
        "all": _as_dicts(measured),
        "comparisons": _compare(measured, list(candidates), list(seen), len(boxes)),
        "sections": _sections(seen, boxes, weights, table),
        **{key: note for stage in stages for key, note in stage.notes.items()},
    }
    if len(stages) > 1:
        results["by_scene"] = {}
        for k, stage in enumerate(stages):
            own = slice(sum(counts[:k]), sum(counts[: k + 1]))
            part = {
                row: {eye: Seen(each.detections[own], each.class_names) for eye, each in by.items()}
                for row, by in seen.items()
            }
            judged = measure_all(part, boxes[own], weights[:, own], normal=NORMAL)
            results["by_scene"][stage.name] = _as_dicts(judged)
    return results


def _as_dicts(measured: Any) -> Any:
    """The same nested dictionaries with numbers for JSON at their leaves."""
    if isinstance(measured, dict):
        return {name: _as_dicts(each) for name, each in measured.items()}
    return measured.as_dict()


def _compare(
    measured: dict[str, Any], candidates: list[str], rows: list[str], views: int
) -> list[dict[str, Any]]:
    """The AP (VOC, area, class car) of each candidate less that of each of its controls."""
    compared = []
    for candidate in candidates:
        for control in controls_of(candidate, rows, candidates):
            for detector, own in measured[candidate].items():
                other = measured[control][detector]
                difference = own["car"]["AP_voc"] - other["car"]["AP_voc"]
                compared.append(
                    {
                        "candidate": candidate,
                        "control": control,
                        "detector": detector,
                        **difference.as_dict(),
                        "verdict": word_for(difference, views),
                    }
                )
    return compared


def _sections(
    seen: dict[str, dict[str, Seen]],
    boxes: torch.Tensor,
    weights: torch.Tensor,
    table: list[dict[str, float]],
) -> dict[str, Any]:
    """Axis → its sections; each with the AP of every row, mean over the detectors."""
    found: dict[str, Any] = {}
    for axis in AXES:
        parts = sections(table, axis)
        views = [part.views for part in parts]
        by_row = {row: by_section(by, boxes, weights, views) for row, by in seen.items()}
        found[axis] = [
            {
                "label": part.label,
                "place": part.place if part.place < 1e9 else None,
                "views": len(part.views),
                "AP_voc": {row: sampled[k].as_dict() for row, sampled in by_row.items()},
            }
            for k, part in enumerate(parts)
        ]
    return found
