"""Kept pictures and detections: the same key gives the same arrays, another one new ones."""

import numpy as np
import pytest
import torch

from cnca.core.types import Detections
from cnca.judge.gallery import digest, kept_detections, kept_pictures, recall


def test_made_once_for_a_key_and_anew_for_another(tmp_path):
    made = []

    def make():
        made.append(len(made))
        return {"n": np.array(len(made))}

    path = tmp_path / "deep" / "n.npz"
    assert [int(recall(path, key, make)["n"]) for key in ("a", "a", "b", "b", "a")] == [
        1, 1, 2, 2, 3,
    ]  # fmt: skip
    assert [p.name for p in path.parent.iterdir()] == ["n.npz"]


@pytest.mark.parametrize("left", [0, 10, 100])
def test_a_damaged_file_counts_as_missing(tmp_path, left):
    path = tmp_path / "n.npz"
    recall(path, "a", lambda: {"n": np.arange(5)})
    path.write_bytes(path.read_bytes()[:left])
    assert recall(path, "a", lambda: {"n": np.arange(7)})["n"].tolist() == list(range(7))


def test_nothing_is_left_of_what_could_not_be_made(tmp_path):
    def fail():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        recall(tmp_path / "n.npz", "a", fail)
    assert list(tmp_path.iterdir()) == []


def test_pictures_of_eight_bits_come_back_as_they_were(tmp_path):
    pictures = torch.randint(0, 256, (3, 3, 5, 7)) / 255
    for _ in range(2):
        assert torch.equal(kept_pictures(tmp_path / "p.npz", "a", lambda: pictures), pictures)


def test_detections_come_back_image_by_image(tmp_path):
    found = [
        Detections(torch.rand(n, 4), torch.rand(n), torch.randint(0, 9, (n,))) for n in (2, 0, 3)
    ]
    for _ in range(2):
        again = kept_detections(tmp_path / "d.npz", "a", lambda: found)
        for one, other in zip(found, again, strict=True):
            assert torch.equal(one.boxes, other.boxes)
            assert torch.equal(one.scores, other.scores)
            assert torch.equal(one.labels, other.labels)


def test_a_digest_tells_contents_types_and_shapes_apart():
    zeros = torch.zeros(2, 3)
    things = [zeros, zeros.T.contiguous(), zeros.double(), zeros + 1, "a", b"a", 1, (1,), None]
    assert len({digest(thing) for thing in things}) == len(things)
    assert digest(zeros, "a") == digest(torch.zeros(2, 3), "a") != digest("a", zeros)
