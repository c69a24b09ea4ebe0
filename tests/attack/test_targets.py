"""Ensembles: weights as users write them, and losses summed by weight."""

from dataclasses import dataclass

import pytest
import torch

from cnca.attack.objectives import paper
from cnca.attack.targets import (
    Target,
    look,
    parse_targets,
    readings,
    refuse_black_boxes,
    weighted_loss,
)
from cnca.core.errors import DetectorError, RunError
from cnca.core.types import Candidates
from tests.fakes import BOX, BrightnessDetector


@pytest.mark.parametrize(
    ("words", "weights"),
    [
        (["builtin"], {"builtin": 1.0}),
        (["builtin", "a.cfg=0.5"], {"builtin": 1.0, "a.cfg": 0.5}),
        (["runs/lr=0.1/a.cfg"], {"runs/lr=0.1/a.cfg": 1.0}),
        (["runs/lr=0.1=2"], {"runs/lr=0.1": 2.0}),
        (["torchvision:ssd:x=y.pt=1e-2"], {"torchvision:ssd:x=y.pt": 0.01}),
        (["=2"], {"=2": 1.0}),
    ],
)
def test_weights(words, weights):
    assert parse_targets(words) == weights


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([], "no --detector"),
        (["a.cfg=0"], "a.cfg=0: a weight is a finite number above 0"),
        (["a.cfg=-1"], "a weight is"),
        (["a.cfg=nan"], "a weight is"),
        (["a.cfg=inf"], "a weight is"),
        (["a.cfg", "a.cfg=2"], "a.cfg: is there twice"),
    ],
)
def test_no_weights(words, complaint):
    with pytest.raises(RunError, match=complaint):
        parse_targets(words)


@dataclass
class Power(BrightnessDetector):
    """Its confidence is a power of the picture's brightness."""

    exponent: int = 1
    differentiable: bool = True

    def candidates(self, images):
        score = images.mean(dim=(1, 2, 3))[:, None] ** self.exponent
        boxes = BOX.expand(len(images), 1, 4)
        return Candidates(boxes, torch.ones_like(score), score[..., None].expand(-1, 1, 2))


def test_losses_and_gradients_are_summed_by_weight():
    images = torch.tensor([0.5, 0.6])[:, None, None, None].expand(2, 3, 12, 12).clone()
    images.requires_grad_()
    boxes = BOX.expand(2, 4)
    ensemble = [Target("a", Power(), 0, 1.0), Target("b", Power(exponent=2), 0, 3.0)]
    seen = look(paper.Loss(), ensemble, images, boxes)
    losses = [paper.Loss()(t.detector.candidates(images), boxes, 0).mean() for t in ensemble]
    found = readings(ensemble, seen)
    a, b = found.targets["a"], found.targets["b"]
    assert found.loss_adv == pytest.approx((losses[0] + 3 * losses[1]).item())
    assert b.loss_adv == pytest.approx(losses[1].item())
    assert a.D_s == pytest.approx(0.55)
    assert b.D_s == pytest.approx((0.5**2 + 0.6**2) / 2)
    assert found.D_s == pytest.approx((0.55 + 3 * b.D_s) / 4)
    whole = weighted_loss(ensemble, seen)
    (gradient,) = torch.autograd.grad(whole, images, retain_graph=True)
    singly = [torch.autograd.grad(loss, images)[0] for loss in losses]
    assert torch.allclose(gradient, singly[0] + 3 * singly[1])


def test_black_boxes_are_named():
    targets = [Target("white", Power(), 0), Target("x.onnx", BrightnessDetector(), 0)]
    with pytest.raises(DetectorError, match=r"detector x\.onnx: gives no gradient"):
        refuse_black_boxes(targets)
