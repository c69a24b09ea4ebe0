"""Training of the EFR on pairs whose relation is known."""

from __future__ import annotations

import pytest
import torch

from cnca.core.color import linear_to_srgb
from cnca.core.errors import NonFiniteError, RunError
from cnca.core.types import PlainPictures
from cnca.efr.unet import EnvironmentFeatureRenderer
from cnca.train.efr import EfrTask, Shot, absolute_errors, train
from cnca.train.loop import TrainingLoop


def shots(count: int, seed: int) -> list[Shot]:
    """Renders twice as bright as the truth, on the left half of the picture."""
    chance = torch.Generator().manual_seed(seed)
    mask = torch.zeros(1, 18, 22)
    mask[..., :11] = 1
    made = []
    for _ in range(count):
        light = torch.rand(1, 3, 18, 22, generator=chance) * 0.5 + 0.1
        truths = light * (torch.rand(3, 3, 18, 22, generator=chance) * 0.8 + 0.1)
        plain = PlainPictures(traced=0.4 * light, drawn=0.8 * light)
        made.append(Shot(plain, torch.where(mask > 0, 2 * truths, truths), truths, mask))
    return made


def test_learns_and_keeps_the_best_epoch():
    test = shots(2, seed=1)
    outcome = train(TrainingLoop(None, 0), shots(6, seed=0), test, epochs=12)
    errors = [errors.mean() for errors in outcome.after]
    assert len(errors) == 12
    assert outcome.best.mean() == min(errors) < 0.5 * outcome.before.mean()
    torch.testing.assert_close(absolute_errors(outcome.network, test), outcome.best)
    assert not any(p.requires_grad for p in outcome.network.parameters())


def test_same_seed_same_weights():
    first, second = (
        train(TrainingLoop(None, 3), shots(2, 0), shots(1, 1), epochs=1).network for _ in range(2)
    )
    for a, b in zip(first.state_dict().values(), second.state_dict().values(), strict=True):
        assert torch.equal(a, b)


def test_an_epoch_that_only_harms_is_not_kept():
    """The test set is right already: the identity stays."""
    test = [Shot(s.plain, s.truths, s.truths, s.mask) for s in shots(2, seed=1)]
    outcome = train(TrainingLoop(None, 0), shots(2, seed=0), test, epochs=2)
    assert not outcome.before.any()
    assert not absolute_errors(outcome.network, test).any()


def test_the_error_is_that_of_the_vehicles_display_values():
    (shot,) = shots(1, seed=0)
    part = (..., slice(None), slice(0, 11))
    difference = linear_to_srgb(shot.renders[part]) - linear_to_srgb(shot.truths[part])
    found = absolute_errors(EnvironmentFeatureRenderer(), [shot])
    torch.testing.assert_close(found, difference.abs().mean(dim=(1, 2, 3)))


def test_a_loss_that_is_not_finite_is_named():
    (bad,) = shots(1, seed=0)
    bad.renders[0, 0, 3, 3] = float("nan")
    with pytest.raises(NonFiniteError, match="of efr, epoch 1, shot 0: a corrected picture"):
        train(TrainingLoop(None, 0), [bad], [bad], epochs=1)


def test_an_interrupted_training_ends_like_an_uninterrupted_one(tmp_path, monkeypatch):
    """Weights, errors and the best epoch, whose test error is not the last one's."""
    training, test = shots(3, seed=0), shots(2, seed=1)
    whole = train(TrainingLoop(tmp_path / "whole", 0), training, test, epochs=4)
    honest = EfrTask.batch

    def breaks(self, step, rng):
        if step == 7:  # in the third epoch
            raise KeyboardInterrupt
        return honest(self, step, rng)

    monkeypatch.setattr(EfrTask, "batch", breaks)
    with pytest.raises(KeyboardInterrupt):
        train(TrainingLoop(tmp_path / "parts", 0), training, test, epochs=4)
    monkeypatch.undo()
    resumed = train(TrainingLoop(tmp_path / "parts", 0, resume=True), training, test, epochs=4)
    for a, b in zip(whole.after, resumed.after, strict=True):
        assert torch.equal(a, b)
    a, b = whole.network.state_dict(), resumed.network.state_dict()
    assert all(torch.equal(a[name], b[name]) for name in a)
    with pytest.raises(RunError, match="efr.pt: was trained with shots=3, not 2; remove it"):
        train(TrainingLoop(tmp_path / "parts", 0, resume=True), training[:2], test, epochs=4)
