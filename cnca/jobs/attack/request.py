"""What ``cnca optimize`` is asked for: the settings of the attack, and what it works with."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

from cnca.attack.settings import Settings
from cnca.core.errors import RunError
from cnca.core.options import COST, OUTPUT, STRENGTH, Flag
from cnca.gen import GUIDANCE

JOB = "optimize"
"""The command whose folders these are."""


@dataclass(frozen=True)
class Request:
    """One attack; its fields, and those of its settings, are the flags of ``cnca optimize``."""

    scene: Annotated[Path, Flag("Scene file.")]
    out: Annotated[Path, Flag("Folder of the run.", OUTPUT)]
    settings: Settings
    detectors: Annotated[
        tuple[str, ...],
        Flag(
            "builtin (the default), or a file: see docs/detectors.md; repeatable: losses are "
            "summed by weight. A number behind the last = is the weight; end a name that itself "
            "ends so with =1.",
            name="detector",
            metavar="NAME_OR_FILE[=WEIGHT]",
        ),
    ] = ("builtin",)
    """See :func:`cnca.attack.targets.parse_targets`."""
    backend: Annotated[str, Flag("Renderer: mitsuba, cached, raster or module:name.", COST)] = (
        "mitsuba"
    )
    """See :func:`cnca.build.build_loop_renderer`."""
    objective: Annotated[
        str, Flag("What is lowered: paper (equation 11), logit, odds or module:name.", STRENGTH)
    ] = "paper"
    """See :mod:`cnca.attack.objectives`."""
    full_overlap: Annotated[
        float | None,
        Flag("IoU from which a box counts in full, instead of the objective's own.", STRENGTH),
    ] = None
    generator: Annotated[
        Path | None, Flag("Folder in diffusers format; by default the shipped one.")
    ] = None
    """Or ``module:attribute``."""
    efr: Annotated[
        Path | None, Flag("EFR that corrects renders: builtin (for raster), or a file.", COST)
    ] = None
    samples: Annotated[int, Flag("Rays per pixel in the loop.", COST, name="spp")] = 16
    """The verdict takes the scene's own number."""
    texture_size: Annotated[
        int | None, Flag("Texels per side to generate; by default the model's own.", STRENGTH)
    ] = None
    pattern_size: Annotated[
        float | None,
        Flag("Metres on the vehicle from one mark of the pattern to the next.", STRENGTH),
    ] = None
    """What is generated has no seams then, and repeats (:mod:`cnca.jobs.attack.pattern`)."""
    ddim_steps: Annotated[int, Flag("Denoising steps of the generator.", COST)] = 20
    style: Annotated[
        float, Flag("Weight of the style term: the prompt score is to stay.", STRENGTH)
    ] = 0.0
    """See :mod:`cnca.attack.style`; 0 leaves it out."""
    tokens: Annotated[
        int | None, Flag("Tokens of F_adv; by default 77, or 40 that are replaced.", STRENGTH)
    ] = None
    guidance: Annotated[float, Flag("Scale of classifier-free guidance.", STRENGTH)] = GUIDANCE
    gradient_steps: Annotated[
        int | None, Flag("Go back through the last K denoising steps; default all.", COST)
    ] = None
    gradient_checkpointing: Annotated[
        bool, Flag("Keep no activations of the U-Net: less memory, more time.", COST)
    ] = True
    """They are computed again on the way back; else those of all steps are kept."""
    device: Annotated[str, Flag("Where the generator works, cpu or cuda.", COST)] = "cpu"
    """All else works on the CPU."""
    mixed_precision: Annotated[bool, Flag("U-Net in bfloat16 (autocast).", COST)] = False
    held_out_views: Annotated[int, Flag("Views that judge the result.", COST)] = 24
    minutes: Annotated[
        float | None, Flag("Minutes that the run may take; decides the steps.", COST)
    ] = None
    """See :mod:`cnca.jobs.attack.budget`; None takes the steps of the settings."""
    control_seeds: Annotated[
        int, Flag("Seeds of the prompt of which the best is a further control.", COST)
    ] = 0
    tensorboard: Annotated[bool, Flag("Also log into OUT/tensorboard.", OUTPUT)] = False
    resume: Annotated[bool, Flag("Go on with an interrupted run.", OUTPUT)] = False

    def __post_init__(self) -> None:
        """Raises RunError for a time, or a length, that is not valid."""
        if self.minutes is not None and not 0 < self.minutes < math.inf:
            raise RunError(f"minutes is {self.minutes}: give a finite number above 0")
        if self.pattern_size is not None and not 0 < self.pattern_size < math.inf:
            raise RunError(f"pattern_size is {self.pattern_size}: give metres, a number above 0")

    def as_dict(self) -> dict[str, Any]:
        """Everything that decides the result: not the folder, its log, or how it is computed."""
        fields = asdict(self)
        for name in ("out", "tensorboard", "resume", "gradient_checkpointing", "minutes"):
            del fields[name]
        if self.settings.tau == math.inf:
            fields["settings"]["tau"] = "inf"  # which JSON cannot say as a number
        return json.loads(json.dumps(fields, default=str))
