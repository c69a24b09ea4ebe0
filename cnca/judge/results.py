"""All numbers of an evaluation, with their intervals, as a record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

from cnca.judge import protocol_names
from cnca.judge.bootstrap import resample
from cnca.judge.candidates import controls_of
from cnca.judge.records import Comparison, Evidence, Scores, SectionScores
from cnca.judge.rows import NORMAL
from cnca.judge.sections import AXES, parameters, sections
from cnca.judge.stage import Eye, Stage, whole_truth
from cnca.judge.truth import Truth
from cnca.judge.verdict import (
    MEASURES,
    MeasuredScores,
    Seen,
    Weights,
    by_section,
    estimates,
    measure_all,
    word_for,
)


def judge(
    stages: Sequence[Stage],
    eyes: Sequence[Eye],
    seen: dict[str, dict[str, Seen]],
    candidates: Sequence[str],
    seed: int,
) -> Evidence:
    """All numbers with their intervals."""
    truth = whole_truth(stages)
    table = [row for stage in stages for row in parameters(stage.shots)]
    counts = [len(stage.places) for stage in stages]
    weights = resample(counts, seed=seed)
    measured = measure_all(seen, truth, weights, normal=NORMAL)
    frames = [fit for stage in stages for fit in stage.frames]
    return Evidence(
        views=len(truth),
        interval=f"95 %, percentile bootstrap over views, {len(weights) - 1} resamples",
        seed=seed,
        scenes=[stage.name for stage in stages],
        detectors=[eye.name for eye in eyes],
        label=stages[0].label,
        candidates=list(candidates),
        rows=list(seen),
        measures={**MEASURES, **protocol_names.MEASURES},
        all=estimates(measured),
        comparisons=_compare(measured, stages[0].label, list(candidates), list(seen), len(truth)),
        sections=_sections(seen, truth, weights, table),
        frames=frames or None,
        by_scene=_by_scene(stages, seen, truth, weights) if len(stages) > 1 else None,
    )


def _by_scene(
    stages: Sequence[Stage],
    seen: Mapping[str, Mapping[str, Seen]],
    truth: Truth,
    weights: Weights,
) -> dict[str, Scores]:
    """Scene → the scores over its own views."""
    scores, first = {}, 0
    for stage in stages:
        views = slice(first, first + len(stage.places))
        first = views.stop
        part = {
            row: {name: replace(s, detections=s.detections[views]) for name, s in by_eye.items()}
            for row, by_eye in seen.items()
        }
        measured = measure_all(part, truth.part(views), weights[:, views], normal=NORMAL)
        scores[stage.name] = estimates(measured)
    return scores


def _compare(
    measured: MeasuredScores, label: str, candidates: list[str], rows: list[str], views: int
) -> list[Comparison]:
    """The AP (VOC, area, own class) of each candidate less that of each of its controls."""
    compared = []
    for candidate in candidates:
        for control in controls_of(candidate, rows, candidates):
            for detector, columns in measured[candidate].items():
                other = measured[control][detector][label]["AP_voc"]
                difference = columns[label]["AP_voc"] - other
                compared.append(
                    Comparison(
                        **asdict(difference.estimate()),
                        candidate=candidate,
                        control=control,
                        detector=detector,
                        verdict=word_for(difference, views),
                    )
                )
    return compared


def _sections(
    seen: Mapping[str, Mapping[str, Seen]],
    truth: Truth,
    weights: Weights,
    table: list[dict[str, float]],
) -> dict[str, list[SectionScores]]:
    """Axis → its sections; each with the AP of every row, mean over the detectors."""
    by_axis = {}
    for axis in AXES:
        parts = sections(table, axis)
        views = [part.views for part in parts]
        by_row = {row: by_section(by, truth, weights, views) for row, by in seen.items()}
        by_axis[axis] = [
            SectionScores(
                label=part.label,
                place=part.place if part.place < 1e9 else None,
                views=len(part.views),
                AP_voc={row: sampled[k].estimate() for row, sampled in by_row.items()},
            )
            for k, part in enumerate(parts)
        ]
    return by_axis
