"""The adversarial feature F_adv: its two kinds, start values, the bound κ, and its file.

``concat`` is the paper: [κ(F_adv), F_txt] (equations 8, 12 and 13).  ``replace`` is what the
authors' released code does instead: the last 40 of the prompt's 77 tokens are optimized, from the
prompt's own embedding, and clamped to within ±τ of it.  Here F_adv is in both cases the difference
from what the model would read without an attack: each element lies in [−τ, τ], and F_adv = 0 is
the prompt alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from cnca.core.errors import GeneratorError
from cnca.core.files import replacing
from cnca.gen.choices import CONCAT, REPLACE, UPDATE_NAMES, check_kind
from cnca.gen.noise import Noises

START_SPREAD = {CONCAT: 0.1, REPLACE: 0.0}
"""Standard deviation of F_adv at the start: tokens of padding are alike and, without it, would
stay nearly so; the released code starts at the prompt's own embedding."""

Feature = Float[Tensor, "tokens width"]
"""F_adv: ``tokens`` vectors as wide as the text encoder's, unbounded until projected."""


def default_tokens(kind: str, length: int) -> int:
    """Tokens of F_adv beside a text of ``length``: as many, or the released code's 40 of 77."""
    return length if check_kind(kind) == CONCAT else max(1, round(length * 40 / 77))


def initial(
    shape: tuple[int, int], *, spread: float = 0.0, generator: torch.Generator | None = None
) -> Feature:
    """Return the start of F_adv: zeros, or normal noise of standard deviation ``spread``."""
    return spread * torch.randn(shape, generator=generator) if spread else torch.zeros(shape)


def project(feature: Float[Tensor, "*shape"], tau: float) -> Float[Tensor, "*shape"]:
    """κ of the paper's equation 13: clip every element to [−τ, τ]; τ = ∞ changes nothing.

    Raises :class:`GeneratorError` where τ is negative or NaN, or where F_adv is not finite
    (clipping would hide an infinity).
    """
    if not tau >= 0.0:
        raise GeneratorError(f"tau is {tau}: give a number of 0 or more, or inf for no bound")
    check_finite(feature)
    return feature if math.isinf(tau) else feature.clamp(-tau, tau)


class SignedSteps(torch.optim.SGD):
    """F ← F − η · sign(∇L), the other update in use (PGD, Madry et al. 2018)."""

    def step(self, closure: Any = None) -> Any:
        """Move every element by the learning rate, or not at all where its gradient is 0."""
        for group in self.param_groups:
            for parameter in group["params"]:
                parameter.grad.sign_()
        return super().step(closure)


UPDATES: dict[str, type[torch.optim.Optimizer]] = dict(
    zip(UPDATE_NAMES, (torch.optim.Adam, SignedSteps), strict=True)
)
"""Name → update of F_adv (equation 12); the paper's is Adam."""


def check_finite(values: Tensor, subject: str = "F_adv has") -> None:
    """Raise :class:`GeneratorError` if F_adv (the ``subject``) holds NaN or infinity."""
    bad = int((~torch.isfinite(values)).sum())
    if bad:
        raise GeneratorError(
            f"{subject} {bad} of {values.numel()} values that are NaN or infinite; "
            "start again from finite ones or with smaller steps"
        )


@dataclass(frozen=True)
class StoredFeature:
    """The result of an attack, F_adv or noises or both, with what it was made for."""

    feature: Feature | None
    prompt: str
    tau: float
    """Bound on each element of F_adv; ``inf`` where there is none."""
    kind: str = CONCAT
    noises: Noises | None = None
    """Of stochastic DDIM; None where it was deterministic."""

    def save(self, path: Path) -> None:
        """Write a safetensors file whole or not at all; raises RunError if that cannot be done."""
        metadata = {"prompt": self.prompt, "tau": repr(float(self.tau)), "feature": self.kind}
        tensors = {"F_adv": self.feature, "noises": self.noises}
        content = save(
            {n: t.detach().contiguous() for n, t in tensors.items() if t is not None}, metadata
        )
        with replacing(path) as temporary:
            temporary.write_bytes(content)

    @classmethod
    def load(cls, path: Path) -> StoredFeature:
        """Read what :meth:`save` wrote; raises :class:`GeneratorError` for any other file."""
        try:
            with safe_open(path, framework="pt") as file:
                metadata, names = file.metadata() or {}, file.keys()
                if not {"F_adv", "noises"} & set(names):
                    raise KeyError("neither F_adv nor noises")
                stored = cls(
                    file.get_tensor("F_adv") if "F_adv" in names else None,
                    metadata["prompt"],
                    float(metadata["tau"]),
                    check_kind(metadata.get("feature", CONCAT)),  # the only one that once was
                    file.get_tensor("noises") if "noises" in names else None,
                )
        except (OSError, SafetensorError, KeyError, ValueError) as error:
            reason = str(error).splitlines()[0]
            raise GeneratorError(
                f"{path}: no adversarial feature ({reason}); give a file written by a CNCA attack"
            ) from error
        for values in (stored.feature, stored.noises):
            if values is not None:
                check_finite(values, f"{path}: has")
        return stored
