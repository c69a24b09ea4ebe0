"""Networks and weights against a second implementation and finite differences."""

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from cnca.core.errors import DetectorError
from cnca.detect.cfg import read_config
from cnca.detect.darknet import Darknet
from cnca.detect.darknet_keys import ACTIVATIONS
from cnca.detect.weights import load_weights, save_weights
from tests.detect import reference
from tests.detect.conftest import WEIGHT_COUNT


def load(config, weights):
    network = Darknet(read_config(config)).eval()
    load_weights(network, weights)
    return network


def test_tiny_matches_the_reference(tiny):
    weights = tiny.with_suffix(".weights")
    image = torch.rand(3, 32, 32, generator=torch.Generator().manual_seed(0))
    heads = load(tiny, weights)(image[None])
    expected = reference.run(tiny, weights, image.double().numpy())
    assert len(heads) == len(expected) == 2
    for head, values in zip(heads, expected, strict=True):
        np.testing.assert_allclose(head[0].detach().numpy(), values, rtol=1e-4, atol=1e-4)


def test_yolo_fastest_matches_the_reference(detectors):
    """All its layers, on a picture small enough for the reference."""
    config, weights = (detectors / f"yolo-fastest-1.1-xl.{end}" for end in ("cfg", "weights"))
    image = torch.rand(3, 64, 64, generator=torch.Generator().manual_seed(0))
    expected = reference.run(config, weights, image.double().numpy())
    heads = load(config, weights)(image[None])
    assert [head.shape[1:] for head in heads] == [(255, 2, 2), (255, 4, 4)]
    for head, values in zip(heads, expected, strict=True):
        np.testing.assert_allclose(head[0].detach().numpy(), values, rtol=1e-3, atol=2e-3)


def test_boxes_follow_the_paper(tiny):
    """b_x = s·σ(t_x) − (s − 1)/2 + c_x, b_w = p_w·e^t_w, for one cell by hand."""
    head = Darknet(read_config(tiny)).heads[0]
    raw = torch.randn(1, 14, 8, 8, generator=torch.Generator().manual_seed(0))
    found = head.candidates(raw, (32, 32))
    anchor, row, column = 1, 5, 2
    t = raw[0, 7:, row, column].double().numpy()
    sigmoid = 1 / (1 + np.exp(-t))
    x, y = ((1.1 * sigmoid[:2] - 0.05) + [column, row]) * 4
    w, h = np.exp(t[2:4]) * [14, 20]
    index = anchor * 64 + row * 8 + column
    expected = [x - w / 2, y - h / 2, x + w / 2, y + h / 2]
    assert found.boxes[0, index].tolist() == pytest.approx(expected, rel=1e-5)
    assert found.objectness[0, index].item() == pytest.approx(sigmoid[4], rel=1e-5)
    assert found.class_scores[0, index].tolist() == pytest.approx(sigmoid[5:].tolist(), rel=1e-5)


def test_boxes_of_scaled_yolov4(tiny):
    """With new_coords b_w = p_w·(2 s_w)², and probabilities are what the layer before gives."""
    tiny.write_text(tiny.read_text().replace("scale_x_y=1.1", "scale_x_y=2.0\nnew_coords=1"))
    head = Darknet(read_config(tiny)).heads[0]
    raw = torch.rand(1, 14, 8, 8, generator=torch.Generator().manual_seed(0))
    found = head.candidates(raw, (32, 32))
    s, index = raw[0, 7:, 5, 2].double().numpy(), 64 + 5 * 8 + 2
    x, y = (2 * s[:2] - 0.5 + [2, 5]) * 4
    w, h = (2 * s[2:4]) ** 2 * [14, 20]
    expected = [x - w / 2, y - h / 2, x + w / 2, y + h / 2]
    assert found.boxes[0, index].tolist() == pytest.approx(expected, rel=1e-5)
    assert found.objectness[0, index].item() == pytest.approx(s[4])
    assert found.class_scores[0, index].tolist() == pytest.approx(s[5:].tolist())


NET = "[net]\nwidth=4\nheight=4\nchannels=3\n"
HEAD = "[convolutional]\nfilters=7\nactivation=linear\n[yolo]\nclasses=2\nanchors=4,5\nmask=0\n"


def layers_of(tmp_path, text):
    (tmp_path / "net.cfg").write_text(NET + text + HEAD)
    return Darknet(read_config(tmp_path / "net.cfg")).layers


def test_channels_and_places_are_weighed(tmp_path):
    pool, scale, sam, *_ = layers_of(
        tmp_path,
        "[maxpool]\nsize=1\nstride=1\n[avgpool]\n[scale_channels]\nfrom=0\n[sam]\nfrom=0\n",
    )[1:]
    x = torch.rand(2, 3, 4, 4)
    weights = pool(x, {})
    torch.testing.assert_close(weights, x.mean(dim=(2, 3), keepdim=True))
    torch.testing.assert_close(scale(weights, {0: x}), x * weights)
    torch.testing.assert_close(sam(x, {0: x}), x * x)


def test_reorg_by_darknets_own_loop(tmp_path):
    """Read from memory as if the input had a fourth of the channels and twice the size."""
    conv = "[convolutional]\nfilters=8\nactivation=linear\n"
    reorg = layers_of(tmp_path, f"{conv}[reorg]\nstride=2\n")[1]
    channels, rows, columns, s = 8, 4, 4, 2
    x = torch.arange(channels * rows * columns, dtype=torch.float32)
    expected = torch.empty_like(x)
    for k in range(channels):
        offset, c2 = k // (channels // s**2), k % (channels // s**2)
        for j in range(rows):
            for i in range(columns):
                w2, h2 = i * s + offset % s, j * s + offset // s
                source = w2 + columns * s * (h2 + rows * s * c2)
                expected[i + columns * (j + rows * k)] = x[source]
    found = reorg(x.reshape(1, channels, rows, columns), {})
    assert found.shape == (1, 32, 2, 2)
    torch.testing.assert_close(found.flatten(), expected)


def test_a_mark_at_the_beginning_of_a_file(tiny):
    tiny.write_bytes(b"\xef\xbb\xbf" + tiny.read_bytes())
    assert read_config(tiny).size == (32, 32)


def test_boxes_stay_finite_for_any_output(tiny):
    head = Darknet(read_config(tiny)).heads[0]
    raw = torch.full((1, 14, 8, 8), 1e4, requires_grad=True)
    boxes = head.candidates(raw, (32, 32)).boxes
    boxes.sum().backward()
    assert boxes.isfinite().all()
    assert raw.grad.isfinite().all()


def test_gradient_matches_finite_differences(tiny):
    """Along random directions, in float64, so that ReLU's kinks are the only exception."""
    network = load(tiny, tiny.with_suffix(".weights")).double()
    generator = torch.Generator().manual_seed(3)
    image = torch.rand(1, 3, 32, 32, generator=generator, dtype=torch.float64)

    def objective(x):
        return sum(head.sigmoid().sum() for head in network(x))

    x = image.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(objective(x), x)
    for _ in range(5):
        direction = torch.randn(image.shape, generator=generator, dtype=torch.float64)
        step = 1e-7 * direction
        difference = (objective(image + step) - objective(image - step)) / 2e-7
        assert (gradient * direction).sum().item() == pytest.approx(difference.item(), rel=1e-4)


def test_activations_by_formula():
    x = torch.linspace(-4, 7, 23, dtype=torch.float64)
    formulas = {
        "linear": x,
        "leaky": torch.maximum(x, 0.1 * x),
        "relu": (x + x.abs()) / 2,
        "relu6": ((x + x.abs()) / 2).minimum(torch.tensor(6.0)),
        "mish": x * torch.tanh(torch.log(1 + torch.exp(x))),
        "swish": x / (1 + torch.exp(-x)),
        "logistic": 1 / (1 + torch.exp(-x)),
        "tanh": (torch.exp(2 * x) - 1) / (torch.exp(2 * x) + 1),
        "elu": torch.where(x > 0, x, torch.exp(x) - 1),
        "selu": 1.0507009873554805 * torch.where(x > 0, x, 1.6732632423543772 * (torch.exp(x) - 1)),
        "gelu": x / 2 * (1 + torch.tanh((2 / torch.pi) ** 0.5 * (x + 0.044715 * x**3))),
        "ramp": x * (x > 0) + 0.1 * x,
        "loggy": 2 / (1 + torch.exp(-x)) - 1,
        "hard_mish": torch.where(x > 0, x, torch.where(x > -2, x * x / 2 + x, 0 * x)),
    }
    assert formulas.keys() == ACTIVATIONS.keys()
    for name, expected in formulas.items():
        torch.testing.assert_close(ACTIVATIONS[name](x), expected)


def test_dropout_only_in_training(tiny):
    network = load(tiny, tiny.with_suffix(".weights"))
    image = torch.rand(1, 3, 32, 32)
    assert torch.equal(network(image)[0], network(image)[0])
    network.train()
    assert not torch.equal(network(image)[0], network(image)[0])


def test_same_seed_same_network(tiny):
    config = read_config(tiny)
    nets = [Darknet(config, torch.Generator().manual_seed(seed)) for seed in (1, 1, 2)]
    first, same, other = (net.state_dict()["layers.0.convolution.weight"] for net in nets)
    assert torch.equal(first, same)
    assert not torch.equal(first, other)


class TestWeights:
    @pytest.mark.parametrize(
        ("change", "extra"), [(lambda b: b[:-4], -1), (lambda b: b + bytes(4), 1)]
    )
    def test_wrong_length(self, tiny, change, extra):
        path = tiny.with_suffix(".weights")
        path.write_bytes(change(path.read_bytes()))
        counts = rf"needs {WEIGHT_COUNT} weights, the file holds {WEIGHT_COUNT + extra};"
        with pytest.raises(DetectorError, match=counts):
            load(tiny, path)

    def test_header_of_old_versions(self, tiny):
        path = tiny.with_suffix(".weights")
        content = path.read_bytes()
        path.write_bytes(np.array([0, 1, 0, 0], "<i4").tobytes() + content[20:])
        load(tiny, path)

    def test_not_finite(self, tiny):
        path = tiny.with_suffix(".weights")
        content = path.read_bytes()
        path.write_bytes(content[:-4] + np.float32(np.nan).tobytes())
        with pytest.raises(DetectorError, match="is not finite"):
            load(tiny, path)

    @pytest.mark.parametrize("name", ["short.weights", "noise.safetensors", "none.weights", "a.pt"])
    def test_unusable_files(self, tiny, tmp_path, name):
        if not name.startswith("none"):
            (tmp_path / name).write_bytes(b"short")
        with pytest.raises(DetectorError, match=name):
            load(tiny, tmp_path / name)

    def test_safetensors_round_trip(self, tiny, tmp_path):
        network = load(tiny, tiny.with_suffix(".weights"))
        save_weights(network, tmp_path / "same.safetensors")
        image = torch.rand(1, 3, 32, 32)
        assert torch.equal(load(tiny, tmp_path / "same.safetensors")(image)[0], network(image)[0])
        assert not list(tmp_path.glob("*.tmp"))

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda t: t.pop("layers.0.norm.bias"), "'layers.0.norm.bias' is missing"),
            (lambda t: t.update(extra=torch.zeros(1)), "'extra' is not in"),
            (lambda t: t.update({"layers.0.norm.bias": torch.zeros(7)}), r"has \(7,\), expected"),
        ],
    )
    def test_safetensors_of_another_network(self, tiny, tmp_path, change, message):
        path = tmp_path / "other.safetensors"
        save_weights(load(tiny, tiny.with_suffix(".weights")), path)
        tensors = load_file(path)
        change(tensors)
        save_file(tensors, path)
        with pytest.raises(DetectorError, match=message):
            load(tiny, path)
