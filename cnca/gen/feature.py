"""The adversarial feature F_adv: start values, the bound κ, and its file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from cnca.errors import GeneratorError

Feature = Float[Tensor, "tokens width"]
"""F_adv: ``tokens`` vectors as wide as the text encoder's, unbounded until projected."""


def initial(
    shape: tuple[int, int], *, spread: float = 0.0, generator: torch.Generator | None = None
) -> Feature:
    """Return the start of F_adv: zeros, or normal noise of standard deviation ``spread``."""
    return spread * torch.randn(shape, generator=generator) if spread else torch.zeros(shape)


def project(feature: Feature, tau: float) -> Feature:
    """κ of the paper's equation 13: clip every element to [−τ, τ]; τ = ∞ changes nothing.

    Raises :class:`GeneratorError` where τ is negative or NaN, or where F_adv is not finite
    (clipping would hide an infinity).
    """
    if not tau >= 0.0:
        raise GeneratorError(f"tau is {tau}: give a number of 0 or more, or inf for no bound")
    check_finite(feature)
    return feature if math.isinf(tau) else feature.clamp(-tau, tau)


def check_finite(feature: Feature) -> None:
    """Raise :class:`GeneratorError` if F_adv holds NaN or infinity."""
    bad = int((~torch.isfinite(feature)).sum())
    if bad:
        raise GeneratorError(
            f"F_adv has {bad} of {feature.numel()} values that are NaN or infinite; "
            "start again from a finite feature or with smaller steps"
        )


@dataclass(frozen=True)
class StoredFeature:
    """An F_adv with what it was made for."""

    feature: Feature
    prompt: str
    tau: float

    def save(self, path: Path) -> None:
        """Write a safetensors file; a reader never sees half of it."""
        unfinished = path.with_name(path.name + ".tmp")
        metadata = {"prompt": self.prompt, "tau": repr(float(self.tau))}
        save_file({"F_adv": self.feature.detach().contiguous()}, unfinished, metadata)
        unfinished.replace(path)

    @classmethod
    def load(cls, path: Path) -> StoredFeature:
        """Read what :meth:`save` wrote; raises :class:`GeneratorError` for any other file."""
        try:
            with safe_open(path, framework="pt") as file:
                metadata = file.metadata() or {}
                stored = cls(file.get_tensor("F_adv"), metadata["prompt"], float(metadata["tau"]))
        except (OSError, SafetensorError, KeyError, ValueError) as error:
            reason = str(error).splitlines()[0]
            raise GeneratorError(
                f"{path}: no adversarial feature ({reason}); give a file written by a CNCA attack"
            ) from error
        check_finite(stored.feature)
        return stored
