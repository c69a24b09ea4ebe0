"""Textures at the ends of the range, of one texel, of 4096² and of another shape than a square."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float

from cnca.core.color import srgb_to_linear
from cnca.mi_bridge.geometry import ALBEDO_FLOOR
from tests.hard.looks import Stage, look

STRIPES = torch.tensor([[200, 60, 60], [60, 200, 60], [60, 60, 200]]) / 255
"""sRGB colors from u = 0 to u = 1 of ``textures/stripes_48x16.png``."""


def test_black_and_white_paint_learn_as_grey_paint_does():
    """No wall sees another: the picture is linear in the texture, so its gradient is constant."""
    grey = look("plain").gradients[0]
    for name in ("texture_black", "texture_white"):
        np.testing.assert_allclose(look(name).gradients[0], grey, rtol=1e-3, atol=1e-9)


def test_the_picture_is_linear_in_the_texture():
    """Up to the floor of 0.001 that keeps black paint alive."""
    black, white = look("texture_black").image, look("texture_white").image
    plain = Stage("plain")
    half = plain.images(torch.full_like(plain.texture, 0.5)).numpy()
    np.testing.assert_allclose(half, (black + white) / 2, rtol=1e-4, atol=1e-6)
    assert (white >= black).all()


def test_the_number_of_texels_does_not_show():
    for name in ("texture_one_texel", "texture_4096"):
        np.testing.assert_allclose(look(name).image, look("plain").image, rtol=1e-4)
        sums = look(name).gradients.sum(axis=(2, 3))
        np.testing.assert_allclose(sums[0], look("plain").gradients[0].sum(axis=(1, 2)), rtol=1e-4)


def test_a_texture_that_is_not_square_is_stretched_over_the_atlas():
    """Each third of the atlas from left to right has one color."""
    stage = Stage("texture_not_square")
    white, painted = albedo(stage, torch.ones_like(stage.texture)), albedo(stage, stage.texture)
    paint = (white > 0.99).all(axis=-1)
    u = look("texture_not_square").layers.uv[0, ..., 0]
    expected = ALBEDO_FLOOR + (1 - ALBEDO_FLOOR) * srgb_to_linear(STRIPES).numpy()
    assert paint.sum() > 50
    np.testing.assert_allclose(painted[paint], expected[(3 * u[paint]).astype(int)], rtol=1e-3)


def albedo(stage: Stage, texture: torch.Tensor) -> Float[np.ndarray, "height width 3"]:
    stage.images(texture)
    return stage.renderer.layers(stage.views).albedo[0]
