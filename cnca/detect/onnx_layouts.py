"""How boxes leave the networks in ONNX files, told from the outputs' names and values.

====================  =====================================================================
``detections``        after suppression: boxes, scores (often the boxes' fifth column), labels
``rows``              after suppression: one row per box, (box, score, label) in Ultralytics'
                      exports or, where the output has no batch, (label, score, box) in Paddle's
``detr``              boxes and, in another output, scores of all classes: one pair per query
``yolo``              one row per candidate: box, objectness where there is one, scores
``yolox``             the same, not yet decoded: offsets from the cell and logarithms of sizes
``distribution``      one row per cell: scores, then for each side a distribution over distances
                      (Li et al. 2020, generalised focal loss): NanoDet, PicoDet
====================  =====================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

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
    classes_of,
    corners_in_pixels,
    find_activation,
    from_distances,
    from_offsets,
    is_undecoded,
    of_labels,
    without_objectness,
)
from cnca.detect.onnx_options import Options
from cnca.detect.preprocess import IMAGENET, PLAIN, Entry

Outputs = Mapping[str, Tensor]
Table = Callable[[Outputs], Rows]

STRIDES = ((8, 16, 32), (8, 16, 32, 64))
USUAL_BINS = (8, 16, 17)
"""Distances per side that published networks tell apart; others want ``layout: distribution``."""
SIDE_WIDTHS = range(4 * 2, 4 * 65, 4)
LARGEST_WIDTH = 300
ANCHORS_PER_CELL = (1, 3)
BLUE_FIRST_MEAN, BLUE_FIRST_STD = (103.53, 116.28, 123.675), (57.375, 57.12, 58.395)
MMDETECTION = Entry("rgb", 255.0, BLUE_FIRST_MEAN[::-1], BLUE_FIRST_STD[::-1], "corner")
NANODET = Entry("bgr", 255.0, BLUE_FIRST_MEAN, BLUE_FIRST_STD)
YOLO = Entry(fit="letterbox", fill=114.0)
YOLOX = Entry("bgr", 255.0, fit="corner", fill=114.0)


@dataclass(frozen=True)
class Layout:
    """How pictures enter a network, how boxes leave it, and what its classes are called."""

    entry: Entry
    """What is usual for networks of the kind."""
    class_names: Sequence[str]
    decode: Callable[[Outputs], Candidates]
    """The outputs of one call → candidates in pixels of the network's input."""


Find = Callable[[Outputs, Size, Sequence[str] | None, Options], Layout | None]


def find_layout(outputs: Outputs, size: Size, names: Sequence[str] | None, say: Options) -> Layout:
    """Tell the layout from the ``outputs`` for a picture of zeros.

    Args:
        size: height and width of the network's input.
        names: class names where they are known.
        say: what the user states.

    Raises:
        Unknown: nothing fits.
    """
    finders: dict[str, Find] = {
        "detections": _detections,
        "rows": _rows,
        "detr": _detr,
        "yolo": partial(_dense, kind="yolo"),
        "yolox": partial(_dense, kind="yolox"),
        "distribution": partial(_dense, kind="distribution"),
    }
    unsaid: list[Find] = [_detections, _rows, _detr, _dense]
    tried = [finders[say.layout]] if say.layout else unsaid
    for find in tried:
        layout = find(outputs, size, names, say)
        if layout is not None:
            return layout
    raise Unknown("of no known layout")


def _detections(
    outputs: Outputs, size: Size, names: Sequence[str] | None, say: Options
) -> Layout | None:
    """MMDetection's ``dets`` and ``labels``, RT-DETR's ``labels``, ``boxes`` and ``scores``."""
    labels, scores = _labels(outputs), _named(outputs, "score", "conf")
    boxes = _boxes(outputs, 4, 5)
    if labels is None or boxes is None or outputs[labels].shape != outputs[boxes].shape[:-1]:
        return None
    if scores is None and outputs[boxes].shape[-1] == 4:
        return None
    class_names = names or COCO

    def decode(found: Outputs) -> Candidates:
        rows, label = found[boxes], found[labels]
        score = found[scores] if scores else rows[..., 4]
        corners = corners_in_pixels(rows[..., :4], size, say, xyxy=True)
        return of_labels(corners, score, label, len(class_names))

    return Layout(MMDETECTION if outputs[boxes].shape[-1] == 5 else PLAIN, class_names, decode)


def _rows(outputs: Outputs, size: Size, names: Sequence[str] | None, say: Options) -> Layout | None:
    """Boxes after suppression with everything in one row."""
    name = _boxes(outputs, 6)
    dense = [n * len(cells_of_strides(size, s)) for s in STRIDES for n in ANCHORS_PER_CELL]
    if name is None or outputs[name].shape[-2] in dense:  # YOLOv5 with one class has six columns
        return None
    class_names = names or COCO
    label_first = outputs[name].ndim == 2

    def decode(found: Outputs) -> Candidates:
        rows = found[name]
        label, score, box = (
            (rows[..., 0], rows[..., 1], rows[..., 2:])
            if label_first
            else (rows[..., 5], rows[..., 4], rows[..., :4])
        )
        corners = corners_in_pixels(box, size, say, xyxy=True)
        return of_labels(corners, score, label, len(class_names))

    return Layout(IMAGENET if label_first else YOLO, class_names, decode)


def _detr(outputs: Outputs, size: Size, names: Sequence[str] | None, say: Options) -> Layout | None:
    """A set of boxes beside a set of scores (Carion et al. 2020)."""
    sets = {name: o for name, o in outputs.items() if o.ndim == 3}
    boxes = next((name for name, o in sets.items() if o.shape[2] == 4), None)
    if boxes is None:
        return None
    count = sets[boxes].shape[1]
    scores = next((n for n, o in sets.items() if n != boxes and count in o.shape[1:]), None)
    if scores is None:
        return None
    upright = sets[scores].shape[1] == count
    first = sets[scores] if upright else sets[scores].mT
    class_names, surplus = classes_of(first.shape[2], names)
    activation = say.activation or find_activation(first, surplus)
    xyxy = bool((sets[boxes][..., 2:] >= sets[boxes][..., :2]).all())
    parts = are_parts(sets[boxes])

    def decode(found: Outputs) -> Candidates:
        values = activate(found[scores] if upright else found[scores].mT, activation)
        corners = corners_in_pixels(found[boxes], size, say, xyxy=xyxy, parts=parts)
        return without_objectness(corners, values[..., : len(class_names)])

    plain = parts and len(class_names) == len(COCO) and not surplus
    return Layout(PLAIN if plain else IMAGENET, class_names, decode)


def _dense(
    outputs: Outputs,
    size: Size,
    names: Sequence[str] | None,
    say: Options,
    kind: str | None = None,
) -> Layout | None:
    """One row of values per cell or anchor, all levels behind each other."""
    table, class_names = _table(outputs, names, any_width=kind is not None)
    first = table(outputs)
    cells, one_per_cell = _cells_of(first, size, say)
    surplus = first.shape[2] - len(class_names)
    if kind is None:
        kind = "yolo" if surplus in (4, 5) else "distribution"
        if surplus == 5 and one_per_cell and is_undecoded(first, cells):
            kind = "yolox"
    if kind != "yolo" and not one_per_cell:
        raise Unknown(f"{first.shape[1]} rows for {len(cells)} cells")
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
        if any_width:
            widths |= set(range(classes + 4, classes + LARGEST_WIDTH))
        for name, table in tables.items():
            if table.shape[2] in widths:
                return lambda found, name=name: found[name], class_names
            if table.shape[1] in widths:
                return lambda found, name=name: found[name].mT, class_names
    raise Unknown("of no known layout for " + " or ".join(f"{len(k)} classes" for k in known))


def _levels(tables: Outputs, classes: int) -> list[tuple[str, str]]:
    """Outputs that come in pairs, scores and distributions of one level; the finest first."""
    scores = [name for name, o in tables.items() if o.shape[2] == classes]
    sides = [n for n, o in tables.items() if n not in scores and o.shape[2] in SIDE_WIDTHS]
    if len(scores) != len(sides):
        return []
    by_rows = [sorted(names, key=lambda n: -tables[n].shape[1]) for names in (scores, sides)]
    return list(zip(*by_rows, strict=True))


def _join(found: Outputs, levels: Sequence[tuple[str, str]]) -> Rows:
    """Level under level, the distributions beside the scores."""
    return torch.cat([torch.cat([found[name] for name in pair], dim=2) for pair in levels], dim=1)


def _cells_of(rows: Rows, size: Size, say: Options) -> tuple[Cells, bool]:
    """The cells to which ``rows`` belong, and whether each has one row."""
    grids = [
        cells_of_strides(size, strides) for strides in ((say.strides,) if say.strides else STRIDES)
    ]
    grid = next((g for g in grids if len(g) == rows.shape[1]), None)
    return (grids[0], False) if grid is None else (grid, True)


def _boxes(outputs: Outputs, *widths: int) -> str | None:
    """The first output with so many columns, with or without a batch."""
    tables = (n for n, o in outputs.items() if o.ndim in (2, 3) and o.shape[-1] in widths)
    return next(tables, None)


def _labels(outputs: Outputs) -> str | None:
    """The output that numbers classes, by its name or else by holding whole numbers."""
    whole = [n for n, o in outputs.items() if not o.is_floating_point() and o.numel() != 1]
    return _named(outputs, "label", "class") or next(iter(whole), None)


def _named(outputs: Outputs, *words: str) -> str | None:
    """The first output whose name holds one of ``words``."""
    return next((n for n in outputs if any(word in n.lower() for word in words)), None)
