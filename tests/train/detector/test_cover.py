"""Patches of loud texture on training pictures."""

import numpy as np
import pytest

from cnca.train.detector import cover as covering
from cnca.train.detector.augment import augment
from cnca.train.detector.cover import LEAST_SEEN, cover, loud_textures

BOXES = np.array([[10.0, 10.0, 60.0, 40.0], [70.0, 50.0, 95.0, 75.0]])
GREY = np.full((80, 100, 3), 137, np.uint8)


@pytest.fixture(autouse=True)
def always(monkeypatch):
    monkeypatch.setattr(covering, "CHANCE", 1.0)


def test_a_vehicle_stays_while_half_of_its_box_is_free():
    """Counted anew from the changed pixels: a texture hardly ever has this very grey."""
    dropped = 0
    for seed in range(60):
        covered, seen = cover(GREY, BOXES, np.random.default_rng(seed))
        changed = (covered != GREY).any(axis=2)
        for (left, top, right, bottom), kept in zip(BOXES.astype(int), seen, strict=True):
            free = 1 - changed[top:bottom, left:right].mean()
            assert kept == (free >= LEAST_SEEN) or abs(free - LEAST_SEEN) < 0.02
            dropped += not kept
    assert 10 < dropped < 80


def test_patches_are_texture_and_the_rest_stays():
    covered, _ = cover(GREY, BOXES, np.random.default_rng(1))
    changed = (covered != GREY).any(axis=2)
    assert 0.02 < changed.mean() < 0.9
    assert covered[changed].std() > 5
    assert (GREY == 137).all()


def test_pictures_without_vehicles_are_covered_too():
    covered, seen = cover(GREY, np.zeros((0, 4)), np.random.default_rng(2))
    assert (covered != GREY).any()
    assert seen.shape == (0,)


def test_some_pictures_are_left_alone(monkeypatch):
    monkeypatch.setattr(covering, "CHANCE", 0.0)
    covered, seen = cover(GREY, BOXES, np.random.default_rng(0))
    assert covered is GREY
    assert seen.all()


def test_same_seed_same_picture():
    first, again, other = (cover(GREY, BOXES, np.random.default_rng(s))[0] for s in (5, 5, 6))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert loud_textures()[0].dtype == np.uint8


def test_augmenting_drops_what_is_covered_and_says_which():
    picture = np.full((80, 100, 3), 137, np.uint8)
    dropped = 0
    for seed in range(20):
        rngs = [np.random.default_rng(seed) for _ in range(2)]
        _, boxes, kept = augment(picture, BOXES, (80, 100), rngs[0])
        _, free, seen = augment(picture, BOXES, (80, 100), rngs[1], loud_patches=True)
        assert len(boxes) == kept.sum()
        assert len(free) == seen.sum()
        assert not (seen & ~kept).any()
        np.testing.assert_array_equal(free, boxes[seen[kept]])
        dropped += int((kept & ~seen).sum())
    assert dropped > 3
