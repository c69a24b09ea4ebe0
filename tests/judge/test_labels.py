"""Labels of photographs, in COCO's and in Pascal VOC's format."""

import json

import pytest
from PIL import Image

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
    with pytest.raises(RunError, match="no .xml and no .txt in this folder"):
        read_labels(photos, tmp_path / "empty")


@pytest.mark.parametrize("name", [r"C:\photos\b.png", "/somewhere/x/b.png", "B.PNG", "./b.png"])
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


class TestYolo:
    """Class, centre and size; the picture's own size is what they are parts of."""

    @pytest.fixture
    def pictures(self, tmp_path):
        for name in ("a.png", "night/b.jpg"):
            path = tmp_path / "photos" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            Image.new("RGB", (40, 30)).save(path)
        return tmp_path / "photos"

    def test_boxes(self, pictures, tmp_path):
        write(tmp_path / "labels" / "a.txt", "2 0.5 0.5 0.25 0.2\n0 0.1 0.1 0.1 0.1\n")
        write(tmp_path / "labels" / "night" / "b.txt", "\n")
        first, second = read_labels(pictures, tmp_path / "labels")
        assert first.boxes(("car",)).tolist() == [[15, 12, 25, 18]]
        assert first.objects.keys() == {"car"}
        assert (first.size, second.group, second.objects) == ((40, 30), "night", {})

    @pytest.mark.parametrize("beside", [False, True])
    def test_names(self, pictures, tmp_path, beside):
        """A class that does not tell vehicles apart counts as cars."""
        write(tmp_path / "labels" / "a.txt", "0 0.5 0.5 0.5 0.5\n1 0.5 0.5 0.1 0.1\n")
        if beside:
            write(tmp_path / "labels" / "classes.txt", "vehicle\nbike\n")
        (photo,) = read_labels(pictures, tmp_path / "labels", None if beside else "vehicle, bike")
        assert photo.objects == {"car": [[10, 7.5, 30, 22.5]]}

    @pytest.mark.parametrize(
        ("line", "message"),
        [
            ("car 1 2 3 4", r"a\.txt, line 1: 'car 1 2 3 4' is not class, centre and size"),
            ("2 0.5 0.5", "is not class, centre and size"),
            ("80 0.5 0.5 0.1 0.1", "class 80 has no name, there are 80; say --label-names"),
        ],
    )
    def test_wrong_lines(self, pictures, tmp_path, line, message):
        write(tmp_path / "labels" / "a.txt", line)
        with pytest.raises(RunError, match=message):
            read_labels(pictures, tmp_path / "labels")

    def test_no_picture(self, pictures, tmp_path):
        write(tmp_path / "labels" / "c.txt", "2 0.5 0.5 0.25 0.2")
        with pytest.raises(RunError, match=r"c\.txt: no picture c\.jpg or \.png"):
            read_labels(pictures, tmp_path / "labels")
