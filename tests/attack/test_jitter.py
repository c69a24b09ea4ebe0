"""Pictures move, and their boxes move with them."""

import pytest
import torch

from cnca.attack.jitter import SCALE, SHIFT, jittered
from cnca.scene.cameras import orbit_view

VIEWS = [orbit_view(k * 40, 12, 8, fov=40, width=96, height=64) for k in range(8)]


def bars(count: int = 8) -> tuple[torch.Tensor, torch.Tensor]:
    """A white block on black in each picture, and its box."""
    pictures = torch.zeros(count, 3, 64, 96)
    pictures[:, :, 20:44, 30:70] = 1
    return pictures, torch.tensor([[30.0, 20.0, 70.0, 44.0]]).expand(count, 4)


def test_the_box_stays_around_what_it_was_around():
    moved, boxes = jittered(*bars(), VIEWS, seed=3)
    for picture, box in zip(moved, boxes, strict=True):
        rows, columns = torch.where(picture[0] > 0.5)
        seen = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        assert torch.tensor(seen).sub(box).abs().max() <= 1


def test_shift_and_scale_stay_within_their_bounds_and_use_them():
    widths, ways = [], []
    for seed in range(20):
        _, boxes = jittered(*bars(), VIEWS, seed=seed)
        widths += ((boxes[:, 2] - boxes[:, 0]) / 40).tolist()
        ways += ((boxes[:, 0] + boxes[:, 2]) / 2 - 48).tolist()  # of a box about 2 from the middle
    assert 1 / (1 + SCALE) - 1e-4 <= min(widths) < 0.93
    assert 1.07 < max(widths) <= 1 + SCALE + 1e-4
    assert 0.8 * SHIFT * 96 < max(ways) <= SHIFT * 96 + 2.3


def test_a_view_is_moved_alike_whatever_stands_beside_it():
    pictures, boxes = bars()
    whole = jittered(pictures, boxes, VIEWS, seed=1)
    part = jittered(pictures[2:4], boxes[2:4], VIEWS[2:4], seed=1)
    assert torch.equal(whole[0][2:4], part[0])
    assert torch.equal(whole[1][2:4], part[1])
    other = jittered(pictures, boxes, VIEWS, seed=2)
    assert not torch.equal(whole[1], other[1])


def test_boxes_end_at_the_picture():
    pictures = torch.zeros(8, 3, 64, 96)
    _, boxes = jittered(pictures, torch.tensor([[0.0, 0.0, 96.0, 64.0]]).expand(8, 4), VIEWS, 0)
    assert (boxes >= 0).all()
    assert (boxes[:, 2] <= 96).all()
    assert (boxes[:, 3] <= 64).all()


def test_pictures_keep_a_gradient():
    pictures, boxes = bars()
    moved, _ = jittered(pictures.requires_grad_(), boxes, VIEWS, seed=1)
    moved.sum().backward()
    assert pictures.grad.sum().item() == pytest.approx(moved.numel(), rel=0.2)
