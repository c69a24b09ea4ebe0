"""Textures and masks from files, and back."""

import cv2
import numpy as np
import OpenEXR
import pytest
import torch

from cnca.core import images
from cnca.core.color import linear_to_srgb
from cnca.core.errors import TextureError


@pytest.fixture
def gradient():
    """A small picture with no two equal texels or channels."""
    return np.linspace(0, 1, 4 * 5 * 3, dtype=np.float32).reshape(4, 5, 3)


def test_png_round_trip_loses_half_a_level(tmp_path, gradient):
    images.write_texture_srgb(tmp_path / "t.png", gradient)
    read = images.read_texture_srgb(tmp_path / "t.png")
    assert read.dtype == np.float32
    np.testing.assert_allclose(read, gradient, atol=0.5 / 255 + 1e-6)


def test_red_is_red(tmp_path):
    red = np.zeros((2, 2, 3), np.uint8)
    red[..., 2] = 255  # OpenCV writes blue, green, red
    cv2.imwrite(str(tmp_path / "red.png"), red)
    np.testing.assert_array_equal(images.read_texture_srgb(tmp_path / "red.png")[0, 0], (1, 0, 0))


def test_sixteen_bits_are_kept(tmp_path):
    cv2.imwrite(str(tmp_path / "deep.png"), np.full((2, 2, 3), 257 * 3 + 1, np.uint16))
    value = images.read_texture_srgb(tmp_path / "deep.png")[0, 0, 0]
    assert value == pytest.approx((257 * 3 + 1) / 65535)


def test_exr_is_linear_and_becomes_srgb(tmp_path, gradient):
    images.write_exr(tmp_path / "t.exr", {"": gradient})
    expected = linear_to_srgb(torch.from_numpy(gradient)).numpy()
    np.testing.assert_allclose(images.read_texture_srgb(tmp_path / "t.exr"), expected, atol=1e-5)


def test_exr_layers_can_be_found_by_name(tmp_path, gradient):
    depth = gradient[..., 0] * 100
    layers = {"": gradient, "normal": gradient * 2 - 1, "depth": depth}
    images.write_exr(tmp_path / "layers.exr", layers)
    with OpenEXR.File(str(tmp_path / "layers.exr"), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    assert set(channels) == {"R", "G", "B", "normal.R", "normal.G", "normal.B", "depth"}
    np.testing.assert_array_equal(channels["depth"], depth)
    np.testing.assert_array_equal(channels["normal.B"], gradient[..., 2] * 2 - 1)


def test_layers_of_different_size_are_refused(tmp_path, gradient):
    with pytest.raises(TextureError, match="share one height"):
        images.write_exr(tmp_path / "t.exr", {"": gradient, "depth": gradient[1:, :, 0]})


def test_masks_may_be_grey_or_colored(tmp_path):
    half = np.zeros((2, 4), np.uint8)
    half[:, 2:] = 255
    cv2.imwrite(str(tmp_path / "grey.png"), half)
    cv2.imwrite(str(tmp_path / "color.png"), np.dstack([half] * 3))
    expected = [[False, False, True, True]] * 2
    for name in ("grey.png", "color.png"):
        np.testing.assert_array_equal(images.read_mask(tmp_path / name), expected)


def test_texels_outside_the_islands_take_the_nearest_color(tmp_path):
    picture = np.zeros((1, 6, 4), np.uint8)
    picture[0, 0] = (0, 0, 255, 255)  # OpenCV's order: blue, green, red, alpha
    picture[0, 5] = (255, 0, 0, 128)
    cv2.imwrite(str(tmp_path / "islands.png"), picture)
    read = images.read_texture_srgb(tmp_path / "islands.png")
    np.testing.assert_array_equal(read[0, :3], [(1, 0, 0)] * 3)
    np.testing.assert_array_equal(read[0, 3:], [(0, 0, 1)] * 3)


def _write_grey(path):
    cv2.imwrite(str(path), np.zeros((2, 2), np.uint8))


def _write_transparent(path):
    cv2.imwrite(str(path), np.zeros((2, 2, 4), np.uint8))


def _write_rubbish(path):
    path.write_bytes(b"rubbish")


@pytest.mark.parametrize(
    ("name", "write", "message"),
    [
        ("grey.png", _write_grey, r"has 1 channel\(s\)"),
        ("clear.png", _write_transparent, "every texel is transparent"),
        ("rubbish.png", _write_rubbish, "cannot be decoded"),
        ("rubbish.exr", _write_rubbish, "cannot be read as EXR"),
        ("missing.png", lambda path: None, "no such file"),
        ("picture.pngg", _write_rubbish, r"did you mean '\.png'"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, name, write, message):
    write(tmp_path / name)
    with pytest.raises(TextureError, match=message) as caught:
        images.read_texture_srgb(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("value", "message"), [(np.nan, "NaN"), (1.5, r"\[0, 1.5\]")])
def test_bad_values_are_refused_in_both_directions(tmp_path, value, message):
    texture = np.zeros((2, 2, 3), np.float32)
    texture[0, 0, 0] = value
    with pytest.raises(TextureError, match=message):
        images.write_texture_srgb(tmp_path / "t.png", texture)
    images.write_exr(tmp_path / "t.exr", {"": texture})
    with pytest.raises(TextureError, match=message):
        images.read_texture_srgb(tmp_path / "t.exr")


def test_a_failed_write_leaves_the_old_picture(tmp_path, gradient):
    images.write_texture_srgb(tmp_path / "t.png", gradient)
    before = (tmp_path / "t.png").read_bytes()
    with pytest.raises(TextureError):
        images.write_texture_srgb(tmp_path / "t.png", gradient * 2)
    assert (tmp_path / "t.png").read_bytes() == before
