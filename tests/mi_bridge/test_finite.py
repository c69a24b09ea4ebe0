"""NaN and infinity in pictures and gradients are errors that name view, effect and seed."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cnca.core.errors import NonFiniteError
from cnca.mi_bridge import renderer as renderer_module
from cnca.scene.weather import Fog, Weather
from tests.mi_bridge.conftest import orbit

FOGGY = Weather(fog=Fog(visibility=60.0, height=60.0))
VIEWS = [orbit(name="left"), orbit(name="right")]
TEXTURE = torch.full((3, 8, 8), 0.5)


def broken(bad: float):
    """A picture with one bad value in the second row of the film."""

    def render(texture, shots):
        image = torch.zeros(*shots[0].cameras.film_shape, 3)
        image[1].flatten()[0] = bad
        return image

    return render


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_picture(renderer, monkeypatch, bad):
    monkeypatch.setattr(renderer_module, "render", broken(bad))
    with pytest.raises(NonFiniteError, match="^render of view right in fog with seed 9 is not"):
        renderer.render(TEXTURE, VIEWS, FOGGY, seed=9)


def test_a_chosen_pixel(renderer, monkeypatch):
    """The second of two chosen pixels lies in the second picture of 16 × 16 pixels."""
    monkeypatch.setattr(renderer_module, "render", broken(float("nan")))
    with pytest.raises(NonFiniteError, match="^render of view right in clear air with seed 9"):
        renderer.render_pixels(TEXTURE, VIEWS, Weather(), np.array([5, 300]), seed=9)


def test_the_gradient_that_the_renderer_computes(renderer, monkeypatch):
    def steep(texture, shots):  # 0 with the slope 0/0
        return (0 * texture.sum()).sqrt().expand(*shots[0].cameras.film_shape, 3)

    monkeypatch.setattr(renderer_module, "render", steep)
    texture = TEXTURE.clone().requires_grad_()
    images = renderer.render(texture, VIEWS, FOGGY, seed=9)
    message = "^texture gradient of view left, right in fog with seed 9 is not finite"
    with pytest.raises(NonFiniteError, match=message):
        images.sum().backward()


def test_the_gradient_that_the_loss_hands_over(renderer):
    texture = TEXTURE.clone().requires_grad_()
    images = renderer.render(texture, VIEWS, FOGGY, seed=9)
    weights = torch.ones_like(images)
    weights[1, 0, 0, 0] = float("nan")
    with pytest.raises(NonFiniteError, match="^loss gradient of view right in fog with seed 9 is"):
        (images * weights).sum().backward()
    assert texture.grad is None
