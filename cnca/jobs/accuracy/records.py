"""What ``accuracy.json`` holds: the view, its reference, and the rungs of the ladder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cnca.effects.effect import Model
from cnca.scene.cameras import View


@dataclass(frozen=True)
class PassSeconds:
    """Processor seconds of one picture and its gradient."""

    forward: float
    backward: float


@dataclass(frozen=True)
class RungSeconds:
    """Processor seconds of a rung."""

    first: PassSeconds
    """Of the first call, which makes kernels and solves the fog."""
    steady: PassSeconds
    """The fastest of the later ones."""


@dataclass(frozen=True)
class MeasuredRung:
    """One plan beside the reference, over the vehicle's pixels.

    Errors are relative, as :mod:`cnca.effects.prices` counts them; a negative one is one that noise
    hides.
    """

    name: str
    target: float | None
    """The error that was asked for; seconds hold the pilot's."""
    models: Mapping[str, Model]
    """Effect → model."""
    scale: float
    """Share of the picture's sides that is rendered."""
    predicted_error: float
    seconds: RungSeconds
    error: float
    """Bias and noise together."""
    bias: float
    bias_hidden: float
    """The bias that noise could hide: two standard errors of its square."""
    mean: float
    """Signed bias of the mean radiance, relative."""
    mean_error: float
    """Its standard error."""
    noise: float
    delta_e: float
    """Mean ΔE2000."""
    gradient_cosine: float
    gradient_length: float
    """Relative to the reference's gradient."""
    score_change: float
    """Mean absolute change of the detection score."""


@dataclass(frozen=True)
class Agreement:
    """How well the reference's halves agree."""

    samples: int
    """Rays per pixel of both together."""
    standard_error: float
    """Of the mean of both halves, as errors of rungs are counted."""
    difference_of_means: float
    """Of the halves' mean radiance, relative."""
    halves_agree: bool
    """Whether that is no more than noise explains."""
    converged: bool
    gradient_cosine: float
    seconds: float


@dataclass(frozen=True)
class ReferenceRecord(Agreement):
    """The reference that all rungs were compared with."""

    key: str
    """See :func:`cnca.jobs.accuracy.reference.fingerprint`."""
    volpath: bool
    """Whether its pictures are Mitsuba's ``volpath``'s."""


@dataclass(frozen=True)
class AccuracyReport:
    """The content of ``accuracy.json``."""

    scene: str
    view: View
    detector: str
    reference: ReferenceRecord
    versions: Mapping[str, str]
    rungs: list[MeasuredRung]
    not_reached: list[str] = field(default_factory=list)
    """Names of the rungs for which there was no time."""
    front: list[str] = field(default_factory=list)
    """See :func:`cnca.jobs.accuracy.ladder.pareto_front`; empty until all is measured."""
