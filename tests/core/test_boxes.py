"""Boxes against counted pixels."""

import pytest
import torch

from cnca.core import boxes


def pixels(box):
    """The box of whole pixels as a set of cells."""
    left, top, right, bottom = (int(v) for v in box)
    return {(x, y) for x in range(left, right) for y in range(top, bottom)}


def test_iou_counts_pixels():
    generator = torch.Generator().manual_seed(1)
    low = torch.randint(0, 10, (30, 2), generator=generator)
    size = torch.randint(1, 10, (30, 2), generator=generator)
    some = torch.cat([low, low + size], dim=1).float()
    overlap = boxes.iou_matrix(some[:10], some[10:])
    for i, first in enumerate(some[:10]):
        for j, second in enumerate(some[10:]):
            a, b = pixels(first), pixels(second)
            assert overlap[i, j] == pytest.approx(len(a & b) / len(a | b))


@pytest.mark.parametrize("empty", [[3, 3, 3, 3], [5, 5, 2, 2], [1, 1, 1, 9]])
def test_empty_boxes_overlap_nothing_with_finite_gradient(empty):
    box = torch.tensor([empty], dtype=torch.float32, requires_grad=True)
    overlap = boxes.iou(box, box.detach())
    overlap.sum().backward()
    assert overlap.item() == 0
    assert box.grad.isfinite().all()


def test_iou_never_exceeds_one():
    generator = torch.Generator().manual_seed(2)
    low = torch.rand(20000, 2, generator=generator) * 800
    same = torch.cat([low, low + torch.rand(20000, 2, generator=generator) * 300], dim=1)
    assert boxes.iou(same, same).max() <= 1


def test_iou_gradient_matches_finite_differences():
    first = torch.tensor([[1.0, 2.0, 6.0, 7.5]], dtype=torch.float64, requires_grad=True)
    second = torch.tensor([[3.0, 1.0, 9.0, 5.0]], dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda b: boxes.iou(b, second), first)


def test_notations_are_inverse():
    box = torch.tensor([[1.0, 2.0, 6.0, 8.0]])
    assert boxes.xyxy_to_cxcywh(box).tolist() == [[3.5, 5.0, 5.0, 6.0]]
    assert torch.equal(boxes.cxcywh_to_xyxy(boxes.xyxy_to_cxcywh(box)), box)


def test_clip_leaves_no_area_outside():
    clipped = boxes.clip(torch.tensor([[-5.0, 2.0, 30.0, 9.0], [40.0, 40.0, 50.0, 50.0]]), 8, 20)
    assert clipped.tolist() == [[0.0, 2.0, 20.0, 8.0], [20.0, 8.0, 20.0, 8.0]]
    assert boxes.area(clipped).tolist() == [120.0, 0.0]
