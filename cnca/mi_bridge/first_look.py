"""All that a loop keeps of a view in a world, from one trace of it.

Each sample says what it sees, whether that is the vehicle, and whether the vehicle would be there
if it stood alone.  Where the last two differ something hides it, and only there do we look closer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int

from cnca.core.types import LinearTexture
from cnca.mi_bridge.bridge import Shot
from cnca.mi_bridge.finite import refuse_non_finite
from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.panes import sees_vehicle
from cnca.mi_bridge.rays import average_samples
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.cameras import View
from cnca.scene.weather import Weather


@dataclass(frozen=True)
class Background:
    """One view in one weather, in the plain paint."""

    image: Float[torch.Tensor, "3 height width"]
    pixels: Int[np.ndarray, " pixels"]
    """Flat indices of the pixels that the vehicle touches."""
    rest: Float[torch.Tensor, "pixels 3"] | None = None
    """In a world: what all but the vehicle adds to these pixels."""
    shares: Float[np.ndarray, " pixels"] | None = None
    """In a world: of what the vehicle covers of each pixel, the share that nothing hides."""


@torch.no_grad()
def first_look(
    renderer: MitsubaRenderer, plain: LinearTexture, view: View, weather: Weather, *, seed: int
) -> Background:
    """The background of a view in the renderer's world.

    Raises:
        NonFiniteError: the picture holds NaN or infinity.
    """
    chosen = renderer.plan(plain, [view], weather)
    shots = renderer.shots(chosen, [view], None, seed=seed)
    texels = shots[0].geometry.texture_size
    texture = plain.detach().expand(3, texels, texels).permute(1, 2, 0).float().contiguous()
    shots[0].geometry.bind(mi.TensorXf(texture.numpy()))
    total = sum(shot.samples for shot in shots)
    means = np.zeros((8, view.height * view.width), np.float32)
    for shot in shots:
        means += _look(shot, renderer.geometry) * (shot.samples / total)
    radiance, rest, seen, hidden = means[:3], means[3:6], means[6], means[7]
    image = torch.from_numpy(radiance.T.copy()).reshape(1, view.height, view.width, 3)
    refuse_non_finite(image, texture, shots[0].cameras, weather, seed)
    pixels = np.flatnonzero(seen > 0)
    partly = hidden[pixels] > 0
    shares = np.ones(len(pixels))
    if partly.any():
        shares[partly] = renderer.visible_pixels(view, pixels[partly])
    return Background(
        image[0].permute(2, 0, 1).contiguous(),
        pixels,
        torch.from_numpy(rest[:, pixels].T.copy()),
        shares,
    )


def _look(shot: Shot, alone: Geometry) -> Float[np.ndarray, "8 pixels"]:
    """Of each pixel: exposed radiance, that of all but the vehicle, its shares seen and hidden.

    Args:
        alone: the vehicle with nothing around it.
    """
    with dr.suspend_grad():
        _, ray, _ = shot.start(shot.seed)
        seen = sees_vehicle(shot.geometry, ray)
        hidden = sees_vehicle(alone, ray) & ~seen
        radiance = shot.primal(shot.seed)
        rest = dr.select(seen, 0, radiance)
        marks = [dr.select(mark, mi.Float(1), 0) for mark in (seen, hidden)]
        dr.eval(radiance, rest, marks)
        lanes = (*radiance, *rest, *marks)
        return np.stack([np.array(average_samples(lane, shot.samples)) for lane in lanes])
