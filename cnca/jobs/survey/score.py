"""The outcome of a survey: scores by source with intervals, and tests of the differences.

The unit is the participant: all that is compared are the means of each participant's answers over
the pictures of a source.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from scipy import stats

from cnca.core.errors import RunError
from cnca.core.manifest import versions, write_json
from cnca.core.records import as_json
from cnca.jobs.survey.answers import Sheet, Survey, read_sheets, read_survey
from cnca.judge.bootstrap import Sampled, resample
from cnca.judge.records import Estimate

Means = Float[np.ndarray, "participants sources"]


@dataclass(frozen=True)
class Score(Estimate):
    """Mean over the participants' mean scores of one source, from 1 to 5, with its interval."""

    standard_deviation: float | None
    """Over participants (n − 1); None where there is one."""


@dataclass(frozen=True)
class SourceScore(Score):
    """The score of a named source."""

    source: str


@dataclass(frozen=True)
class Friedman:
    """Friedman's test of whether any source differs."""

    statistic: float
    p: float


@dataclass(frozen=True)
class Pair:
    """Wilcoxon's test of whether two sources differ."""

    first: str
    second: str
    difference: float
    """Of the means."""
    p: float
    p_holm: float
    """Corrected for all pairs."""


@dataclass(frozen=True)
class SurveyScores:
    """The outcome of a survey; ``score.json`` holds it."""

    survey: str
    question: str
    participants: int
    left_out: int
    """Participants who did not rate every source."""
    pictures: int
    interval: str
    """What the intervals are."""
    sources: Sequence[SourceScore]
    friedman: Friedman | None
    """None for two sources."""
    pairs: Sequence[Pair]
    versions: Mapping[str, str]


PERMUTATIONS = 9999
"""Of signs in Wilcoxon's test: all of them up to 13 participants, this many at random beyond."""


def score_survey(folder: Path) -> SurveyScores:
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
    friedman, pairs = compare(sources, means)
    results = SurveyScores(
        survey=survey.id,
        question=survey.question,
        participants=len(means),
        left_out=len(sheets) - len(means),
        pictures=len(survey.sources),
        interval="95 %, percentile bootstrap over participants",
        sources=[
            SourceScore(**asdict(summarize(column)), source=source)
            for source, column in zip(sources, means.T, strict=True)
        ],
        friedman=friedman,
        pairs=pairs,
        versions=versions(),
    )
    write_json(folder / "score.json", as_json(results))
    write_tables(folder, results, survey)
    return results


def participant_means(sheets: Sequence[Sheet], survey: Survey) -> Means:
    """Mean score of each participant for each source; of those who rated every source."""
    sources = list(dict.fromkeys(survey.sources.values()))
    rows = []
    for sheet in sheets:
        by_source: dict[str, list[int]] = {source: [] for source in sources}
        for picture, score in sheet.answers.items():
            by_source[survey.sources[picture]].append(score)
        if all(by_source.values()):
            rows.append([float(np.mean(scores)) for scores in by_source.values()])
    return np.array(rows, float).reshape(len(rows), len(sources))


def summarize(scores: Float[np.ndarray, " participants"]) -> Score:
    """Mean with its interval, and the standard deviation over participants (n − 1)."""
    weights = resample([len(scores)], seed=0)
    mean = Sampled(weights @ torch.from_numpy(scores) / len(scores))
    spread = round(float(scores.std(ddof=1)), 4) if len(scores) > 1 else None
    return Score(**asdict(mean.estimate()), standard_deviation=spread)


def compare(sources: Sequence[str], means: Means) -> tuple[Friedman | None, list[Pair]]:
    """Whether any source differs, None for two, and which pairs do (Wilcoxon, Holm-corrected)."""
    pairs = list(combinations(range(len(sources)), 2))
    p_values = [wilcoxon(means[:, i] - means[:, j]) for i, j in pairs]
    return _friedman(means) if len(sources) > 2 else None, [
        Pair(
            first=sources[i],
            second=sources[j],
            difference=round(float((means[:, i] - means[:, j]).mean()), 4),
            p=p,
            p_holm=corrected,
        )
        for (i, j), p, corrected in zip(pairs, p_values, holm(p_values), strict=True)
    ]


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


def _friedman(means: Means) -> Friedman:
    if len(means) < 2 or not np.ptp(means, axis=1).any():
        return Friedman(statistic=0.0, p=1.0)
    statistic, p = stats.friedmanchisquare(*np.round(means, 9).T)
    assert not math.isnan(p)
    return Friedman(float(statistic), float(p))
