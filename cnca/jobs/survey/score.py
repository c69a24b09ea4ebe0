"""What a survey's answers come to: scores by source with intervals, and tests of the differences.

The unit is the participant: all that is compared are the means of each participant's answers over
the pictures of a source.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from scipy import stats

from cnca.core.errors import RunError
from cnca.core.manifest import versions, write_json
from cnca.jobs.survey.answers import Sheet, Survey, read_sheets, read_survey
from cnca.judge.bootstrap import Sampled, resample

Means = Float[np.ndarray, "participants sources"]

PERMUTATIONS = 9999
"""Of signs in Wilcoxon's test: all of them up to 13 participants, so many at random beyond."""


def score_survey(folder: Path) -> dict[str, Any]:
    """Score the survey in ``folder``; write ``score.json``, ``score.md`` and ``score.tex``.

    Raises:
        RunError: there is no survey, or nobody rated every source.
    """
    from cnca.jobs.survey.tables import write_tables

    survey = read_survey(folder)
    sheets = read_sheets(folder, survey)
    means = participant_means(sheets, survey)
    if not len(means):
        raise RunError(
            f"{folder}: {len(sheets)} participant(s), none of whom rated every source; "
            "let some finish"
        )
    sources = list(dict.fromkeys(survey.sources.values()))
    results = {
        "survey": survey.id,
        "question": survey.question,
        "participants": len(means),
        "left_out": len(sheets) - len(means),
        "pictures": len(survey.sources),
        "interval": "95 %, percentile bootstrap over participants",
        "sources": [
            {"source": source, **summarize(own)}
            for source, own in zip(sources, means.T, strict=True)
        ],
        **compare(sources, means),
        "versions": versions(),
    }
    write_json(folder / "score.json", results)
    write_tables(folder, results, survey)
    return results


def participant_means(sheets: Sequence[Sheet], survey: Survey) -> Means:
    """Mean score of each participant for each source; of those who rated every source."""
    sources = list(dict.fromkeys(survey.sources.values()))
    rows = []
    for sheet in sheets:
        own: dict[str, list[int]] = {source: [] for source in sources}
        for picture, score in sheet.answers.items():
            own[survey.sources[picture]].append(score)
        if all(own.values()):
            rows.append([float(np.mean(scores)) for scores in own.values()])
    return np.array(rows, float).reshape(len(rows), len(sources))


def summarize(scores: Float[np.ndarray, " participants"]) -> dict[str, float | None]:
    """Mean with its interval, and the standard deviation over participants (n − 1)."""
    weights = resample([len(scores)], seed=0)
    mean = Sampled(weights @ torch.from_numpy(scores) / len(scores))
    spread = round(float(scores.std(ddof=1)), 4) if len(scores) > 1 else None
    return mean.as_dict() | {"standard_deviation": spread}


def compare(sources: Sequence[str], means: Means) -> dict[str, Any]:
    """Whether any source differs (Friedman), and which pairs do (Wilcoxon, Holm-corrected).

    Returns ``friedman`` (``statistic`` and ``p``; None for two sources) and ``pairs``, a list of
    ``first``, ``second``, ``difference`` of the means, ``p`` and the corrected ``p_holm``.
    """
    pairs = list(combinations(range(len(sources)), 2))
    p_values = [wilcoxon(means[:, i] - means[:, j]) for i, j in pairs]
    return {
        "friedman": _friedman(means) if len(sources) > 2 else None,
        "pairs": [
            {
                "first": sources[i],
                "second": sources[j],
                "difference": round(float((means[:, i] - means[:, j]).mean()), 4),
                "p": p,
                "p_holm": corrected,
            }
            for (i, j), p, corrected in zip(pairs, p_values, holm(p_values), strict=True)
        ],
    }


def wilcoxon(differences: Float[np.ndarray, " participants"]) -> float:
    """Two-sided p of Wilcoxon's signed-rank test, by permutation, since ratings are full of ties.

    Participants without a difference are dropped, as Wilcoxon did; 1 where none has any.
    """
    differences = np.round(differences, 9)  # equal means differ by rounding
    if not differences.any():
        return 1.0
    method = stats.PermutationMethod(n_resamples=PERMUTATIONS, rng=np.random.default_rng(0))
    return float(stats.wilcoxon(differences[differences != 0], method=method).pvalue)


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's step-down correction (1979): keeps the chance of any false alarm below α."""
    order = np.argsort(p_values, kind="stable")
    factors = np.arange(len(order), 0, -1)
    stepped = np.maximum.accumulate(np.asarray(p_values)[order] * factors).clip(max=1)
    corrected = np.empty(len(order))
    corrected[order] = stepped
    return corrected.tolist()


def _friedman(means: Means) -> dict[str, float]:
    if len(means) < 2 or not np.ptp(means, axis=1).any():
        return {"statistic": 0.0, "p": 1.0}
    statistic, p = stats.friedmanchisquare(*np.round(means, 9).T)
    assert not math.isnan(p)
    return {"statistic": float(statistic), "p": float(p)}
