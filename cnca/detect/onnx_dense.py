"""Networks with one row of values per cell or anchor, before any suppression."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import torch

from cnca.core.types import Candidates
from cnca.detect.classes import COCO, COCO91
from cnca.detect.onnx_decode import (
    Cells,
    Rows,
    Size,
    Unknown,
    activate,
    are_parts,
    cells_of_strides,
    corners_in_pixels,
    find_activation,
    from_distances,
    from_offsets,
    is_undecoded,
    without_objectness,
)
from cnca.detect.onnx_layout import (
    LARGEST_WIDTH,
    NANODET,
    SIDE_WIDTHS,
    STRIDES,
    USUAL_BINS,
    YOLO,
    YOLOX,
    Layout,
    Outputs,
    Table,
)
from cnca.detect.onnx_options import Options
from cnca.detect.preprocess import IMAGENET


def dense(
    outputs: Outputs,
    size: Size,
    names: Sequence[str] | None,
    say: Options,
    kind: str | None = None,
) -> Layout | None:
    """One row of values per cell or anchor, one level after the other."""
    table, class_names = _table(outputs, names, any_width=kind is not None)
    first = table(outputs)
    cells, one_per_cell = _cells_of(first, size, say)
    masks = next((o.shape[1] for o in outputs.values() if o.ndim == 4), 0)
    surplus = first.shape[2] - len(class_names)
    if masks and surplus - masks in (4, 5):  # weights of masks follow the scores
        surplus -= masks
        first, table = first[..., :-masks], partial(_without_masks, table=table, masks=masks)
    if kind is None:
        kind = "yolo" if surplus in (4, 5) else "distribution"
        if surplus == 5 and one_per_cell and is_undecoded(first, cells):
            kind = "yolox"
    if kind != "yolo" and not one_per_cell:
        raise Unknown(f"{first.shape[1]} rows for {len(cells)} cells")
    if kind == "distribution" and (surplus < 4 or surplus % 4):
        raise Unknown(f"{surplus} columns beside {len(class_names)} classes for four sides")
    if kind == "distribution":
        # Only NanoDet-Plus, which has four levels in one table, measures from corners of cells.
        corner = len(outputs) == 1 and len(cells[:, 2].unique()) == 4
        centre = say.centre if say.centre is not None else 0.0 if corner else 0.5
        decode = _distribution_decoder(table, first, len(class_names), cells, centre, say)
        return Layout(NANODET if len(outputs) == 1 else IMAGENET, class_names, decode)
    offsets = cells if kind == "yolox" else None
    decode = _yolo_decoder(table, first, len(class_names), offsets, size, say)
    return Layout(YOLOX if kind == "yolox" else YOLO, class_names, decode)


def _distribution_decoder(
    table: Table, first: Rows, classes: int, cells: Cells, centre: float, say: Options
) -> Callable[[Outputs], Candidates]:
    """Scores of all classes, then the distributions of left, top, right and bottom."""
    activation = say.activation or find_activation(first[..., :classes])

    def decode(found: Outputs) -> Candidates:
        scores, sides = table(found).tensor_split((classes,), dim=2)
        corners = from_distances(sides, cells, centre)
        return without_objectness(corners, activate(scores, activation))

    return decode


def _yolo_decoder(
    table: Table, first: Rows, classes: int, offsets: Cells | None, size: Size, say: Options
) -> Callable[[Outputs], Candidates]:
    """A box, objectness if exactly one column is left for it, scores of all classes."""
    parts = offsets is None and are_parts(first[..., :4])
    has_objectness = first.shape[2] == 5 + classes
    end = 4 + has_objectness + classes
    activation = say.activation or find_activation(first[..., 4:end])

    def decode(found: Outputs) -> Candidates:
        rows = table(found)
        boxes = rows[..., :4]
        if offsets is not None:
            boxes = from_offsets(boxes, offsets, say.centre or 0.0)
        corners = corners_in_pixels(boxes, size, say, xyxy=False, parts=parts)
        scores = activate(rows[..., 4:end], activation)
        if has_objectness:
            return Candidates(corners, scores[..., 0], scores[..., 1:])
        return without_objectness(corners, scores)

    return decode


def _table(
    outputs: Outputs, names: Sequence[str] | None, *, any_width: bool
) -> tuple[Table, Sequence[str]]:
    """How to get one table with a row per candidate, and the names of its classes."""
    tables = {name: o for name, o in outputs.items() if o.ndim == 3}
    known = (names,) if names else (COCO, COCO91)
    for class_names in known:
        classes = len(class_names)
        levels = _levels(tables, classes)
        if levels:
            return partial(_join, levels=levels), class_names
        widths = {classes + more for more in (4, 5, *(4 * bins for bins in USUAL_BINS))}
        # Instance segmentation adds as many weights to each box as there are prototypes of masks.
        masks = {o.shape[1] for o in outputs.values() if o.ndim == 4}
        widths |= {classes + more + count for more in (4, 5) for count in masks}
        if any_width:
            widths |= set(range(classes + 4, classes + LARGEST_WIDTH))
        for name, table in tables.items():
            if table.shape[2] in widths:
                return lambda found, name=name: found[name], class_names
            if table.shape[1] in widths:
                return lambda found, name=name: found[name].mT, class_names
    raise Unknown("of no known layout for " + " or ".join(f"{len(k)} classes" for k in known))


def _without_masks(found: Outputs, *, table: Table, masks: int) -> Rows:
    """The table without its last columns."""
    return table(found)[..., :-masks]


def _levels(tables: Outputs, classes: int) -> list[tuple[str, str]]:
    """Outputs that come in pairs, scores and distributions of one level; the finest first."""
    scores = [name for name, o in tables.items() if o.shape[2] == classes]
    sides = [n for n, o in tables.items() if n not in scores and o.shape[2] in SIDE_WIDTHS]
    if len(scores) != len(sides):
        return []
    by_rows = [sorted(names, key=lambda n: -tables[n].shape[1]) for names in (scores, sides)]
    return list(zip(*by_rows, strict=True))


def _join(found: Outputs, levels: Sequence[tuple[str, str]]) -> Rows:
    """One level below the other, the distributions beside the scores."""
    return torch.cat([torch.cat([found[name] for name in pair], dim=2) for pair in levels], dim=1)


def _cells_of(rows: Rows, size: Size, say: Options) -> tuple[Cells, bool]:
    """The cells to which ``rows`` belong, and whether each has one row."""
    grids = [
        cells_of_strides(size, strides) for strides in ((say.strides,) if say.strides else STRIDES)
    ]
    grid = next((g for g in grids if len(g) == rows.shape[1]), None)
    return (grids[0], False) if grid is None else (grid, True)
