"""Pictures, read back with OpenCV."""

import cv2
import numpy as np
import pytest
import torch

from cnca.core.errors import RunError
from cnca.core.pictures import FOUND, TRUTH, as_pictures, draw_boxes, side_by_side, write_png
from cnca.core.types import Detections


def test_as_pictures_rounds_and_clips():
    images = torch.tensor([-0.5, 0.0, 0.5, 1.0, 2.0]).expand(1, 3, 1, 5)
    assert as_pictures(images)[0][0, :, 0].tolist() == [0, 0, 128, 255, 255]


def test_boxes_are_drawn_on_a_copy():
    picture = np.zeros((60, 80, 3), np.uint8)
    found = Detections(
        torch.tensor([[10.0, 30.0, 40.0, 50.0]]), torch.tensor([0.5]), torch.tensor([0])
    )
    drawn = draw_boxes(picture, found, ["car"], torch.tensor([50.0, 20.0, 70.0, 55.0]))
    assert not picture.any()
    assert tuple(drawn[50, 25]) == FOUND
    assert tuple(drawn[40, 70]) == TRUTH


def test_labels_of_boxes_in_one_place_do_not_hide_each_other():
    def reddish(count: int) -> int:
        found = Detections(
            torch.tensor([[10.0, 70.0, 90.0, 90.0]]).expand(count, 4),
            torch.full((count,), 0.5),
            torch.zeros(count, dtype=torch.long),
        )
        drawn = draw_boxes(np.zeros((100, 100, 3), np.uint8), found, ["car"])
        return int((drawn[..., 0] > 0).sum())

    areas = [reddish(count) for count in (1, 2, 3)]
    assert areas[2] - areas[1] == areas[1] - areas[0] > 500


def test_side_by_side_places_tiles():
    tiles = [np.full((4, 6, 3), value, np.uint8) for value in (10, 20, 30)]
    sheet = side_by_side(tiles, columns=2)
    assert sheet.shape == (8, 12, 3)
    assert [sheet[0, 0, 0], sheet[0, 6, 0], sheet[4, 0, 0], sheet[4, 6, 0]] == [10, 20, 30, 0]
    assert side_by_side(tiles, ["a", "b", "c"]).shape[0] > 4


@pytest.mark.parametrize(("width", "height"), [(7, 4), (12, 8), (25, 16)])
def test_a_sheet_has_the_stated_width(width, height):
    tiles = [np.full((4, 6, 3), value, np.uint8) for value in (10, 20, 30)]
    sheet = side_by_side(tiles, columns=2, width=width)
    assert sheet.shape == (height, width, 3)
    half = width // 2
    assert [sheet[0, 0, 0], sheet[0, half, 0], sheet[-1, half - 1, 0]] == [10, 20, 30]
    assert not sheet[:, 2 * half :].any()


def test_png_round_trip_keeps_channel_order(tmp_path):
    picture = np.random.default_rng(0).integers(0, 256, (5, 7, 3), np.uint8)
    write_png(tmp_path / "new" / "a.png", picture)
    read = cv2.cvtColor(cv2.imread(str(tmp_path / "new" / "a.png")), cv2.COLOR_BGR2RGB)
    assert np.array_equal(read, picture)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.png"]


def test_png_into_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RunError, match=r"a\.png: cannot be written"):
        write_png(tmp_path / "file" / "a.png", np.zeros((2, 2, 3), np.uint8))
