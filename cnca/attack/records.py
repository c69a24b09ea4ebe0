"""The record of a step of the attack; ``log.jsonl`` holds it line by line under the same names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cnca.core.records import Omitted


@dataclass(frozen=True)
class Reading:
    """What one detector sees of some pictures."""

    loss_adv: float
    """The objective, L_adv in the paper; of several detectors the sum, by weight."""
    D_s: float
    """Mean detection score (max D_s) in [0, 1]; of several detectors the mean, by weight."""


@dataclass(frozen=True)
class Readings(Reading):
    """What all targets see of them, together and one by one."""

    targets: Mapping[str, Reading] = field(default_factory=dict)
    """By name; logs of the first versions have none."""


@dataclass(frozen=True, kw_only=True)
class StepRecord(Readings):
    """One step: what the targets saw, and the seconds of its parts."""

    step: int
    """From 1."""
    validation: Omitted[Readings] = None
    """What they saw of the validation views, after a step that is checked."""
    seconds_generate: Omitted[float] = None
    seconds_render: Omitted[float] = None
    seconds_detect: Omitted[float] = None
    seconds_backward: Omitted[float] = None
    seconds_check: Omitted[float] = None
    seconds_total: float

    @property
    def seconds(self) -> dict[str, float]:
        """Part of the step → its seconds, of those that it had; ``total`` is the whole step."""
        return {
            name.removeprefix("seconds_"): value
            for name, value in vars(self).items()
            if name.startswith("seconds_") and value is not None
        }


def step_record(
    step: int, seen: Readings, validation: Readings | None, seconds: Mapping[str, float]
) -> StepRecord:
    """The record of a step; ``seconds``: part of the step → its seconds, ``total`` among them."""
    parts = {f"seconds_{name}": round(value, 6) for name, value in seconds.items()}
    return StepRecord(
        step=step,
        loss_adv=seen.loss_adv,
        D_s=seen.D_s,
        targets=seen.targets,
        validation=validation,
        **parts,
    )
