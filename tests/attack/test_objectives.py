"""Every objective against its closed form, and at its edges."""

import math
from itertools import pairwise

import pytest
import torch

from cnca.attack.detection_scores import best_scores
from cnca.attack.objectives import load_objective, logit, objective_names, odds, paper
from cnca.core.errors import RunError
from cnca.core.types import Candidates
from cnca.scene.protocols import Objective

TARGET = torch.tensor([[10.0, 10.0, 30.0, 20.0]])
HALF, AWAY = [10.0, 10.0, 20.0, 20.0], [100.0, 100.0, 120.0, 110.0]


def candidates(boxes, objectness, car):
    """One image; the car's score stands in column 1 of 2."""
    scores = torch.stack([1 - car, car], dim=-1)[None]
    return Candidates(boxes[None], objectness[None], scores)


def certain_of(*scores: float) -> Candidates:
    """One image with boxes exactly on the vehicle."""
    sure = torch.tensor(scores)
    return candidates(TARGET.expand(len(scores), 4), sure, torch.ones(len(scores)))


def test_equation_11_in_closed_form():
    """IoU 0.5, D_c 0.8, D_o 0.9: D_s = 0.36; a surer box elsewhere does not count."""
    boxes = torch.tensor([HALF, AWAY])
    seen = candidates(boxes, torch.tensor([0.9, 1.0]), torch.tensor([0.8, 1.0]))
    assert best_scores(seen, TARGET, 1).tolist() == pytest.approx([0.36])
    assert paper.Loss()(seen, TARGET, 1).item() == pytest.approx(-math.log(1 - 0.36), rel=1e-6)


def test_an_overlap_that_counts_in_full():
    """IoU 0.5 and 0.25 against a full overlap of 0.5: weights 1 and 0.5."""
    boxes = torch.tensor([HALF, [10.0, 10.0, 15.0, 20.0]])
    seen = candidates(boxes, torch.tensor([0.5, 0.9]), torch.ones(2))
    assert best_scores(seen, TARGET, 1, full_overlap=0.5).tolist() == pytest.approx([0.5])
    assert logit.Loss()(seen, TARGET, 1).item() == pytest.approx(0, abs=1e-6)  # odds of one to one


def test_the_logit_pushes_as_hard_where_equation_11_has_let_go():
    """d logit / d logit = 1 wherever the score is; that of equation 11 is the score."""
    for score in (0.9, 0.1, 0.01):
        for loss, slope in ((logit.Loss(), 1.0), (paper.Loss(), score)):
            x = torch.tensor([math.log(score / (1 - score))], requires_grad=True)
            seen = candidates(TARGET, x.sigmoid(), torch.ones(1))
            (gradient,) = torch.autograd.grad(loss(seen, TARGET, 1).sum(), x)
            assert gradient.item() == pytest.approx(slope, rel=1e-3)


def test_the_logit_stops_at_its_clamps():
    assert logit.Loss()(certain_of(1e-6), TARGET, 1).item() == pytest.approx(math.log(1e-4), 1e-4)
    assert logit.Loss()(certain_of(1.0), TARGET, 1).item() == pytest.approx(math.log(1e6), 1e-2)


def test_the_odds_of_all_boxes_in_closed_form():
    """Scores 0.5 and 0.2, odds 1 and 1/4, against a cut of 0.2, odds 1/4: log(1 + 4 + 1)."""
    loss = odds.Loss(cut=0.2)(certain_of(0.5, 0.2), TARGET, 1)
    assert loss.item() == pytest.approx(math.log(6), rel=1e-5)


def test_the_odds_push_on_every_box_and_let_go_below_the_cut():
    sure = torch.tensor([0.6, 0.5, 1e-5], requires_grad=True)
    seen = candidates(TARGET.expand(3, 4), sure, torch.ones(3))
    odds.Loss()(seen, TARGET, 1).sum().backward()
    in_logits = sure.grad * sure.detach() * (1 - sure.detach())
    assert in_logits[0] + in_logits[1] == pytest.approx(1, abs=0.01)
    assert in_logits[1] > 0.3
    assert in_logits[2] < 1e-4


def test_the_odds_do_not_push_boxes_off_the_vehicle():
    boxes = torch.tensor([HALF, [12.0, 8.0, 25.0, 18.0]], requires_grad=True)
    sure = torch.tensor([0.7, 0.5], requires_grad=True)
    odds.Loss()(candidates(boxes, sure, torch.ones(2)), TARGET, 1).sum().backward()
    assert (sure.grad > 0).all()
    assert boxes.grad is None


@pytest.mark.parametrize("name", objective_names())
def test_gradients_match_finite_differences(name):
    boxes = torch.tensor([[9.0, 11.0, 28.0, 21.5], [12.0, 8.0, 25.0, 18.0]]).double()
    inputs = [torch.tensor(x).double().requires_grad_() for x in ([0.7, 0.5], [0.6, 0.5])]
    loss, target = load_objective(name), TARGET.double()
    assert torch.autograd.gradcheck(lambda *x: loss(candidates(boxes, *x), target, 1), inputs)


@pytest.mark.parametrize("name", objective_names())
def test_each_image_has_a_loss_that_grows_with_its_score(name):
    scores = torch.tensor([0.02, 0.2, 0.5, 0.9, 0.999])[:, None]
    seen = Candidates(TARGET.expand(5, 1, 4), scores, torch.ones(5, 1, 1))
    losses = load_objective(name)(seen, TARGET.expand(5, 4), 0)
    assert losses.shape == (5,)
    assert all(low < high for low, high in pairwise(losses.tolist()))


@pytest.mark.parametrize("name", objective_names())
def test_every_objective_is_finite_at_its_edges(name):
    loss = load_objective(name)
    assert isinstance(loss, Objective)
    empty, nothing = torch.tensor([[15.0, 15.0, 15.0, 15.0]]), torch.zeros(1, 0, 4)
    away = torch.tensor([AWAY])
    for boxes, target in ((TARGET, TARGET), (away, TARGET), (TARGET, empty)):
        inputs = [boxes.clone().requires_grad_(), torch.ones(1, requires_grad=True)]
        value = loss(candidates(*inputs, torch.ones(1)), target, 1).sum()
        value.backward()
        assert value.isfinite()
        assert all(x.grad is None or x.grad.isfinite().all() for x in inputs)
    none = Candidates(nothing, torch.zeros(1, 0), torch.zeros(1, 0, 3, requires_grad=True))
    least = loss(none, TARGET, 1)
    least.sum().backward()
    assert least.item() == min(0.0, least.item())


def test_a_certain_detection_costs_what_the_type_can_hold():
    one = torch.ones(1, requires_grad=True)
    loss = paper.Loss()(candidates(TARGET, one, torch.ones(1)), TARGET, 1)
    loss.backward()
    assert loss.item() == pytest.approx(-math.log(torch.finfo(torch.float32).eps))
    assert one.grad > 1e6


def test_unknown_objectives_name_the_nearest():
    with pytest.raises(RunError, match="objective 'logits': .* did you mean 'logit'"):
        load_objective("logits")
    with pytest.raises(RunError, match="full_overlap is 2"):
        load_objective("paper", full_overlap=2)


def test_the_overlap_that_is_given_goes_before_the_objectives_own():
    assert load_objective("paper", full_overlap=0.5) == paper.Loss(full_overlap=0.5)
    assert load_objective("odds") == odds.Loss()
