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
``grid``              maps of cells: FastestDet, YOLO-FastestV2 (:mod:`cnca.detect.onnx_single`)
====================  =====================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from cnca.core.types import Candidates
from cnca.detect.classes import COCO, COCO91
from cnca.detect.onnx_decode import (
    Size,
    Unknown,
    activate,
    are_parts,
    cells_of_strides,
    classes_of,
    corners_in_pixels,
    find_activation,
    of_labels,
    without_objectness,
)
from cnca.detect.onnx_dense import dense
from cnca.detect.onnx_layout import (
    ANCHORS_PER_CELL,
    BLUE_FIRST,
    BYTES,
    MMDETECTION,
    STRIDES,
    YOLO,
    Layout,
    Outputs,
)
from cnca.detect.onnx_options import Options
from cnca.detect.onnx_single import channels_of, fastestdet, yolo_fastest_v2
from cnca.detect.preprocess import IMAGENET, PLAIN

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
        "grid": _grid,
        "yolo": partial(dense, kind="yolo"),
        "yolox": partial(dense, kind="yolox"),
        "distribution": partial(dense, kind="distribution"),
    }
    unsaid: list[Find] = [_detections, _rows, _detr, _grid, dense]
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
    tensorflow = labels == "detection_classes"  # its API's names, and its notation
    class_names = names or (COCO91 if tensorflow else COCO)
    if tensorflow and say.boxes is None:
        say = say.model_copy(update={"boxes": "yxyx"})

    def decode(found: Outputs) -> Candidates:
        rows, label = found[boxes], found[labels]
        score = found[scores] if scores else rows[..., 4]
        corners = corners_in_pixels(rows[..., :4], size, say, xyxy=True, parts=tensorflow)
        return of_labels(corners, score, label, len(class_names))

    entry = MMDETECTION if outputs[boxes].shape[-1] == 5 else PLAIN
    return Layout(BYTES if tensorflow else entry, class_names, decode)


def _rows(outputs: Outputs, size: Size, names: Sequence[str] | None, say: Options) -> Layout | None:
    """Boxes after suppression with everything in one row."""
    name = _boxes(outputs, 6)
    per_cell = [n * len(cells_of_strides(size, s)) for s in STRIDES for n in ANCHORS_PER_CELL]
    if name is None or outputs[name].shape[-2] in per_cell:  # YOLOv5 with one class has six columns
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


def _grid(outputs: Outputs, size: Size, names: Sequence[str] | None, say: Options) -> Layout | None:
    """Outputs that keep rows and columns, all of one family."""
    del say  # nothing in these layouts is left open
    kinds = {name: channels_of(o.shape, names) for name, o in outputs.items() if o.ndim == 4}
    known = {name: kind for name, kind in kinds.items() if kind}
    families = {kind for kind, _ in known.values()}
    if families == {"yolo-fastest-v2"} and len(known) == 2:

        def decode(found: Outputs) -> Candidates:
            levels = [found[n].movedim(axis, 3) for n, (_, axis) in known.items()]
            return yolo_fastest_v2(levels, size)

    elif families == {"fastestdet"} and len(known) == 1:
        ((name, (_, axis)),) = known.items()

        def decode(found: Outputs) -> Candidates:
            return fastestdet(found[name].movedim(axis, 1), size)

    else:
        return None
    return Layout(BLUE_FIRST, names or COCO, decode)


def _boxes(outputs: Outputs, *widths: int) -> str | None:
    """The first output with one of these numbers of columns, with or without a batch."""
    tables = (n for n, o in outputs.items() if o.ndim in (2, 3) and o.shape[-1] in widths)
    return next(tables, None)


def _labels(outputs: Outputs) -> str | None:
    """The output with the numbers of classes, found by its name or else by its integers."""
    whole = [n for n, o in outputs.items() if not o.is_floating_point() and o.numel() != 1]
    return _named(outputs, "label", "class") or next(iter(whole), None)


def _named(outputs: Outputs, *words: str) -> str | None:
    """The first output whose name holds one of ``words``."""
    return next((n for n in outputs if any(word in n.lower() for word in words)), None)
