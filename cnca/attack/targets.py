"""The detectors that an attack is to fool, one or several at once (an ensemble)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from cnca.attack.detection_scores import best_scores
from cnca.attack.records import Reading, Readings
from cnca.core.errors import DetectorError, NonFiniteError, RunError
from cnca.core.types import Boxes, SrgbImages
from cnca.scene.protocols import Detector, Objective


@dataclass(frozen=True)
class Target:
    """A detector with its part in the loss."""

    name: str
    """As the user gave it."""
    detector: Detector
    label: int
    """The detector's class that the vehicle belongs to."""
    weight: float = 1.0


Seen = Float[Tensor, "2 targets"]
"""Of each target, over some pictures: mean of the objective, and of max D_s in [0, 1]."""


def refuse_black_boxes(targets: Sequence[Target]) -> None:
    """Raise DetectorError for a detector that gives no gradient."""
    for target in targets:
        if not target.detector.differentiable:
            reason = getattr(target.detector, "why_black", "")
            raise DetectorError(
                f"detector {target.name}: gives no gradient{reason and f' ({reason})'}, so it can "
                "only judge; attack a .cfg, another .onnx, a folder of transformers or a "
                "torchvision model, then cnca evaluate --detector"
            )


def look(objective: Objective, targets: Sequence[Target], images: SrgbImages, boxes: Boxes) -> Seen:
    """Show the pictures to every target; differentiable.  ``boxes``: where the vehicle is."""
    columns = []
    for target in targets:
        candidates = target.detector.candidates(images)
        losses = objective(candidates, boxes, target.label)
        scores = best_scores(candidates, boxes, target.label)
        columns.append(torch.stack([losses.mean(), scores.mean()]))
    return torch.stack(columns, dim=1)


def refuse_non_finite(targets: Sequence[Target], seen: Seen, where: str) -> None:
    """Raise NonFiniteError, which names the detectors, where a loss is NaN or infinite."""
    finite = seen.isfinite().all(dim=0).tolist()
    wrong = [target.name for target, fine in zip(targets, finite, strict=True) if not fine]
    if wrong:
        raise NonFiniteError(
            f"{where}: the loss of detector {', '.join(wrong)} is not finite; "
            "--resume tries this step again"
        )


def weighted_loss(targets: Sequence[Target], seen: Seen) -> Float[Tensor, ""]:
    """Σ weight · loss."""
    return seen[0] @ seen.new_tensor([target.weight for target in targets])


def readings(targets: Sequence[Target], seen: Seen) -> Readings:
    """The summed loss, the score averaged by weight, and both of each target by its name."""
    weights = seen.new_tensor([target.weight for target in targets])
    return Readings(
        loss_adv=weighted_loss(targets, seen).item(),
        D_s=(seen[1] @ weights / weights.sum()).item(),
        targets={
            target.name: Reading(loss, score)
            for target, (loss, score) in zip(targets, seen.T.tolist(), strict=True)
        },
    )


def parse_targets(words: Sequence[str]) -> dict[str, float]:
    """``NAME_OR_FILE[=WEIGHT]``, each → weight; a number behind the last ``=`` is the weight.

    Raises:
        RunError: none is given, one is given twice, or a weight is not finite and above 0.
    """
    weights: dict[str, float] = {}
    for word in words:
        name, weight = _split(word)
        if not 0 < weight < math.inf:
            raise RunError(f"--detector {word}: a weight is a finite number above 0")
        if name in weights:
            raise RunError(f"--detector {name}: is there twice; leave it out once")
        weights[name] = weight
    if not weights:
        raise RunError("no --detector: give at least one")
    return weights


def _split(word: str) -> tuple[str, float]:
    name, _, end = word.rpartition("=")
    try:
        return (name, float(end)) if name else (word, 1.0)
    except ValueError:
        return word, 1.0
