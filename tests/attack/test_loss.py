"""Equation 11 against its closed form, and at its edges."""

import math

import pytest
import torch

from cnca.attack.loss import detection_loss
from cnca.core.types import Candidates

TARGET = torch.tensor([[10.0, 10.0, 30.0, 20.0]])


def candidates(boxes, objectness, car):
    """One image; the car's score stands in column 1 of 2."""
    scores = torch.stack([1 - car, car], dim=-1)[None]
    return Candidates(boxes[None], objectness[None], scores)


def test_closed_form():
    """IoU 0.5, D_c 0.8, D_o 0.9: D_s = 0.36; a surer box elsewhere does not count."""
    boxes = torch.tensor([[10.0, 10.0, 20.0, 20.0], [100.0, 100.0, 120.0, 110.0]])
    found = candidates(boxes, torch.tensor([0.9, 1.0]), torch.tensor([0.8, 1.0]))
    loss, scores = detection_loss(found, TARGET, 1)
    assert scores.tolist() == pytest.approx([0.36])
    assert loss.item() == pytest.approx(-math.log(1 - 0.36), rel=1e-6)


def test_an_overlap_that_counts_in_full():
    """IoU 0.5 and 0.25 against a full overlap of 0.5: weights 1 and 0.5."""
    boxes = torch.tensor([[10.0, 10.0, 20.0, 20.0], [10.0, 10.0, 15.0, 20.0]])
    found = candidates(boxes, torch.tensor([0.5, 0.9]), torch.ones(2))
    _, scores = detection_loss(found, TARGET, 1, full_overlap=0.5)
    assert scores.tolist() == pytest.approx([0.5])


def test_images_are_averaged():
    boxes = torch.tensor([[[10.0, 10.0, 20.0, 20.0]]] * 2)
    found = Candidates(boxes, torch.tensor([[0.4], [0.8]]), torch.ones(2, 1, 1))
    loss, scores = detection_loss(found, TARGET.expand(2, 4), 0)
    assert scores.tolist() == pytest.approx([0.2, 0.4])
    assert loss.item() == pytest.approx(-(math.log(0.8) + math.log(0.6)) / 2, rel=1e-6)


def test_gradient_matches_finite_differences():
    boxes = torch.tensor([[9.0, 11.0, 28.0, 21.5], [12.0, 8.0, 25.0, 18.0]], dtype=torch.float64)
    objectness = torch.tensor([0.7, 0.5], dtype=torch.float64)
    car = torch.tensor([0.6, 0.5], dtype=torch.float64)
    inputs = [x.requires_grad_() for x in (boxes, objectness, car)]
    target = TARGET.double()
    assert torch.autograd.gradcheck(lambda *x: detection_loss(candidates(*x), target, 1)[0], inputs)


def test_certain_detection_is_finite_and_still_pushes():
    one = torch.ones(1, requires_grad=True)
    loss, scores = detection_loss(candidates(TARGET, one, torch.ones(1)), TARGET, 1)
    loss.backward()
    assert scores.item() == 1
    assert loss.item() == pytest.approx(-math.log(torch.finfo(torch.float32).eps))
    assert torch.isfinite(one.grad)
    assert one.grad > 1e6


def test_missed_vehicle_costs_nothing():
    boxes = torch.tensor([[100.0, 100.0, 120.0, 110.0]], requires_grad=True)
    objectness = torch.ones(1, requires_grad=True)
    loss, scores = detection_loss(candidates(boxes, objectness, torch.ones(1)), TARGET, 1)
    loss.backward()
    assert (loss.item(), scores.item()) == (0, 0)
    assert boxes.grad.isfinite().all()
    assert objectness.grad.isfinite().all()


def test_no_candidates_at_all():
    boxes = torch.zeros(2, 0, 4, requires_grad=True)
    found = Candidates(boxes, torch.zeros(2, 0), torch.zeros(2, 0, 3))
    loss, scores = detection_loss(found, TARGET.expand(2, 4), 1)
    loss.backward()
    assert (loss.item(), scores.tolist()) == (0, [0, 0])


def test_target_without_area_costs_nothing():
    empty = torch.tensor([[15.0, 15.0, 15.0, 15.0]])
    boxes = TARGET.clone().requires_grad_()
    loss, _ = detection_loss(candidates(boxes, torch.ones(1), torch.ones(1)), empty, 1)
    loss.backward()
    assert loss.item() == 0
    assert boxes.grad.isfinite().all()
