"""Training of the EFR on pairs whose relation is known."""

from __future__ import annotations

import pytest
import torch

from cnca.color import linear_to_srgb
from cnca.efr.train import Shot, mean_absolute_error, train
from cnca.efr.unet import EnvironmentFeatureRenderer
from cnca.errors import NonFiniteError


def shots(count: int, seed: int) -> list[Shot]:
    """Renders twice as bright as the truth, on the left half of the picture."""
    chance = torch.Generator().manual_seed(seed)
    mask = torch.zeros(1, 18, 22)
    mask[..., :11] = 1
    made = []
    for _ in range(count):
        truths = torch.rand(3, 3, 18, 22, generator=chance) * 0.4 + 0.05
        reference = torch.rand(3, 18, 22, generator=chance)
        made.append(Shot(reference, torch.where(mask > 0, 2 * truths, truths), truths, mask))
    return made


def test_learns_and_keeps_the_best_epoch():
    test, reported = shots(2, seed=1), []
    outcome = train(
        shots(6, seed=0), test, seed=0, epochs=8, after_epoch=lambda *pair: reported.append(pair)
    )
    assert [error for _, error in reported] == outcome.after
    assert min(outcome.after) < 0.5 * outcome.before
    assert mean_absolute_error(outcome.network, test) == pytest.approx(min(outcome.after))
    assert not any(p.requires_grad for p in outcome.network.parameters())


def test_same_seed_same_weights():
    first, second = (train(shots(2, 0), shots(1, 1), seed=3, epochs=1).network for _ in range(2))
    for a, b in zip(first.state_dict().values(), second.state_dict().values(), strict=True):
        assert torch.equal(a, b)


def test_an_epoch_that_only_harms_is_not_kept():
    """The test set is right already: the identity stays."""
    test = [Shot(s.reference, s.truths, s.truths, s.mask) for s in shots(2, seed=1)]
    outcome = train(shots(2, seed=0), test, seed=0, epochs=2)
    assert outcome.before == 0
    assert mean_absolute_error(outcome.network, test) == 0


def test_the_error_is_that_of_the_vehicles_display_values():
    (shot,) = shots(1, seed=0)
    part = (..., slice(None), slice(0, 11))
    expected = (linear_to_srgb(shot.renders[part]) - linear_to_srgb(shot.truths[part])).abs().mean()
    found = mean_absolute_error(EnvironmentFeatureRenderer(), [shot])
    assert found == pytest.approx(expected.item(), rel=1e-5)


def test_a_loss_that_is_not_finite_is_named():
    (bad,) = shots(1, seed=0)
    bad.renders[0, 0, 3, 3] = float("nan")
    with pytest.raises(NonFiniteError, match="epoch 0, shot 0"):
        train([bad], [bad], seed=0, epochs=1)
