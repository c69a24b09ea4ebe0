"""Labels of photographs, in COCO's and in Pascal VOC's format."""

import json

import pytest

from cnca.core.errors import RunError
from cnca.judge.labels import read_labels

COCO = {
    "images": [
        {"id": 7, "file_name": "normal/a.png", "width": 40, "height": 30},
        {"id": 3, "file_name": "b.png"},
    ],
    "categories": [{"id": 1, "name": "Car"}, {"id": 2, "name": "bus"}, {"id": 5, "name": "dog"}],
    "annotations": [
        {"id": 1, "image_id": 7, "category_id": 1, "bbox": [1, 2, 10, 20]},
        {"id": 2, "image_id": 7, "category_id": 5, "bbox": [0, 0, 5, 5]},
        {"id": 3, "image_id": 7, "category_id": 1, "bbox": [0, 0, 40, 30], "iscrowd": 1},
        {"id": 4, "image_id": 3, "category_id": 2, "bbox": [3, 3, 1.5, 1.5], "iscrowd": 0},
    ],
}
VOC = """<annotation><folder>{folder}</folder><filename>{name}</filename>
<size><width>40</width><height>30</height><depth>3</depth></size>
<object><name>car</name><difficult>0</difficult>
<bndbox><xmin>2</xmin><ymin>3</ymin><xmax>11</xmax><ymax>22</ymax></bndbox></object>
<object><name>truck</name><difficult>1</difficult>
<bndbox><xmin>1</xmin><ymin>1</ymin><xmax>5</xmax><ymax>5</ymax></bndbox></object>
<object><name>cat</name><bndbox><xmin>1</xmin><ymin>1</ymin><xmax>5</xmax><ymax>5</ymax></bndbox>
</object></annotation>"""


@pytest.fixture
def photos(tmp_path):
    for name in ("normal/a.png", "b.png", "CNCA/a.png"):
        path = tmp_path / "photos" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")
    return tmp_path / "photos"


def write(path, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_coco(photos, tmp_path):
    first, second = read_labels(photos, write(tmp_path / "labels.json", COCO))
    assert (first.path, first.group, first.size) == (
        photos / "normal" / "a.png",
        "normal",
        (40, 30),
    )
    assert first.boxes(("car",)).tolist() == [[1, 2, 11, 22]]
    assert first.ignored == [[0, 0, 40, 30]]
    assert (second.group, second.size) == ("photos", None)
    assert second.boxes(("car",)).shape == (0, 4)
    assert second.boxes(("car", "truck", "bus")).tolist() == [[3, 3, 4.5, 4.5]]


@pytest.mark.parametrize("folder", ["", "CNCA"])
def test_voc_boxes_reach_the_borders_of_their_pixels(photos, tmp_path, folder):
    """Pixels 2 to 11 counted from 1 are those from 1.0 to 11.0 in continuous coordinates."""
    where = tmp_path / "xml" / ("" if folder else "CNCA") / "a.xml"
    write(where, VOC.format(folder=folder, name="a.png"))
    (photo,) = read_labels(photos, tmp_path / "xml")
    assert (photo.path, photo.group, photo.size) == (photos / "CNCA" / "a.png", "CNCA", (40, 30))
    assert photo.boxes(("car", "truck", "bus")).tolist() == [[1, 2, 11, 22]]
    assert photo.ignored == [[0, 0, 5, 5]]


def test_one_voc_file(photos, tmp_path):
    file = write(tmp_path / "b.xml", VOC.format(folder="anything", name="b.png"))
    (photo,) = read_labels(photos, file)
    assert photo.group == "photos"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("l.json", "{", "cannot be read"),
        ("l.json", {"images": []}, "'categories'"),
        ("l.json", [1], "COCO's images"),
        ("l.json", COCO | {"annotations": [{"bbox": [1, 2, 3]}]}, "COCO's images"),
        ("l.json", COCO | {"annotations": []}, "no object is labelled car, truck, bus"),
        (
            "l.json",
            COCO | {"images": [{"id": 7, "file_name": "c.png"}]},
            "names c.png, which is not",
        ),
        ("l.xml", "<annotation>", "cannot be read"),
        ("l.xml", "<annotation/>", "no filename"),
        (
            "l.xml",
            VOC.format(folder="", name="b.png").replace("<xmin>2</xmin>", ""),
            "no bndbox/xmin",
        ),
        ("l.txt", "", "give COCO .json"),
    ],
)
def test_bad_labels_are_one_line(photos, tmp_path, name, content, words):
    with pytest.raises(RunError, match=words) as caught:
        read_labels(photos, write(tmp_path / name, content))
    assert "\n" not in str(caught.value)


def test_missing_files_and_folders(photos, tmp_path):
    with pytest.raises(RunError, match="--photos .*: no such folder"):
        read_labels(tmp_path / "gone", tmp_path / "l.json")
    with pytest.raises(RunError, match="--labels .*: no such file"):
        read_labels(photos, tmp_path / "l.json")
    (tmp_path / "empty").mkdir()
    with pytest.raises(RunError, match="no .xml in this folder"):
        read_labels(photos, tmp_path / "empty")


@pytest.mark.parametrize("name", [r"C:\photos\b.png", "/home/x/b.png", "B.PNG", "./b.png"])
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_names_and_encodings_as_people_have_them(photos, tmp_path, name, encoding):
    content = {**COCO, "images": [COCO["images"][0], {"id": 3, "file_name": name}]}
    (tmp_path / "a.json").write_bytes(json.dumps(content).encode(encoding))
    assert read_labels(photos, tmp_path / "a.json")[1].path.samefile(photos / "b.png")


def test_voc_in_a_namespace(photos, tmp_path):
    text = VOC.format(folder="", name="b.png").replace(
        "<annotation>", '<annotation xmlns="http://a">'
    )
    (tmp_path / "b.xml").write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert read_labels(photos, tmp_path / "b.xml")[0].objects["car"] == [[1, 2, 11, 22]]
