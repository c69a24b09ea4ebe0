"""Streets to train on: the boxes are where the vehicles are, and a scene is known by its number."""

import numpy as np
import pytest

from cnca.train.detector import street_renders
from cnca.train.detector.dataset import LabelledPictures
from cnca.train.detector.parts import Picture, join, save_part


def picture(group, boxes):
    return Picture(np.zeros((8, 12, 3), np.uint8), boxes, group)


def test_the_first_scenes_are_for_testing(tmp_path):
    parts = [tmp_path / f"{k}.npz" for k in range(5)]
    for k, part in enumerate(parts):
        save_part(part, [picture(f"g{k}", [[1.0, 2.0, 5.0, 6.0, 0]]), picture("empty", [])])
    join(tmp_path, parts, test_share=0.3)
    data = LabelledPictures(tmp_path)
    assert data.split == ["test"] * 4 + ["train"] * 6
    assert data.groups[::2] == ["g0", "g1", "g2", "g3", "g4"]
    assert [len(boxes) for boxes in data.boxes] == [1, 0] * 5


@pytest.mark.parametrize("seed", range(20))
def test_drivers_look_along_the_road(seed):
    view = street_renders.driver(np.random.default_rng(seed))
    ahead = np.subtract(view.target, view.origin)
    assert abs(ahead[1]) < abs(ahead[0])
    assert 1.3 <= view.origin[2] <= 2.6


@pytest.mark.slow
def test_a_scene_shows_traffic_where_its_boxes_are(tmp_path, monkeypatch):
    monkeypatch.setattr(street_renders, "SAMPLES", 4)
    monkeypatch.setattr(street_renders, "VIEWS", 2)
    monkeypatch.setattr(street_renders, "WEATHERS", 1)
    street_renders.render_streets(tmp_path / "a", pictures=2, seed=3)
    data = LabelledPictures(tmp_path / "a")
    assert set(data.groups) == {"street"}
    boxes = np.concatenate(data.boxes)
    assert len(boxes) >= 2
    assert ((boxes[:, 2] - boxes[:, 0]) >= street_renders.LEAST_WIDTH).all()
    before = [np.array(p) for p in data.pictures]
    street_renders.render_streets(tmp_path / "b", pictures=2, seed=3)
    after = LabelledPictures(tmp_path / "b").pictures
    assert all((one == other).all() for one, other in zip(before, after, strict=True))
