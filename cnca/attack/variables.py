"""What an attack moves: F_adv, the noises of DDIM, or both; the loop treats them alike.

=============  =================================  ========================================
``--variable``  tensors                            where they start, and are bound to (±τ)
=============  =================================  ========================================
``feature``    F_adv (the paper)                  near 0; each element within ±1 of 0
``noise``      x_T and the noise of every step    white noise of the seed; unbounded
``both``       F_adv and these noises             as above, each
=============  =================================  ========================================

The bound is κ of the paper's equation 13, around what a texture without an attack is made of: 0 for
F_adv, the seed's white noise for the noises.  These are kept white in another way as well: each
channel is standardized at each use, and low frequencies cost (:mod:`cnca.gen.noise`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from cnca.attack.settings import BOTH, FEATURE, NOISE, Settings
from cnca.core.errors import GeneratorError, NonFiniteError
from cnca.gen.feature import START_SPREAD, initial, project
from cnca.gen.latents import Latents
from cnca.gen.noise import draw, low_frequency_excess
from cnca.scene.protocols import NoisyTextureGenerator, TextureGenerator

WHITENESS = 0.5
"""Weight of the low frequencies that the noises have in excess of white noise."""


@dataclass(frozen=True, eq=False)
class Variable:
    """One tensor that is moved, within ±τ of its origin."""

    value: Tensor
    """A leaf with a gradient."""
    origin: Tensor
    tau: float

    def project(self) -> None:
        """κ, in place; raises GeneratorError where the value is not finite."""
        with torch.no_grad():
            self.value.copy_(self.origin + project(self.value - self.origin, self.tau))


@dataclass(frozen=True, eq=False)
class Variables:
    """All that an attack moves, by name."""

    by_name: Mapping[str, Variable]

    @property
    def latents(self) -> Latents:
        """What the generator is given, with its gradients."""
        return Latents(**{name: variable.value for name, variable in self.by_name.items()})

    @property
    def tensors(self) -> list[Tensor]:
        """What the optimizer is given."""
        return [variable.value for variable in self.by_name.values()]

    def penalty(self) -> Float[Tensor, ""]:
        """What the noises cost beside the objective, ≥ 0; 0 without any."""
        noise = self.by_name.get("noises")
        if noise is None:
            return torch.zeros(())
        return WHITENESS * low_frequency_excess(noise.value)

    def gradients(self) -> list[Tensor | None]:
        """The gradient of each tensor."""
        return [tensor.grad for tensor in self.tensors]

    def refuse_non_finite(self, where: str) -> None:
        """Raise NonFiniteError unless every gradient is there and finite."""
        for name, variable in self.by_name.items():
            gradient = variable.value.grad
            if gradient is None or not torch.isfinite(gradient).all():
                raise NonFiniteError(
                    f"{where}: the gradient of {NAMES[name]} is not finite; "
                    "--resume tries this step again"
                )

    def project(self) -> None:
        """Bring every tensor back within its bound."""
        for variable in self.by_name.values():
            variable.project()

    def copy(self) -> Latents:
        """The values as they are now, without gradient."""
        return Latents(**{n: v.value.detach().clone() for n, v in self.by_name.items()})


NAMES = {"feature": "F_adv", "noises": "the noises"}
"""Field of :class:`cnca.gen.latents.Latents` → what messages call it."""


def origin(generator: TextureGenerator, settings: Settings) -> Latents:
    """What the texture without an attack is made of: F_adv = 0, noises of the seed.

    Raises GeneratorError where the noises of this generator cannot be chosen.
    """
    feature, noises = None, None
    if settings.variable in (FEATURE, BOTH):
        feature = torch.zeros(generator.feature_shape)
    if settings.variable in (NOISE, BOTH):
        if not isinstance(generator, NoisyTextureGenerator):
            raise GeneratorError(
                f"variable '{settings.variable}': this generator has no noise_shape; "
                "take the variable feature"
            )
        noises = draw(generator.noise_shape, torch.Generator().manual_seed(settings.seed))
    return Latents(feature, noises)


def start(generator: TextureGenerator, settings: Settings) -> Variables:
    """The variables before the first step: F_adv near its origin, noises at theirs."""
    before, by_name = origin(generator, settings), {}
    if before.feature is not None:
        spread = settings.start_spread
        spread = START_SPREAD[settings.feature] if spread is None else spread
        rng = torch.Generator().manual_seed(settings.seed)
        feature = initial(generator.feature_shape, spread=spread, generator=rng)
        tau = settings.bound(FEATURE)
        by_name["feature"] = Variable(project(feature, tau).requires_grad_(), before.feature, tau)
    if before.noises is not None:
        tau = settings.bound(NOISE)
        project(torch.zeros(()), tau)  # an invalid bound is reported at the start
        by_name["noises"] = Variable(before.noises.clone().requires_grad_(), before.noises, tau)
    return Variables(by_name)
