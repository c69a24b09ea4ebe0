"""Bootstrap intervals against closed forms."""

import math

import numpy as np
import pytest
import torch

from cnca.judge.bootstrap import Sampled, mean, resample


def sample_mean(values, *, seed=0, count=1000):
    weights = resample([len(values)], seed=seed, count=count)
    return Sampled(weights @ torch.tensor(values, dtype=torch.float64) / len(values))


def test_first_row_counts_every_view_once_and_scenes_keep_their_number():
    weights = resample([4, 9], seed=3, count=50)
    assert torch.equal(weights[0], torch.ones(13).double())
    assert (weights[:, :4].sum(dim=1) == 4).all()
    assert (weights[:, 4:].sum(dim=1) == 9).all()
    assert torch.equal(weights, resample([4, 9], seed=3, count=50))
    assert not torch.equal(weights, resample([4, 9], seed=4, count=50))


def test_the_interval_of_a_mean_is_the_central_limit_theorems():
    values = np.random.default_rng(1).normal(5.0, 2.0, size=400)
    low, high = sample_mean(values.tolist(), count=4000).interval()
    error = 1.96 * values.std() / math.sqrt(400)
    # A 2.5 % quantile of 4000 draws has a standard error of 0.042 σ: four of them.
    tolerance = 4 * 0.042 * error / 1.96
    assert low == pytest.approx(values.mean() - error, abs=tolerance)
    assert high == pytest.approx(values.mean() + error, abs=tolerance)


def test_the_interval_holds_the_truth_as_often_as_it_says():
    """300 experiments of 40 coin throws at p = 0.4."""
    rng = np.random.default_rng(7)
    held = 0
    for trial in range(300):
        throws = (rng.random(40) < 0.4).astype(float).tolist()
        low, high = sample_mean(throws, seed=trial, count=400).interval()
        held += low <= 0.4 <= high
    # Percentile intervals of 40 throws hold about 94 %; binomial σ over 300 is 1.4 %.
    assert held / 300 == pytest.approx(0.94, abs=4 * 0.014)


def test_a_difference_over_the_same_views_is_narrower():
    rng = np.random.default_rng(2)
    hard = rng.normal(size=100)
    one, other = (hard + 0.01).tolist(), hard.tolist()
    low, high = (sample_mean(one) - sample_mean(other)).interval()
    assert (low, high) == pytest.approx((0.01, 0.01))


def test_means_over_detectors():
    pair = mean([sample_mean([0.0, 1.0]), sample_mean([1.0, 1.0])])
    assert pair.value == pytest.approx(0.75)


def test_undefined_resamples_are_left_out_and_an_undefined_value_is_none():
    number = Sampled(torch.tensor([float("nan"), 1.0, float("nan"), 3.0]))
    assert number.estimate().value is None
    assert number.interval()[0] == pytest.approx(1.05)
