"""A survey's results as tables: the paper's Table 4, in Markdown and in LaTeX, and the tests."""

from __future__ import annotations

from pathlib import Path

from cnca.core.files import write_text
from cnca.jobs.survey.answers import Survey
from cnca.jobs.survey.score import Pair, Score, SurveyScores
from cnca.report.tables import cell, table

LEVEL = 0.05
"""Of the corrected p below which two sources are said to differ."""


def write_tables(folder: Path, results: SurveyScores, survey: Survey) -> None:
    """Write ``score.md`` and ``score.tex`` into the survey's folder."""
    write_text(folder / "score.md", _markdown(results, survey))
    write_text(folder / "score.tex", _latex(results, survey))


def sentences(results: SurveyScores) -> list[str]:
    """Who answered, and what the tests say."""
    said = [
        f"{results.participants} participants rated {results.pictures} pictures"
        + (f"; {results.left_out} more did not rate every source" if results.left_out else "")
    ]
    friedman = results.friedman
    if friedman is not None:
        said.append(
            f"Friedman's test over all sources: χ² = {friedman.statistic:.2f}, {_p(friedman.p)}"
        )
    return said


def _markdown(results: SurveyScores, survey: Survey) -> str:
    pictures = _pictures(survey)
    names = [score.source for score in results.sources]
    pictured = [f"![{name}](pictures/{pictures[name]}.jpg)" for name in names]
    layout = [["Score", *(_score(score, "±") for score in results.sources)], ["Source", *names]]
    means = [[score.source, cell(score, digits=2)] for score in results.sources]
    pairs = [
        [pair.first, pair.second, f"{pair.difference:+.2f}"]
        + [_p(pair.p), _p(pair.p_holm), verdict(pair)]
        for pair in results.pairs
    ]
    head = ["first", "second", "difference of means", "Wilcoxon", "after Holm", "first is"]
    return "\n".join(
        [
            f"# Naturalness: “{results.question}”\n",
            "Mean ± standard deviation over participants of each one's mean score for a source, "
            "from 1 (not natural at all) to 5 (very natural).\n",
            table(["Images", *pictured], layout),
            *(f"{sentence}.\n" for sentence in sentences(results)),
            table(["source", f"mean; in brackets: {results.interval}"], means),
            "Paired tests over participants, two-sided; the correction is for all pairs.\n",
            table(head, pairs),
        ]
    )


def verdict(pair: Pair) -> str:
    """``higher``, ``lower`` or ``no different``, by the corrected p."""
    if pair.p_holm >= LEVEL:
        return "no different"
    return "higher" if pair.difference > 0 else "lower"


def _latex(results: SurveyScores, survey: Survey) -> str:
    pictures = _pictures(survey)
    names = [score.source for score in results.sources]
    image = r"\includegraphics[width=0.15\linewidth]{{pictures/{}.jpg}}"
    rows = [
        ["Images", *(image.format(pictures[name]) for name in names)],
        ["Score", *("$" + _score(score, r"\pm") + "$" for score in results.sources)],
        ["Source", *(name.replace("_", r"\_") for name in names)],
    ]
    body = "\n\\midrule\n".join(" & ".join(row) + r" \\" for row in rows)
    columns = "l" + "c" * len(names)
    return f"\\begin{{tabular}}{{{columns}}}\n\\toprule\n{body}\n\\bottomrule\n\\end{{tabular}}\n"


def _pictures(survey: Survey) -> dict[str, str]:
    """The first picture of each source."""
    first: dict[str, str] = {}
    for key, source in survey.sources.items():
        first.setdefault(source, key)
    return first


def _score(score: Score, sign: str) -> str:
    spread = score.standard_deviation
    return f"{score.value:.2f}" + (f" {sign} {spread:.2f}" if spread is not None else "")


def _p(p: float) -> str:
    return "p < 0.001" if p < 0.001 else f"p = {p:.3f}"
