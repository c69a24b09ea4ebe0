"""The paper's tables: its rows and figures, and ours beside them."""

import re
from pathlib import Path

import pytest

from cnca.judge.records import Estimate, Evidence
from cnca.report.paper_tables import TABLE1, TABLE1_COLUMNS, TABLE2, write_table1

PAPER = Path(__file__).parents[3] / "shared" / "paper.tex"


@pytest.mark.skipif(not PAPER.exists(), reason="the paper is not beside the checkout")
@pytest.mark.parametrize(("label", "figures"), [("sim-table1", TABLE1), ("phy-table1", TABLE2)])
def test_figures_are_those_that_the_paper_prints(label, figures):
    text = PAPER.read_text()
    start = text.index(rf"\label{{{label}}}", text.index(rf"\label{{{label}}}"))
    block = text[start : text.index(r"\end{tabular}", start)].replace("Ours", "CNCA")
    for name, numbers in figures.items():
        line = next(row for row in block.splitlines() if re.match(rf"\s*{name}\b", row))
        printed = [float(number) for number in re.findall(r"\d\.\d+", line)]
        assert printed == list(numbers)


def test_the_papers_totals_are_means_over_its_detectors():
    for *single, total in TABLE1.values():
        assert sum(single) / len(single) == pytest.approx(total, abs=0.001)


def results():
    def number(value):
        return {"car": {"AP_voc": Estimate(value, value - 0.1, value + 0.1)}}

    rows = {"normal": 0.9, "random": 0.8, "dta": 0.5, "mine": 0.4}
    return Evidence(
        views=64,
        interval="95 %",
        seed=0,
        scenes=["a"],
        detectors=["YOLOv3", "mine"],
        candidates=["mine"],
        rows=list(rows),
        measures={},
        all={
            row: {name: number(v) for name in ("YOLOv3", "mine", "total")}
            for row, v in rows.items()
        },
        comparisons=[],
        sections={},
    )


def lines_of(path):
    """Row name → its cells."""
    cells = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in path.read_text().splitlines()
        if line.startswith("|")
    ]
    assert len({len(row) for row in cells}) == 1
    return {row[0]: row[1:] for row in cells}


def test_rows_stand_in_the_papers_order_and_missing_ones_say_so(tmp_path):
    rows = lines_of(write_table1(tmp_path, results(), paper_figures=False))
    assert list(rows) == [
        "texture", "---", "Normal", "Random", "DAS", "FCA", "DTA", "ACTIVE", "CNCA", "mine",
    ]  # fmt: skip
    assert rows["DTA"] == ["0.500 [0.400, 0.600]"] * 3
    assert rows["FCA"] == ["not given"] * 3


def test_the_papers_figures_stand_beside_ours_and_are_marked(tmp_path):
    path = write_table1(tmp_path, results(), paper_figures=True)
    rows = lines_of(path)
    assert rows["texture"][3:] == [f"{name} (*paper*)" for name in TABLE1_COLUMNS]
    assert rows["DTA"][3:] == [f"{value:.3f}" for value in TABLE1["DTA"]]
    assert rows["mine"][3:] == ["–"] * 7
    assert "quoted from the paper" in path.read_text()
    assert "paper*" not in write_table1(tmp_path, results(), paper_figures=False).read_text()
