"""Patches of loud texture on training pictures."""

import numpy as np
import pytest

from cnca.train.detector import cover as covering
from cnca.train.detector.augment import augment
from cnca.train.detector.cover import LEAST_SEEN, cover, loud_textures
from cnca.train.detector.obstacles import CAR, OBSTACLE

LABELS = np.array([[10.0, 10.0, 60.0, 40.0, CAR], [70.0, 50.0, 95.0, 75.0, CAR]])
GREY = np.full((80, 100, 3), 137, np.uint8)


@pytest.fixture(autouse=True)
def always(monkeypatch):
    monkeypatch.setattr(covering, "CHANCE", 1.0)


def vehicles(labels):
    return labels[labels[:, 4] == CAR].tolist()


def test_a_vehicle_stays_while_half_of_its_box_is_free():
    """Counted anew from the changed pixels: a texture hardly ever has this very grey."""
    dropped = 0
    for seed in range(60):
        covered, labels = cover(GREY, LABELS, np.random.default_rng(seed))
        changed = (covered != GREY).any(axis=2)
        for label in LABELS:
            left, top, right, bottom = label[:4].astype(int)
            kept = label.tolist() in vehicles(labels)
            free = 1 - changed[top:bottom, left:right].mean()
            assert kept == (free >= LEAST_SEEN) or abs(free - LEAST_SEEN) < 0.02
            dropped += not kept
    assert 10 < dropped < 80


def test_each_patch_that_shows_is_an_obstacle_with_its_box():
    """Where one patch alone lies, its box is that of the changed pixels."""
    single = 0
    for seed in range(60):
        covered, labels = cover(GREY, LABELS[:0], np.random.default_rng(seed))
        changed = (covered != GREY).any(axis=2)
        assert (labels[:, 4] == OBSTACLE).all()
        if len(labels) == 1 and changed.any():
            rows, columns = np.nonzero(changed)
            around = columns.min(), rows.min(), columns.max() + 1, rows.max() + 1
            single += bool((abs(labels[0, :4] - around) <= 2).all())
        for left, top, right, bottom, _ in labels.astype(int):
            assert changed[top:bottom, left:right].mean() > 0.3
    assert single > 10


def test_patches_are_texture_and_the_rest_stays():
    covered, _ = cover(GREY, LABELS, np.random.default_rng(1))
    changed = (covered != GREY).any(axis=2)
    assert 0.02 < changed.mean() < 0.9
    assert covered[changed].std() > 5
    assert (GREY == 137).all()


def test_some_pictures_are_left_alone(monkeypatch):
    monkeypatch.setattr(covering, "CHANCE", 0.0)
    covered, labels = cover(GREY, LABELS, np.random.default_rng(0))
    assert covered is GREY
    assert labels is LABELS


def test_same_seed_same_picture():
    first, again, other = (cover(GREY, LABELS, np.random.default_rng(s))[0] for s in (5, 5, 6))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert loud_textures()[0].dtype == np.uint8


def test_augmenting_drops_what_is_covered():
    picture = np.full((80, 100, 3), 137, np.uint8)
    dropped = 0
    for seed in range(20):
        rngs = [np.random.default_rng(seed) for _ in range(2)]
        _, before = augment(picture, LABELS, (80, 100), rngs[0])
        _, after = augment(picture, LABELS, (80, 100), rngs[1], loud_patches=True)
        assert all(label in before.tolist() for label in vehicles(after))
        dropped += len(before) - len(vehicles(after))
    assert dropped > 3
