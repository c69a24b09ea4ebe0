"""The anchor-free head, and which cells its loss picks."""

import math

import pytest
import torch

from cnca.core.boxes import cxcywh_to_xyxy
from cnca.detect.anchor_free import USUAL_SIZE, AnchorFreeHead
from cnca.train.detector.anchor_free_loss import RADIUS, anchor_free_loss, assign, cell_places
from cnca.train.detector.yolo_loss import Targets


def test_boxes_by_hand():
    """Cell (2, 5) of stride 4: centre (2 + 0.25, 5 + 0.5) · 4 = (9, 22), size 4 · (e, e^0.5)."""
    raw = torch.zeros(1, 6, 8, 8)
    raw[0, :, 5, 2] = torch.tensor([0.25, 0.5, 1.0, 0.5, 0.0, math.log(3)])
    found = AnchorFreeHead(2).candidates(raw, (32, 32))
    width, height = 4 * math.e, 4 * math.e**0.5
    expected = [9 - width / 2, 22 - height / 2, 9 + width / 2, 22 + height / 2]
    assert found.boxes[0, 5 * 8 + 2].tolist() == pytest.approx(expected, rel=1e-5)
    assert found.class_scores[0, 5 * 8 + 2].tolist() == pytest.approx([0.5, 0.75])
    assert found.objectness.min() == found.objectness.max() == 1


def test_boxes_stay_finite_for_any_output():
    raw = torch.full((1, 5, 8, 8), 1e4, requires_grad=True)
    boxes = AnchorFreeHead(1).candidates(raw, (32, 32)).boxes
    boxes.sum().backward()
    assert boxes.isfinite().all()
    assert raw.grad.isfinite().all()


def test_start():
    bias = torch.full((6,), -1.0)
    AnchorFreeHead(2).start(bias, 0.01)
    found = AnchorFreeHead(2).candidates(bias[None, :, None, None].expand(1, 6, 8, 8), (32, 32))
    assert found.class_scores.unique().tolist() == pytest.approx([0.01])
    size = found.boxes[0, :, 2:] - found.boxes[0, :, :2]
    assert size.unique().tolist() == pytest.approx([4 * USUAL_SIZE])


def test_places_of_cells_by_hand():
    """Strides 32 × 16 and 64 × 64 in an input of 64 × 64."""
    places = cell_places([(2, 4), (1, 1)], (64, 64))
    rows = [[8.0, 16, 32], [24, 16, 32], [40, 16, 32], [56, 16, 32]]
    rows += [[x, 48, 32] for x in (8.0, 24, 40, 56)]
    assert places.tolist() == [*rows, [32.0, 32, 64]]


class TestAssignment:
    PLACES = torch.tensor([[x + 0.5, y + 0.5, 1] for y in range(16) for x in range(16)]) * 8.0

    def assign(self, boxes, scores, objects):
        return assign(boxes, scores, self.PLACES, objects)

    def test_best_cells_near_the_object(self):
        """The cell that finds it best wants the overlap as its score, the others less."""
        objects = torch.tensor([[40.0, 40, 88, 72]])
        boxes = self.PLACES[:, [0, 1, 0, 1]] + torch.tensor([-24.0, -16, 24, 16])
        cell, which, quality = self.assign(boxes, torch.full((256, 1), 0.5), objects)
        offset = self.PLACES[cell, :2] - torch.tensor([64.0, 56.0])
        assert (offset.abs() <= RADIUS * 8).all()
        assert (which == 0).all()
        # shifted by half a cell, (4, 4): intersection 44 · 28, union 2 · 48 · 32 less it
        best = 44 * 28 / (2 * 48 * 32 - 44 * 28)
        assert quality.max().item() == pytest.approx(best, abs=2e-3)
        assert (quality > 0).all()

    def test_a_cell_answers_for_one_object(self):
        objects = torch.tensor([[40.0, 40, 88, 72], [44.0, 44, 92, 76]])
        boxes = self.PLACES[:, [0, 1, 0, 1]] + torch.tensor([-24.0, -16, 24, 16])
        cell, which, _ = self.assign(boxes, torch.full((256, 2), 0.5), objects)
        assert len(cell.unique()) == len(cell)
        assert set(which.tolist()) == {0, 1}

    def test_boxes_that_all_miss(self):
        objects = torch.tensor([[40.0, 40, 88, 72]])
        boxes = torch.zeros(256, 4)
        cell, _, quality = self.assign(boxes, torch.full((256, 1), 0.01), objects)
        assert len(cell) > 0
        assert quality.isfinite().all()


@pytest.mark.parametrize("count", [0, 3])
def test_descends_to_the_objects(count):
    """Raw outputs alone, optimised freely, end at the targets and nowhere else."""
    heads = [AnchorFreeHead(1), AnchorFreeHead(1)]
    centres = torch.tensor([[10.0, 12, 9, 11], [40, 30, 22, 18], [50, 55, 12, 9]])[:count]
    boxes = cxcywh_to_xyxy(centres)
    images = torch.arange(count) % 2
    targets = Targets(boxes, torch.zeros(count, dtype=torch.long), images)
    raw = [torch.zeros(2, 5, side, side) for side in (8, 4)]
    for values in raw:
        AnchorFreeHead(1).start(values.view(2, 5, -1)[0, :, 0], 0.01)
        values.requires_grad_()
    optimizer = torch.optim.Adam(raw, 0.1)
    for _ in range(500):
        losses = anchor_free_loss(heads, raw, targets, (64, 64))
        optimizer.zero_grad()
        torch.stack(list(losses.values())).sum().backward()
        optimizer.step()
    for head, values in zip(heads, raw, strict=True):
        found = head.candidates(values.detach(), (64, 64))
        for image in range(2):
            for box in found.boxes[image][found.class_scores[image, :, 0] > 0.8]:
                assert (boxes[images == image] - box).abs().amax(dim=1).min() < 1
    scores = torch.cat([v.detach()[:, 4].flatten(1) for v in raw], dim=1).sigmoid().amax(dim=1)
    assert (scores > 0.8).tolist() == [count > 0, count > 1]
