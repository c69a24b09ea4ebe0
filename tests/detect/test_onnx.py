"""Every layout of ONNX detectors, with boxes computed by hand.

All inputs are 64 × 96 and all pictures 32 × 48, so that boxes in pixels of the picture are half of
those in pixels of the input.
"""

import math

import numpy as np
import pytest
import torch

pytest.importorskip("onnx", reason="needs the package onnx to build graphs")

from onnx import TensorProto

from cnca.core.errors import DetectorError
from cnca.detect import load_detector
from tests.detect.graphs import SIZE, cells, write_echo, write_graph
from tests.detect.test_detectors import DetectorContract

CAR, TRUCK = 2, 7


def logit(probability):
    return math.log(probability / (1 - probability))


def detections_arrays():
    """MMDetection: two boxes and the fill that TensorRT exports add."""
    boxes = [[20, 10, 60, 40, 0.9], [0, 0, 10, 10, 0.4], [0, 0, 0, 0, 0]]
    return {"dets": np.array([boxes], np.float32), "labels": np.array([[CAR, TRUCK, -1]])}


def labels_boxes_scores():
    """RT-DETR's own export."""
    boxes = np.array([[[20, 10, 60, 40], [0, 0, 10, 10]]], np.float32)
    scores = np.array([[0.9, 0.4]], np.float32)
    return {"labels": np.array([[CAR, TRUCK]]), "boxes": boxes, "scores": scores}


def ultralytics_rows():
    rows = [[20, 10, 60, 40, 0.9, CAR], [0, 0, 10, 10, 0.4, TRUCK], [0] * 6]
    return {"output0": np.array([rows], np.float32)}


def paddle_rows():
    rows = [[CAR, 0.9, 20, 10, 60, 40], [TRUCK, 0.4, 0, 0, 10, 10]]
    return {"boxes": np.array(rows, np.float32), "count": np.array([2], np.int32)}


def sets(classes, car, fill, names):
    """DETR: (40, 25) ± (20, 15) px are 40/96, 25/64, 40/96, 30/64 of the input."""
    boxes = np.full((1, 5, 4), 0.3, np.float32)
    boxes[0, 1] = [40 / 96, 25 / 64, 40 / 96, 30 / 64]
    boxes[0, 2] = [0.9, 0.9, 0.1, 0.1]
    scores = np.full((1, 5, classes), fill, np.float32)
    scores[0, 1, car[0]] = car[1]
    return dict(zip(names, (scores, boxes), strict=True))


def detr_softmax():
    """92 logits: COCO by its numbers, the last for nothing; eᵗ / (eᵗ + 91) = 0.9."""
    return sets(92, (3, math.log(0.9 / 0.1 * 91)), 0.0, ("logits", "pred_boxes"))


def detr_sigmoid():
    return sets(80, (CAR, logit(0.9)), logit(0.01), ("pred_logits", "pred_boxes"))


def rf_detr():
    """Its outputs are called like MMDetection's and are something else."""
    arrays = sets(91, (3, logit(0.9)), logit(0.01), ("labels", "dets"))
    return {"dets": arrays["dets"], "labels": arrays["labels"]}


def picodet_decoded():
    """Boxes in pixels of the input, scores with the classes first."""
    boxes = np.zeros((1, 5, 4), np.float32)
    boxes[0, 1] = [20, 10, 60, 40]
    scores = np.zeros((1, 80, 5), np.float32)
    scores[0, CAR, 1] = 0.9
    return {"tmp_16": boxes, "concat_4": scores}


def rows_of(count, width):
    return np.full((1, count, width), 0.001, np.float32)


def yolov5():
    rows = rows_of(3 * len(cells((8, 16, 32))), 85)
    rows[0, 17, :5] = [40, 25, 40, 30, 0.96]
    rows[0, 17, 5 + CAR] = 0.9375
    return {"output": rows}


def yolov8():
    rows = rows_of(len(cells((8, 16, 32))), 84)
    rows[0, :, :2] = [[(x + 0.5) * s, (y + 0.5) * s] for x, y, s in cells((8, 16, 32))]
    rows[0, 17, :4] = [40, 25, 40, 30]
    rows[0, 17, 4 + CAR] = 0.9
    return {"output0": np.ascontiguousarray(rows.transpose(0, 2, 1))}


def rt_detr_rows():
    """Ultralytics' RT-DETR: like YOLOv8, not transposed, in parts of the picture."""
    rows = rows_of(30, 84)
    rows[0, 17, :4] = [40 / 96, 25 / 64, 40 / 96, 30 / 64]
    rows[0, 17, 4 + CAR] = 0.9
    return {"output0": rows}


def decoded_with_objectness():
    """YOLOv6, or YOLOX exported with decoding: shapes like YOLOX's raw head."""
    rows = rows_of(len(cells((8, 16, 32))), 85)
    rows[0, :, :2] = [[(x + 0.5) * s, (y + 0.5) * s] for x, y, s in cells((8, 16, 32))]
    rows[0, 17, :5] = [40, 25, 40, 30, 1]
    rows[0, 17, 5 + CAR] = 0.9
    return {"outputs": rows}


def yolox():
    """Cell (2, 1) of stride 16: centre (2.5, 1.5625) · 16, size e^0.916 · 16 = 40, …"""
    places = cells((8, 16, 32))
    rows = rows_of(len(places), 85)
    row = places.index((2, 1, 16))
    rows[0, row, :4] = [0.5, 0.5625, math.log(40 / 16), math.log(30 / 16)]
    rows[0, row, 4], rows[0, row, 5 + CAR] = 0.96, 0.9375
    return {"output": rows}


def distances(left, top, right, bottom, bins=8):
    """Logits of distributions with all weight in one bin, or half in each of two."""
    values = np.full((4, bins), -60, np.float32)
    for side, distance in enumerate((left, top, right, bottom)):
        values[side, [math.floor(distance), math.ceil(distance)]] = 0
    return values.ravel()


def nanodet(strides, place, sides):
    places = cells(strides)
    rows = rows_of(len(places), 80 + 32)
    row = places.index(place)
    rows[0, row, CAR] = 0.9
    rows[0, row, 80:] = distances(*sides)
    return {"output": rows}


def nanodet_three_levels():
    """Centre (2.5, 1.5) · 16 = (40, 24); 20, 14, 20, 16 px in strides is half-way between bins."""
    return nanodet((8, 16, 32), (4, 2, 8), (2, 1, 3, 2.5))


def nanodet_plus():
    """Corner (4, 2) · 8 = (32, 16)."""
    return nanodet((8, 16, 32, 64), (4, 2, 8), (1.5, 0.5, 3.5, 3))


def picodet():
    """Pairs per level, here in another order than that of the strides."""
    arrays = {}
    for stride in (32, 8, 64, 16):
        places = cells((stride,))
        scores, sides = rows_of(len(places), 80), rows_of(len(places), 32)
        if stride == 16:
            row = places.index((2, 1, 16))
            scores[0, row, CAR] = 0.9
            sides[0, row] = distances(1.5, 1, 1, 1.0)
        arrays[f"scores_{stride}"], arrays[f"sides_{stride}"] = scores, sides
    return arrays


def yolov8_seg():
    """32 weights of masks behind the scores, and the masks' pictures."""
    rows = yolov8()["output0"]
    rows = np.concatenate([rows, np.full((1, 32, rows.shape[2]), 3, np.float32)], axis=1)
    return {"output0": rows, "output1": np.zeros((1, 32, 16, 24), np.float32)}


def fastestdet():
    """Cell (2, 1) of 6 × 4: centre 2.5 of 6 and 25/16 of 4 cells, size σ(0) and σ of 30/64."""
    grid = np.full((1, 85, 4, 6), 1e-6, np.float32)
    box = [math.atanh(0.5), math.atanh(9 / 16), logit(40 / 96), logit(30 / 64)]
    grid[0, 1:5, 1, 2] = box
    grid[0, 0, 1, 2], grid[0, 5 + CAR, 1, 2] = 0.9, 0.9
    return {"758": grid}


def yolo_fastest_v2():
    """Second anchor of the coarse level, stride 16: centre (2.5, 1.5625) cells, (2σ)² anchors."""
    scale = np.array([96, 64]) / 352
    fine = np.full((1, 8, 12, 95), 0.001, np.float32)
    coarse = np.full((1, 4, 6, 95), 0.001, np.float32)
    anchor = np.array([131.57, 214.55]) * scale
    sizes = np.sqrt(np.array([40, 30]) / anchor) / 2
    coarse[0, 1, 2, 4:8] = [0.5, (9 / 16 + 0.5) / 2, *sizes]
    coarse[0, 1, 2, 12 + 1], coarse[0, 1, 2, 15 + CAR] = 0.96, 0.9375
    return {"794": fine, "796": coarse}


def tensorflow():
    """TF's object detection API: (y, x), parts of the picture, labels by COCO's numbers."""
    box = [[[10 / 64, 20 / 96, 40 / 64, 60 / 96], [0, 0, 0.1, 0.1]]]
    return {
        "detection_boxes": np.array(box, np.float32),
        "detection_classes": np.array([[3, 8]], np.float32),
        "detection_scores": np.array([[0.9, 0.4]], np.float32),
        "num_detections": np.array([2], np.float32),
    }


LAYOUTS = {
    "yolov8 seg": (yolov8_seg, [20, 10, 60, 40]),
    "fastestdet": (fastestdet, [20, 10, 60, 40]),
    # centre 2 · 0.5 − 0.5 + 2 = 2.5 and 1.5625 cells of 16
    "yolo-fastest v2": (yolo_fastest_v2, [20, 10, 60, 40]),
    "tensorflow": (tensorflow, [20, 10, 60, 40]),
    "mmdetection": (detections_arrays, [20, 10, 60, 40]),
    "rt-detr": (labels_boxes_scores, [20, 10, 60, 40]),
    "ultralytics rows": (ultralytics_rows, [20, 10, 60, 40]),
    "paddle rows": (paddle_rows, [20, 10, 60, 40]),
    "detr softmax": (detr_softmax, [20, 10, 60, 40]),
    "detr sigmoid": (detr_sigmoid, [20, 10, 60, 40]),
    "rf-detr": (rf_detr, [20, 10, 60, 40]),
    "picodet decoded": (picodet_decoded, [20, 10, 60, 40]),
    "yolov5": (yolov5, [20, 10, 60, 40]),
    "yolov8": (yolov8, [20, 10, 60, 40]),
    "rt-detr rows": (rt_detr_rows, [20, 10, 60, 40]),
    "yolov6": (decoded_with_objectness, [20, 10, 60, 40]),
    "yolox": (yolox, [20, 10, 60, 40]),
    # centre (4.5, 2.5) · 8 = (36, 20), less 2 and 1, plus 3 and 2.5 strides
    "nanodet": (nanodet_three_levels, [20, 12, 60, 40]),
    # corner (4, 2) · 8 = (32, 16), less 1.5 and 0.5, plus 3.5 and 3 strides
    "nanodet plus": (nanodet_plus, [20, 12, 60, 40]),
    # centre (2.5, 1.5) · 16 = (40, 24), less 1.5 and 1, plus 1 and 1 strides
    "picodet": (picodet, [16, 8, 56, 40]),
}


@pytest.fixture(params=LAYOUTS)
def layout(request, tmp_path):
    """A detector of each layout, and its best box in pixels of the input."""
    arrays, box = LAYOUTS[request.param]
    path = write_graph(tmp_path / "net.onnx", arrays())
    return load_detector(str(path)), torch.tensor(box, dtype=torch.float32)


def test_boxes_by_hand(layout):
    detector, box = layout
    best = detector.detect(torch.rand(1, 3, 32, 48))[0]
    assert detector.class_names[int(best.labels[0])] == "car"
    assert best.scores[0].item() == pytest.approx(0.9, rel=1e-5)
    torch.testing.assert_close(best.boxes[0], box / 2, rtol=1e-5, atol=1e-3)
    assert (best.labels == best.labels[0]).sum() == 1


class TestLayouts(DetectorContract):
    @pytest.fixture
    def detector(self, layout):
        return layout[0]


class TestInput:
    """The echo's box is the mean of the input's channels of a picture of its size."""

    RED = torch.tensor([0.8, 0.4, 0.2])[None, :, None, None].expand(1, 3, *SIZE)

    def echo(self, tmp_path, text, **options):
        path = write_echo(tmp_path / "echo.onnx", **options)
        (tmp_path / "echo.yaml").write_text(text)
        return load_detector(str(path)).candidates(self.RED).boxes[0, 0, :3].tolist()

    @pytest.mark.parametrize(
        ("text", "expected"),
        [
            ("white: 1\nmean: [0, 0, 0]\nstd: [1, 1, 1]", [0.8, 0.4, 0.2]),
            ("white: 255\nmean: [0, 0, 0]\nstd: [1, 1, 1]\nchannels: bgr", [51, 102, 204]),
            ("white: 1\nmean: [0.4, 0.2, 0.1]\nstd: [0.5, 0.2, 0.1]", [0.8, 1, 1]),
            # MMDetection's usual values
            ("", [(204 - 123.675) / 58.395, (102 - 116.28) / 57.12, (51 - 103.53) / 57.375]),
        ],
    )
    def test_colors(self, tmp_path, text, expected):
        assert self.echo(tmp_path, text) == pytest.approx(expected, rel=1e-4)

    def test_channels_last_and_bytes(self, tmp_path):
        text = "white: 255\nmean: [0, 0, 0]\nstd: [1, 1, 1]"
        shape = (1, *SIZE, 3)
        assert self.echo(tmp_path, text, shape=shape) == pytest.approx([204, 102, 51], rel=1e-5)
        found = self.echo(tmp_path, text, shape=shape, kind=TensorProto.UINT8)
        assert found == pytest.approx([204, 102, 51])

    def test_open_axes(self, tmp_path):
        shape = ("batch", 3, "height", "width")
        with pytest.raises(DetectorError, match=r"state size: \[height, width\] in echo\.yaml"):
            self.echo(tmp_path, "", shape=shape)
        text = "size: [64, 96]\nwhite: 1\nmean: [0, 0, 0]\nstd: [1, 1, 1]"
        assert self.echo(tmp_path, text, shape=shape) == pytest.approx([0.8, 0.4, 0.2], rel=1e-4)

    @pytest.mark.parametrize(
        ("fit", "picture", "box"),
        [
            ("stretch", (32, 32), [20 / 3, 5, 20, 20]),  # scale 3 in x, 2 in y
            ("corner", (32, 32), [10, 5, 30, 20]),  # scale 2, 32 columns free at the right
            ("letterbox", (32, 32), [2, 5, 22, 20]),  # scale 2, 16 columns free on either side
        ],
    )
    def test_boxes_come_back(self, tmp_path, fit, picture, box):
        path = write_graph(tmp_path / "net.onnx", detections_arrays())
        (tmp_path / "net.yaml").write_text(f"fit: {fit}\n")
        best = load_detector(str(path)).detect(torch.rand(1, 3, *picture))[0]
        assert best.boxes[0].tolist() == pytest.approx(box)

    def test_further_inputs(self, tmp_path):
        """Sizes and masks that RT-DETR, Paddle and DETR exports ask for."""
        further = [
            ("orig_target_sizes", TensorProto.INT64, (1, 2)),
            ("im_shape", TensorProto.FLOAT, (1, 2)),
            ("scale_factor", TensorProto.FLOAT, (1, 2)),
            ("pixel_mask", TensorProto.INT64, (1, *SIZE)),
        ]
        path = write_graph(tmp_path / "net.onnx", labels_boxes_scores(), further=further)
        assert len(load_detector(str(path)).detect(torch.rand(1, 3, 32, 48))[0].scores) == 2
        further.append(("threshold", TensorProto.FLOAT, (1,)))
        path = write_graph(tmp_path / "net.onnx", labels_boxes_scores(), further=further)
        with pytest.raises(DetectorError, match="input 'threshold' is unknown"):
            load_detector(str(path))

    def test_no_pictures_enter(self, tmp_path):
        path = write_graph(tmp_path / "net.onnx", yolov8(), shape=(1, 4, 8, 8))
        with pytest.raises(DetectorError, match=r"input 'image' has shape \[1, 4, 8, 8\], must be"):
            load_detector(str(path))


class TestOptions:
    def load(self, tmp_path, arrays, text="", **options):
        path = write_graph(tmp_path / "net.onnx", arrays, **options)
        (tmp_path / "net.yaml").write_text(text)
        return load_detector(str(path))

    def test_other_classes(self, tmp_path):
        """One class: YOLOv5's rows have six columns, like Ultralytics' rows after suppression."""
        rows = yolov5()["output"][..., [0, 1, 2, 3, 4, 5 + CAR]]
        detector = self.load(tmp_path, {"output": rows}, "classes: [car]")
        assert detector.class_names == ("car",)
        found = detector.detect(torch.rand(1, 3, 32, 48))[0]
        assert found.boxes[0].tolist() == pytest.approx([10, 5, 30, 20])
        with pytest.raises(DetectorError, match="for 80 classes or 91 classes; state layout, cl"):
            self.load(tmp_path, {"output": rows})

    def test_names_inside_the_file(self, tmp_path):
        rows = yolov8()["output0"][:, [0, 1, 2, 3, 4 + CAR, 4 + TRUCK]]
        detector = self.load(tmp_path, {"output0": rows}, names=("car", "truck"))
        assert detector.class_names == ("car", "truck")

    def test_notation_and_unit(self, tmp_path):
        """Corners in parts of the picture, as YOLOv4 and SSD exports have them."""
        arrays = sets(80, (CAR, 0.9), 0.0, ("confs", "boxes"))
        arrays["boxes"][0, 1] = [20 / 96, 10 / 64, 60 / 96, 40 / 64]
        detector = self.load(tmp_path, arrays, "boxes: xyxy\nunits: picture\nactivation: none")
        found = detector.detect(torch.rand(1, 3, 32, 48))[0]
        assert found.boxes[0].tolist() == pytest.approx([10, 5, 30, 20])

    def test_scores_without_their_activation(self, tmp_path):
        arrays = nanodet_plus()
        arrays["output"][..., :80] = logit(0.01)
        arrays["output"][0, cells((8, 16, 32, 64)).index((4, 2, 8)), CAR] = logit(0.9)
        found = self.load(tmp_path, arrays).detect(torch.rand(1, 3, 32, 48))[0]
        assert found.scores.tolist() == pytest.approx([0.9])

    def test_strides_and_centres(self, tmp_path):
        """A network of one level, whose corner (2, 1) · 16 is the reference."""
        rows = rows_of(len(cells((16,))), 80 + 4 * 5)
        row = cells((16,)).index((2, 1, 16))
        rows[0, row, CAR], rows[0, row, 80:] = 0.9, distances(1, 1, 2, 0.5, bins=5)
        text = "layout: distribution\nstrides: [16]\ncentre: 0\n"
        found = self.load(tmp_path, {"rows": rows}, text).detect(torch.rand(1, 3, 32, 48))[0]
        assert found.boxes[0].tolist() == pytest.approx([8, 0, 32, 12], abs=1e-4)

    def test_chosen_outputs(self, tmp_path):
        arrays = {**ultralytics_rows(), **{f"raw_{k}": v for k, v in yolov8().items()}}
        detector = self.load(tmp_path, arrays, "outputs: [raw_output0]")
        assert detector.candidates(torch.rand(1, 3, 32, 48)).boxes.shape[1] > 3
        with pytest.raises(DetectorError, match="no output 'raw_output'; .*did you mean 'raw_out"):
            self.load(tmp_path, arrays, "outputs: [raw_output]")

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("clases: coco", r"clases: unknown key; did you mean 'classes'\?"),
            ("classes: coko", r"classes: unknown list 'coko'; give .*mean 'coco'"),
            ("layout: yolov5", r"layout: Input should be .* \(got 'yolov5'\)"),
            ("size: [64]", r"size: "),
            ("std: [1, 0, 1]", r"std: Input should be greater than 0 \(got 0\)"),
            ("- 1", r"file: Input should be .*mapping|dictionary"),
            ("{", r"cannot be read as YAML"),
        ],
    )
    def test_wrong_values(self, tmp_path, text, message):
        with pytest.raises(DetectorError, match=message) as caught:
            self.load(tmp_path, yolov8(), text)
        assert "net.yaml" in str(caught.value)
        assert "\n" not in str(caught.value)

    def test_unknown_layout(self, tmp_path):
        arrays = {"features": np.zeros((1, 7, 13), np.float32)}
        with pytest.raises(
            DetectorError, match=r"features \(1, 7, 13\) for an input of \(64, 96\)"
        ):
            self.load(tmp_path, arrays)
        with pytest.raises(DetectorError, match=r"30 rows for 126 cells; state layout"):
            self.load(tmp_path, {"rows": rows_of(30, 85)}, "layout: yolox")


def test_batches_of_fixed_size(tmp_path):
    """Three pictures through a graph that takes two at a time."""
    arrays = detections_arrays()
    arrays = {name: np.concatenate([array, array]) for name, array in arrays.items()}
    path = write_graph(tmp_path / "net.onnx", arrays, shape=(2, 3, *SIZE))
    found = load_detector(str(path)).detect(torch.rand(3, 3, 32, 48))
    assert [len(one.scores) for one in found] == [2, 2, 2]
