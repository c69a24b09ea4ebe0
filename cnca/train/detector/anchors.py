"""Anchors that suit a data set: k-means of box shapes (Redmon & Farhadi 2017, section 2)."""

from __future__ import annotations

import re

import torch
from jaxtyping import Float
from torch import Tensor

from cnca.core.boxes import iou_matrix

Sizes = Float[Tensor, "boxes 2"]


def shape_iou(first: Sizes, second: Float[Tensor, "others 2"]) -> Float[Tensor, "boxes others"]:
    """Overlap of boxes (width, height) that share their top left corner."""
    return iou_matrix(*(torch.cat([torch.zeros_like(s), s], dim=-1) for s in (first, second)))


def cluster_anchors(
    sizes: Sizes, count: int, rng: torch.Generator, *, rounds: int = 50
) -> Float[Tensor, "count 2"]:
    """Return ``count`` typical widths and heights, smallest area first.

    k-means under the distance 1 − IoU, begun at random boxes; a cluster that loses all its boxes
    stays where it was.
    """
    pick = torch.randperm(len(sizes), generator=rng)[torch.arange(count) % len(sizes)]
    centres = sizes[pick].clone()
    for _ in range(rounds):
        nearest = shape_iou(sizes, centres).argmax(dim=1)
        for index in range(count):
            if bool((nearest == index).any()):
                centres[index] = sizes[nearest == index].median(dim=0).values
    return centres[centres.prod(dim=1).argsort()]


def write_anchors(config: str, anchors: Float[Tensor, "count 2"]) -> str:
    """The text of a Darknet configuration with the ``anchors`` of all its heads replaced."""
    pairs = ", ".join(f"{width:.0f},{height:.0f}" for width, height in anchors.tolist())
    return re.sub(r"(?m)^anchors\s*=.*$", f"anchors={pairs}", config)
