"""The paper's Tables 1 and 2, with our numbers, and with the paper's where they are asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from cnca.core.files import replacing
from cnca.judge.records import Evidence
from cnca.report.tables import cell, table, with_total

TABLE1_ROWS = ("Normal", "Random", "DAS", "FCA", "DTA", "ACTIVE", "CNCA")
TABLE1_COLUMNS = ("YOLOv3", "YOLOF", "DDTR", "DRCN", "SRCN", "FrRCN", "Total")
TABLE1 = {
    "Normal": (0.712, 0.824, 0.803, 0.778, 0.786, 0.771, 0.779),
    "Random": (0.642, 0.753, 0.625, 0.694, 0.681, 0.672, 0.678),
    "DAS": (0.671, 0.769, 0.738, 0.715, 0.724, 0.719, 0.723),
    "FCA": (0.581, 0.725, 0.603, 0.678, 0.642, 0.668, 0.650),
    "DTA": (0.521, 0.657, 0.402, 0.614, 0.488, 0.562, 0.541),
    "ACTIVE": (0.473, 0.577, 0.436, 0.534, 0.484, 0.520, 0.504),
    "CNCA": (0.485, 0.538, 0.436, 0.536, 0.470, 0.504, 0.495),
}
"""AP@0.5 of the car as the paper prints it (Lyu et al., Table 1)."""
TABLE2_COLUMNS = ("YOLOv3", "YOLOX", "SSD", "CenterNet", "RetinaNet")
TABLE2 = {
    "Normal": (0.705, 0.619, 0.704, 0.846, 0.917),
    "CNCA": (0.363, 0.244, 0.237, 0.628, 0.692),
}
"""The same for photographs of scale models (Table 2, where CNCA is called "Ours")."""
QUOTED = (
    "Columns marked *paper* are quoted from the paper. They are of other pictures, detectors and "
    "weights: they stand for its claims, not for a comparison with ours."
)


def write_table1(out: Path, results: Evidence, *, paper_figures: bool) -> Path:
    """Write ``table1.md`` from the results of an evaluation; returns its path."""
    detectors = with_total(results.detectors)
    cells = {
        row: [cell(results.all[row][name][results.label]["AP_voc"]) for name in detectors]
        for row in results.rows
    }
    body = quoted_table(
        TABLE1_ROWS,
        cells,
        detectors,
        TABLE1 if paper_figures else {},
        TABLE1_COLUMNS if paper_figures else (),
    )
    text = (
        "# Table 1: camouflages before several detectors\n\n"
        f"AP@0.5 of the {results.label}, Pascal VOC 2010–2012 (area under the curve), over "
        f"{results.views} of the 8192 views of the paper's grid. In brackets: "
        f"{results.interval}.\n\n{body}"
    )
    path = out / "table1.md"
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def quoted_table(
    order: Sequence[str],
    ours: Mapping[str, Sequence[str]],
    columns: Sequence[str],
    quoted: Mapping[str, Sequence[float]],
    quoted_columns: Sequence[str],
) -> str:
    """Rows in the paper's order, then all others; ours first, what is quoted from the paper beside.

    Names are matched without regard to case; "not given" stands for a row that was not measured.
    """
    by_name = {name.lower(): name for name in ours}
    rows = [
        *((name, by_name.get(name.lower())) for name in order),
        *((name, name) for name in ours if name.lower() not in [n.lower() for n in order]),
    ]
    lines = []
    for title, name in rows:
        measured = ours[name] if name is not None else ["not given"] * len(columns)
        published = quoted.get(title, ())
        beside = [f"{value:.3f}" for value in published] or ["–"] * len(quoted_columns)
        lines.append([title, *measured, *beside])
    head = ["texture", *columns, *(f"{name} (*paper*)" for name in quoted_columns)]
    return table(head, lines) + (f"\n{QUOTED}\n" if quoted_columns else "")
