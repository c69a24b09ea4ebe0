"""Folders of transformers: tiny networks with random weights, saved and read again."""

import json

import pytest
import torch
from safetensors.torch import load_file, save_file
from transformers import (
    ConditionalDetrConfig,
    ConditionalDetrForObjectDetection,
    DeformableDetrConfig,
    DeformableDetrForObjectDetection,
    DetrConfig,
    DetrForObjectDetection,
    DetrImageProcessor,
    DFineConfig,
    DFineForObjectDetection,
    HGNetV2Config,
    ResNetConfig,
    RTDetrConfig,
    RTDetrForObjectDetection,
    RTDetrResNetConfig,
    RTDetrV2Config,
    RTDetrV2ForObjectDetection,
    YolosConfig,
    YolosForObjectDetection,
)

from cnca.core.errors import DetectorError
from cnca.detect import load_detector
from tests.detect.test_detectors import DetectorContract

LABELS = {"id2label": {0: "N/A", 1: "person", 2: "car"}, "label2id": {"person": 1, "car": 2}}
SIZES = [8, 16, 24, 32]
SMALL = {
    "d_model": 32,
    "encoder_layers": 1,
    "decoder_layers": 2,
    "encoder_attention_heads": 2,
    "decoder_attention_heads": 2,
    "encoder_ffn_dim": 32,
    "decoder_ffn_dim": 32,
    "num_queries": 12,
    **LABELS,
}


def resnet(**options):
    shape = {"embedding_size": 8, "hidden_sizes": SIZES, "depths": [1, 1, 1, 1]}
    return ResNetConfig(**shape, layer_type="basic", **options)


def rt_detr_options():
    shape = {"embedding_size": 8, "hidden_sizes": SIZES, "depths": [1, 1, 1, 1]}
    backbone = RTDetrResNetConfig(**shape, layer_type="basic", out_indices=[2, 3, 4])
    levels = {"encoder_in_channels": SIZES[1:], "decoder_in_channels": [32, 32, 32]}
    return {**SMALL, **levels, "encoder_hidden_dim": 32, "backbone_config": backbone}


def d_fine_options():
    backbone = HGNetV2Config(
        hidden_sizes=SIZES,
        depths=[1, 1, 1, 1],
        stem_channels=[3, 8, 8],
        stage_in_channels=[8, 8, 16, 24],
        stage_mid_channels=[8, 8, 8, 8],
        stage_out_channels=SIZES,
        stage_num_blocks=[1, 1, 1, 1],
        stage_numb_of_layers=[1, 1, 1, 1],
        out_indices=[2, 3, 4],
    )
    return {**rt_detr_options(), "backbone_config": backbone}


def detr():
    return DetrForObjectDetection(
        DetrConfig(**SMALL, backbone_config=resnet(out_features=["stage4"]))
    )


def conditional_detr():
    backbone = resnet(out_features=["stage4"])
    config = ConditionalDetrConfig(**SMALL, backbone_config=backbone)
    return ConditionalDetrForObjectDetection(config)


def deformable_detr():
    backbone = resnet(out_features=["stage2", "stage3", "stage4"])
    config = DeformableDetrConfig(**SMALL, backbone_config=backbone, num_feature_levels=3)
    return DeformableDetrForObjectDetection(config)


def yolos():
    config = YolosConfig(
        hidden_size=32,
        num_hidden_layers=2,
        num_attention_heads=2,
        intermediate_size=32,
        image_size=[64, 64],
        num_detection_tokens=12,
        **LABELS,
    )
    return YolosForObjectDetection(config)


def rt_detr():
    return RTDetrForObjectDetection(RTDetrConfig(**rt_detr_options()))


def rt_detr_v2():
    return RTDetrV2ForObjectDetection(RTDetrV2Config(**rt_detr_options()))


def d_fine():
    return DFineForObjectDetection(DFineConfig(**d_fine_options()))


KINDS = (detr, conditional_detr, deformable_detr, yolos, rt_detr, rt_detr_v2, d_fine)


def save(model, folder, **preparation):
    model.save_pretrained(folder)
    (folder / "preprocessor_config.json").write_text(json.dumps(preparation))
    return folder


@pytest.fixture(scope="module", params=KINDS, ids=lambda make: make.__name__)
def folder(request, tmp_path_factory):
    torch.manual_seed(0)
    size = {"height": 64, "width": 64}
    model = request.param()
    for values in model.parameters():  # several start at zero, and would let no gradient pass
        values.data += 0.02 * torch.randn(values.shape)
    return save(model, tmp_path_factory.mktemp(request.param.__name__), size=size)


@pytest.fixture(scope="module")
def loaded(folder):
    return load_detector(str(folder))


class TestKinds(DetectorContract):
    @pytest.fixture
    def detector(self, loaded):
        return loaded

    def test_gradient_of_boxes(self, detector):
        """Boxes, too, lead back to the picture."""
        images = torch.rand(1, 3, 64, 64).requires_grad_()
        detector.candidates(images).boxes.sum().backward()
        assert images.grad.isfinite().all()
        assert (images.grad != 0).any()

    def test_classes(self, detector):
        assert detector.class_names == ("N/A", "person", "car")


@pytest.fixture
def small_detr(tmp_path):
    return save(detr(), tmp_path / "detr", size={"height": 64, "width": 96})


def test_boxes_in_pixels(small_detr):
    """(cx, cy, w, h) of 0.5, 0.25, 0.2, 0.1 in a picture of 40 × 80, whatever the input's size."""
    detector = load_detector(str(small_detr))
    detector.model = Fixed(detector.model)
    found = detector.candidates(torch.rand(1, 3, 40, 80))
    assert found.boxes[0, 0].tolist() == pytest.approx([32, 8, 48, 12])
    # softmax of (0, 1, 2) and 0 for nothing
    total = 2 + 2.718281828 + 2.718281828**2
    expected = [1 / total, 2.718281828 / total, 2.718281828**2 / total]
    assert found.class_scores[0, 0].tolist() == pytest.approx(expected)
    assert found.objectness.tolist() == [[1.0]]


class Fixed(torch.nn.Module):
    """Answers every picture alike, after a look at the input's shape."""

    def __init__(self, model):
        super().__init__()
        self.model = model

    def forward(self, pixel_values):
        assert pixel_values.shape[2:] == (64, 96)
        answer = type("Answer", (), {})()
        answer.pred_boxes = torch.tensor([[[0.5, 0.25, 0.2, 0.1]]])
        answer.logits = torch.tensor([[[0.0, 1, 2, 0]]])
        return answer


@pytest.mark.parametrize(("height", "width"), [(480, 640), (200, 900)])
def test_input_like_the_library_makes_it(small_detr, height, width):
    """Sizes exactly; values but for what resampling 8-bit pictures rounds."""
    (small_detr / "preprocessor_config.json").unlink()
    detector = load_detector(str(small_detr))
    ramp = torch.linspace(0, 255, width).round().expand(3, height, width).byte()
    processed = DetrImageProcessor()(images=ramp.permute(1, 2, 0).numpy(), return_tensors="pt")
    expected = processed["pixel_values"]
    size = detector._size(height, width)
    assert size == tuple(expected.shape[2:])
    inputs, _ = detector.entry.prepare(ramp[None].float() / 255, size)
    # one level of 8 bits, divided by the smallest deviation, 0.224
    assert (inputs - expected).abs().max() < 1.5 / 255 / 0.224


class TestUnusable:
    def change(self, folder, **values):
        path = folder / "config.json"
        content = json.loads(path.read_text())
        content.update(values)
        path.write_text(json.dumps({k: v for k, v in content.items() if v is not None}))

    def refused(self, folder, message):
        with pytest.raises(DetectorError, match=message) as caught:
            load_detector(str(folder))
        assert "\n" not in str(caught.value)

    def test_no_folder(self, tmp_path):
        self.refused(f"{tmp_path}/nothing/", r"nothing/config\.json: cannot be read as JSON")

    def test_other_kind(self, small_detr):
        self.change(small_detr, model_type="detrr")
        self.refused(small_detr, r"model_type 'detrr' is not supported; .*did you mean 'detr'\?")

    def test_no_safetensors(self, small_detr):
        (small_detr / "model.safetensors").rename(small_detr / "pytorch_model.bin")
        self.refused(small_detr, r"no \*\.safetensors; save the model again")

    @pytest.mark.parametrize(
        "values", [{"backbone_config": {"model_type": "timm_backbone"}}, {"backbone_config": None}]
    )
    def test_missing_package(self, small_detr, values, monkeypatch):
        monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
        self.change(small_detr, **values)
        self.refused(small_detr, "its backbone needs the package timm, which is not installed")

    def test_backbone_elsewhere(self, small_detr):
        self.change(
            small_detr, backbone_config=None, use_timm_backbone=False, backbone="microsoft/resnet"
        )
        self.refused(small_detr, "backbone 'microsoft/resnet' lies elsewhere")

    def test_weights_missing_or_of_another_shape(self, small_detr):
        path = small_detr / "model.safetensors"
        tensors = load_file(path)
        bias = tensors.pop("class_labels_classifier.bias")
        save_file(tensors, path, {"format": "pt"})
        self.refused(small_detr, "missing 'class_labels_classifier.bias'")
        save_file(
            {**tensors, "class_labels_classifier.bias": bias[:2].clone()}, path, {"format": "pt"}
        )
        self.refused(small_detr, "mismatched .*class_labels_classifier.bias")

    def test_broken_weights(self, small_detr):
        (small_detr / "model.safetensors").write_bytes(b"short")
        self.refused(small_detr, "transformers cannot load it")
