"""What answers come to, against closed forms and hand-worked examples."""

import json
from itertools import product

import numpy as np
import pytest
from scipy import stats

from cnca.core.errors import RunError
from cnca.core.records import read_record
from cnca.jobs.survey.answers import FILES, STORE, Sheet, Store, Survey, read_survey
from cnca.jobs.survey.score import (
    SurveyScores,
    compare,
    holm,
    participant_means,
    score_survey,
    summarize,
    wilcoxon,
)

SURVEY = Survey(
    "5" * 16,
    "How?",
    {"a": "Normal", "b": "FCA", "c": "Normal", "d": "FCA"},
    {"a": "1", "b": "1", "c": "2", "d": "2"},
)


def test_means_are_those_of_participants():
    sheets = [
        Sheet("0", 1, {"a": 5, "c": 4, "b": 1, "d": 2}),
        Sheet("1", 1, {"a": 3, "b": 2}),
        Sheet("2", 1, {"a": 3, "c": 3}),  # rated no FCA
    ]
    assert participant_means(sheets, SURVEY).tolist() == [[4.5, 1.5], [3.0, 2.0]]


def test_mean_and_deviation_are_numpys():
    scores = np.array([1.0, 2.5, 3.0, 5.0])
    own = summarize(scores)
    assert own.value == pytest.approx(np.mean(scores), abs=5e-5)
    assert own.standard_deviation == pytest.approx(np.std(scores, ddof=1), abs=5e-5)
    assert 1 < own.low < own.value < own.high < 5
    assert summarize(scores[:1]).standard_deviation is None


@pytest.mark.parametrize("differences", [[1.5, -0.5, 2, 3, 1], [1, 2, 3, 4, 5, 6, -7, 8]])
def test_wilcoxon_without_ties_is_the_exact_test(differences):
    exact = stats.wilcoxon(differences, method="exact").pvalue
    assert wilcoxon(np.array(differences, float)) == pytest.approx(exact, abs=1e-12)


def test_wilcoxon_with_ties_counts_all_signs():
    """By its definition: the share of all signs with a rank sum at least as far from the middle."""
    differences = np.array([1.0, 1.0, 2.0, -1.0, 2.0, 3.0, 0.0])
    ranks = stats.rankdata(np.abs(differences[:-1]))
    sums = [ranks @ signs for signs in product((-1, 1), repeat=6)]
    observed = abs(ranks @ np.sign(differences[:-1]))
    expected = np.mean(np.abs(sums) >= observed - 1e-9)
    assert wilcoxon(differences) == pytest.approx(expected, abs=1e-12)


def test_no_difference_has_p_1():
    assert wilcoxon(np.zeros(9)) == 1
    friedman, pairs = compare(["x", "y", "z"], np.full((4, 3), 2.5))
    assert friedman.p == 1
    assert [pair.p_holm for pair in pairs] == [1, 1, 1]


def test_holm_by_hand():
    # Sorted .005 × 4, .01 × 3, .03 × 2, .04 × 1, and never below the one before.
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1, 1]


def test_friedman_is_its_closed_form():
    """Conover's textbook form without ties: 12 / (n k (k + 1)) Σ R² − 3 n (k + 1)."""
    means = np.array([[5.0, 1, 3], [4, 2, 3], [5, 3, 1], [4, 1, 2]])
    n, k = means.shape
    sums = stats.rankdata(means, axis=1).sum(axis=0)
    expected = 12 / (n * k * (k + 1)) * (sums**2).sum() - 3 * n * (k + 1)
    friedman, _ = compare(["x", "y", "z"], means)
    assert friedman.statistic == pytest.approx(expected)
    assert friedman.p == pytest.approx(stats.chi2.sf(expected, k - 1))


def test_two_sources_need_no_friedman():
    assert compare(["x", "y"], np.array([[1.0, 2], [2, 4]]))[0] is None


def answer(folder, participants: int, seed: int = 0) -> None:
    """People who find Normal natural and like CNCA a little more than FCA."""
    survey, rng = read_survey(folder), np.random.default_rng(seed)
    taste = {"Normal": 4.6, "FCA": 2.0, "CNCA": 2.1}
    store = Store(folder / STORE)
    for participant in range(participants):
        answers = {
            key: int(np.clip(np.round(rng.normal(taste[source], 0.8)), 1, 5))
            for key, source in survey.sources.items()
        }
        store.keep(Sheet(f"{participant:032x}", 1, answers))
    store.close()


def test_a_survey_from_answers_to_tables(folder):
    answer(folder, 20)
    (folder / FILES).mkdir()
    survey = read_survey(folder)
    late = {"survey": survey.id, "participant": "f" * 32, "revision": 1, "answers": {}}
    (folder / FILES / "late.json").write_text(json.dumps(late))
    results = score_survey(folder)
    assert (results.participants, results.left_out) == (20, 1)
    assert [score.source for score in results.sources] == ["CNCA", "FCA", "Normal"]
    by_pair = {(pair.first, pair.second): pair for pair in results.pairs}
    assert by_pair["FCA", "Normal"].p_holm < 0.001 > by_pair["CNCA", "Normal"].p_holm
    assert results.friedman.p < 0.001
    assert read_record(SurveyScores, folder / "score.json") == results
    text = (folder / "score.md").read_text().splitlines()
    layout = next(i for i, line in enumerate(text) if line.startswith("| Images"))
    assert text[layout + 3] == "| Source | CNCA | FCA | Normal |"
    for line, path in zip(text[layout].split("](")[1:], ("CNCA", "FCA", "Normal"), strict=True):
        picture = line.split(")")[0]
        assert (folder / picture).is_file()
        assert survey.sources[picture.split("/")[1].removesuffix(".jpg")] == path
    normal = results.sources[2]
    printed = f"{normal.value:.2f} ± {normal.standard_deviation:.2f}"
    assert text[layout + 2].endswith(f"| {printed} |")
    assert printed.replace("±", r"\pm") in (folder / "score.tex").read_text()


def test_nobody_is_an_error(folder):
    with pytest.raises(RunError, match="none of whom rated every source"):
        score_survey(folder)
