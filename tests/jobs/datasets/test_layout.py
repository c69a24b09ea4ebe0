"""The layout of data sets, read back by other people's tools."""

from __future__ import annotations

import json
import tarfile
from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from cnca.core.errors import RunError
from cnca.jobs.datasets.coco import RunLengths, category, run_lengths
from cnca.jobs.datasets.layout import DataSet
from cnca.scene.layers import Sighting


@dataclass(frozen=True)
class Note:
    caption: str
    seed: int


def picture(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 255, (12, 20, 3), np.uint8)


def mask(left: int = 3) -> np.ndarray:
    covered = np.zeros((12, 20))
    covered[2:7, left:10] = 1
    covered[7, left:10] = 0.25
    return covered


@pytest.fixture
def data(tmp_path) -> DataSet:
    data = DataSet(tmp_path / "set")
    for index in (0, 1, 1000):
        data.add(index, picture(index), mask(index % 7), Note("red", index))
    return data


def test_files_come_back(data):
    assert data.indices() == [0, 1, 1000]
    assert data.has(1)
    assert not data.has(2)
    read = cv2.imread(str(data.path("images", 1)))[..., ::-1]
    assert np.array_equal(read, picture(1))
    grey = cv2.imread(str(data.path("masks", 1)), cv2.IMREAD_GRAYSCALE) / 255
    assert np.allclose(grey, mask(1), atol=1 / 255)
    assert data.entry(0).record.box_xyxy == (0, 2, 10, 8)


@pytest.mark.parametrize(
    ("label", "number", "above"),
    [
        ("car", 3, "vehicle"),
        ("Truck", 8, "vehicle"),
        ("motorcycle", 4, "vehicle"),
        ("person", 1, "person"),
        ("tank", 91, "tank"),
    ],
)
def test_categories_are_numbered_as_coco_does(label, number, above):
    found = category(label)
    assert (found.id, found.supercategory) == (number, above)


def test_annotations_are_coco(data):
    coco_tools = pytest.importorskip("pycocotools.coco", reason="pycocotools is not installed")
    data.finish(tar=False)
    coco = coco_tools.COCO(str(data.folder / "annotations.json"))
    assert coco.getImgIds() == [0, 1, 1000]
    (annotation,) = coco.loadAnns(coco.getAnnIds(imgIds=[1000]))
    left = 1000 % 7
    assert np.array_equal(coco.annToMask(annotation), mask(left) >= 0.5)
    assert annotation["area"] == coco.annToMask(annotation).sum()
    assert annotation["bbox"] == [left, 2, 10 - left, 6]
    assert coco.loadCats(annotation["category_id"])[0]["name"] == "car"
    assert coco.loadImgs([1])[0]["seed"] == 1


def test_run_lengths_begin_with_what_is_empty():
    assert run_lengths(np.array([[1.0, 0], [0, 0]])) == RunLengths((2, 2), [0, 1, 3])
    assert run_lengths(np.zeros((2, 2))).counts == [4]


def test_tars_hold_a_thousand_numbers_each_and_have_the_same_bytes_each_time(data):
    data.finish(tar=True)
    tars = sorted((data.folder / "shards").iterdir())
    assert [tar.name for tar in tars] == ["000000.tar", "000001.tar"]
    first = tars[0].read_bytes()
    with tarfile.open(tars[0]) as tar:
        names = tar.getnames()
        record = json.load(tar.extractfile("000001.json"))
    assert names == [f"{k:06d}{e}" for k in (0, 1) for e in (".png", ".mask.png", ".json")]
    assert record["caption"] == "red"
    data.finish(tar=True)
    assert tars[0].read_bytes() == first


def test_the_contact_sheet_shows_the_pictures(data):
    data.finish(tar=False)
    sheet = cv2.imread(str(data.folder / "contact_sheet.png"))
    assert sheet.shape[1] == 3 * 20


def test_damaged_records_and_empty_pictures_are_refused(data):
    data.path("records", 1).write_text("{")
    with pytest.raises(RunError, match=r"000001\.json: damaged; delete it"):
        data.finish(tar=False)
    data.path("records", 0).write_text("{}")
    with pytest.raises(RunError, match=r"000000\.json: index: Field required; delete it"):
        data.entry(0)
    with pytest.raises(RunError, match="without the vehicle"):
        data.add(2, picture(2), np.zeros((12, 20)), Note("empty", 2))


def test_other_vehicles_are_annotated_with_categories_of_their_own(tmp_path):
    data = DataSet(tmp_path / "set", "truck")
    free, hidden = np.zeros((12, 20), bool), np.zeros((12, 20), bool)
    free[1:4, 12:18], hidden[8:10, 0:2] = True, True
    hidden[9, 1] = False
    others = [Sighting("car", free, 0.0), Sighting("Bus", hidden, 0.75)]
    data.add(0, picture(0), mask(), Note("a", 0), occluded=0.25, others=others)
    data.add(4, picture(4), mask(), Note("b", 4), others=others[:1])
    data.finish(tar=False)
    coco_tools = pytest.importorskip("pycocotools.coco")
    annotations = coco_tools.COCO(str(tmp_path / "set" / "annotations.json"))
    names = {kind["name"]: kind["id"] for kind in annotations.loadCats(annotations.getCatIds())}
    assert names == {"truck": 8, "car": 3, "bus": 6}
    assert len(annotations.getAnnIds()) == len(set(annotations.getAnnIds())) == 5
    own, car, bus = annotations.loadAnns(annotations.getAnnIds(imgIds=[0]))
    assert [a["category_id"] for a in (own, car, bus)] == [8, 3, 6]
    assert [a["occluded"] for a in (own, car, bus)] == [0.25, 0.0, 0.75]
    assert car["bbox"] == [12, 1, 6, 3]
    assert np.array_equal(annotations.annToMask(bus), hidden)
    assert bus["area"] == 3
    (_, there) = annotations.loadAnns(annotations.getAnnIds(imgIds=[4]))
    assert there["category_id"] == 3
