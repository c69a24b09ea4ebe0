"""NaN and infinity are errors that name view, effect and seed; nothing clamps them away."""

from __future__ import annotations

from functools import partial

import torch
from jaxtyping import Float

from cnca.core.errors import NonFiniteError
from cnca.mi_bridge.rays import Cameras
from cnca.scene.weather import Weather


def refuse_non_finite(
    images: Float[torch.Tensor, "*film 3"],
    texture: Float[torch.Tensor, "size size 3"],
    cameras: Cameras,
    weather: Weather,
    seed: int,
) -> None:
    """Check pictures that were rendered from ``texture`` now, and the gradients once they pass.

    Raises:
        NonFiniteError: now or in the backward pass.
    """
    circumstances = f"in {'fog' if weather.fog else 'clear air'} with seed {seed} is not finite"

    def check_film(what: str, values: torch.Tensor) -> None:
        finite = torch.isfinite(values).flatten(1).all(dim=1)
        if not finite.all():
            view = cameras.name_of(int((~finite).nonzero()[0, 0]))
            raise NonFiniteError(f"{what} of view {view} {circumstances}")

    def check_texture(gradient: torch.Tensor) -> None:
        if not torch.isfinite(gradient).all():
            views = ", ".join(cameras.names)
            raise NonFiniteError(f"texture gradient of view {views} {circumstances}")

    check_film("render", images.detach())
    if images.requires_grad:
        images.register_hook(partial(check_film, "loss gradient"))
        texture.register_hook(check_texture)
