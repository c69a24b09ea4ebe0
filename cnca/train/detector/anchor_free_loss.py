"""The training loss of anchor-free heads, its cells chosen by task alignment (Feng et al. 2021).

Of the cells near an object, those that already fit it best answer for it: those with a high score
and a box that overlaps it.  The target of their score is the overlap that they reach.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits as cross_entropy

from cnca.core.boxes import iou_matrix, xyxy_to_cxcywh
from cnca.detect.anchor_free import AnchorFreeHead, Raw
from cnca.detect.grid import cell_corners
from cnca.train.detector.yolo_loss import Targets, ciou

BOX_WEIGHT = 3.0
RADIUS = 2.5
"""Most strides between the middle of a cell that answers and that of its object."""
MOST_CELLS = 9
SCORE_POWER, OVERLAP_POWER = 0.5, 4.0
"""α and β of the alignment score^α · IoU^β."""
LEAST_OVERLAP = 1e-3
"""Added to overlaps, so that cells whose boxes all miss the object can still be told apart."""


def anchor_free_loss(
    heads: list[AnchorFreeHead], raw: list[Raw], targets: Targets, size: tuple[int, int]
) -> dict[str, Float[Tensor, ""]]:
    """Return the losses ``box`` and ``class``, summed and divided by the wanted scores' sum.

    ``raw`` are the network's outputs in float32, ``size`` its input (height, width).
    """
    read = [head.read(values, size) for head, values in zip(heads, raw, strict=True)]
    boxes, logits = (torch.cat(part, dim=1) for part in zip(*read, strict=True))
    return aligned_loss(boxes, logits, cell_places([v.shape[2:] for v in raw], size), targets)


def aligned_loss(
    boxes: Float[Tensor, "batch cells 4"],
    logits: Float[Tensor, "batch cells classes"],
    places: Float[Tensor, "cells 3"],
    targets: Targets,
) -> dict[str, Float[Tensor, ""]]:
    """The same for boxes (xyxy in pixels) and class logits of the cells at ``places``."""
    places = places.to(boxes)
    wanted = torch.zeros_like(logits)
    box_loss = boxes.new_zeros(())
    for image in targets.images.unique().tolist():
        in_image = targets.images == image
        objects, labels = targets.boxes[in_image], targets.labels[in_image]
        scores = logits[image].detach().sigmoid()[:, labels]
        cell, which, quality = assign(boxes[image].detach(), scores, places, objects)
        wanted[image, cell, labels[which]] = quality
        distance = 1 - ciou(boxes[image, cell], objects[which])
        box_loss = box_loss + BOX_WEIGHT * (quality * distance).sum()
    total = wanted.sum().clamp(min=1.0)
    class_loss = cross_entropy(logits, wanted, reduction="sum")
    return {"box": box_loss / total, "class": class_loss / total}


def assign(
    boxes: Float[Tensor, "cells 4"],
    scores: Float[Tensor, "cells objects"],
    places: Float[Tensor, "cells 3"],
    objects: Float[Tensor, "objects 4"],
) -> tuple[Int[Tensor, " pairs"], Int[Tensor, " pairs"], Float[Tensor, " pairs"]]:
    """Cells that answer, the object of each, and the score in (0, 1] that it is to give.

    ``scores`` are those of each object's class; ``places`` are x, y of the cells' middles and
    their stride, in pixels.  Each object has at least one cell near it, but may lose it to
    another object that the cell's box overlaps more.
    """
    overlap = iou_matrix(boxes, objects) + LEAST_OVERLAP
    offset = places[:, None, :2] - xyxy_to_cxcywh(objects)[None, :, :2]
    near = (offset.abs() <= RADIUS * places[:, None, 2:]).all(dim=-1)
    alignment = scores**SCORE_POWER * overlap**OVERLAP_POWER * near
    best = alignment.topk(min(MOST_CELLS, len(boxes)), dim=0).indices
    chosen = torch.zeros_like(near).scatter(0, best, True) & near
    chosen &= overlap == torch.where(chosen, overlap, 0.0).amax(dim=1, keepdim=True)
    alignment, overlap = alignment * chosen, overlap * chosen
    quality = alignment / alignment.amax(dim=0).clamp(min=1e-12) * overlap.amax(dim=0)
    cell, which = torch.nonzero(chosen, as_tuple=True)
    return cell, which, quality[cell, which].clamp(max=1.0)


def cell_places(grids: Iterable[Sequence[int]], size: tuple[int, int]) -> Float[Tensor, "cells 3"]:
    """x and y of all cells' middles and their larger stride, in pixels of the input.

    ``grids`` are the (rows, columns) of each level, ``size`` the input's (height, width).
    """
    places = []
    for rows, columns in grids:
        strides = torch.tensor((size[1] / columns, size[0] / rows))
        middles = (cell_corners(rows, columns, strides) + 0.5) * strides
        widths = strides.amax().expand(rows, columns, 1)
        places.append(torch.cat([middles, widths], dim=-1).flatten(0, 1))
    return torch.cat(places)
