"""Options that several commands share, each said once."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields
from inspect import Parameter, Signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from cnca.cli.run_file import Config

if TYPE_CHECKING:
    from cnca.jobs.attack.run import Request

Scorer = Annotated[Path | None, typer.Option(help="Of cnca train-scorer, or a CLIP folder.")]
Seed = Annotated[int, typer.Option(help="Seed of everything random.")]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with an interrupted run.")]
Generator = Annotated[
    Path | None, typer.Option(help="Folder in diffusers format; by default the shipped one.")
]
Samples = Annotated[int | None, typer.Option(help="Rays per pixel instead of the scene's.")]


def takes(options: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command one flag for each field of the dataclass ``options``, its first parameter."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        own = list(inspect.signature(command, eval_str=True).parameters.values())[1:]
        shared = _parameters(options)

        def run(**given: Any) -> None:
            command(options(**{one.name: given.pop(one.name) for one in shared}), **given)

        # typer reads both; required parameters come first only in its help.
        every = [one.replace(kind=Parameter.KEYWORD_ONLY) for one in [*own, *shared]]
        every.sort(key=lambda one: one.default is not Parameter.empty)
        run.__signature__ = Signature(every)  # type: ignore[attr-defined]
        run.__annotations__ = {one.name: one.annotation for one in every}
        run.__name__, run.__doc__ = command.__name__, command.__doc__
        return run

    return decorate


def _parameters(options: type) -> list[Parameter]:
    hints = get_type_hints(options, include_extras=True)
    return [
        Parameter(
            field.name,
            Parameter.KEYWORD_ONLY,
            annotation=hints[field.name],
            default=Parameter.empty if field.default is MISSING else field.default,
        )
        for field in fields(options)
    ]


@dataclass(frozen=True, kw_only=True)
class AttackOptions:
    """What every attack takes."""

    scene: Annotated[Path, typer.Option(help="Scene file.")]
    out: Annotated[Path, typer.Option(help="Folder of the run.")]
    detector: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME_OR_FILE[=WEIGHT]",
            help="builtin (the default), or a file: see docs/detectors.md; repeatable: losses are "
            "summed by weight. A number behind the last = is the weight; end a name that itself "
            "ends so with =1.",
        ),
    ] = None
    backend: Annotated[
        str, typer.Option(help="Renderer: mitsuba, cached, raster or module:name.")
    ] = "mitsuba"
    steps: Annotated[int, typer.Option(help="Updates of F_adv.")] = 100
    views_per_step: Annotated[int, typer.Option(help="Pictures per update.")] = 8
    learning_rate: Annotated[float, typer.Option(help="Step size.")] = 0.01
    decay: Annotated[bool, typer.Option("--decay", help="Let it fall to 0 along a cosine.")] = False
    update: Annotated[str, typer.Option(help="adam, or sign for signed steps.")] = "adam"
    objective: Annotated[
        str, typer.Option(help="What is lowered: paper (equation 11), logit, odds or module:name.")
    ] = "paper"
    full_overlap: Annotated[
        float | None,
        typer.Option(help="IoU from which a box counts in full, instead of the objective's own."),
    ] = None
    generator: Generator = None
    efr: Annotated[
        Path | None,
        typer.Option(help="EFR that corrects renders: builtin (for raster), or a file."),
    ] = None
    feature: Annotated[
        str, typer.Option(help="concat (the paper) or replace (its released code).")
    ] = "concat"
    tokens: Annotated[
        int | None, typer.Option(help="Tokens of F_adv; by default 77, or 40 that are replaced.")
    ] = None
    guidance: Annotated[float, typer.Option(help="Scale of classifier-free guidance.")] = 2.5
    gradient_steps: Annotated[
        int | None, typer.Option(help="Go back through the last K denoising steps; default all.")
    ] = None
    gradient_checkpointing: Annotated[
        bool, typer.Option(help="Keep no activations of the U-Net: less memory, more time.")
    ] = True
    device: Annotated[str, typer.Option(help="Where the generator works, cpu or cuda.")] = "cpu"
    mixed_precision: Annotated[
        bool, typer.Option("--mixed-precision", help="U-Net in bfloat16 (autocast).")
    ] = False
    spp: Annotated[int, typer.Option(help="Rays per pixel in the loop.")] = 16
    held_out_views: Annotated[int, typer.Option(help="Views that judge the result.")] = 24
    check_every: Annotated[
        int, typer.Option(help="Steps between checks on views of their own; keeps the best F_adv.")
    ] = 0
    patience: Annotated[
        int, typer.Option(help="Stop after so many checks in a row without gain; 0 never stops.")
    ] = 0
    tensorboard: Annotated[
        bool, typer.Option("--tensorboard", help="Also log into OUT/tensorboard.")
    ] = False
    seed: Seed = 0
    config: Config = None

    def request(self, prompt: str, *, resume: bool = False) -> Request:
        """The attack with this prompt, under the bound τ = 1."""
        from cnca.attack.settings import Settings
        from cnca.jobs.attack.run import Request

        settings = Settings(
            prompt,
            steps=self.steps,
            views_per_step=self.views_per_step,
            learning_rate=self.learning_rate,
            decay=self.decay,
            update=self.update,
            check_every=self.check_every,
            patience=self.patience,
            seed=self.seed,
            feature=self.feature,
        )
        return Request(
            self.scene,
            tuple(self.detector or ["builtin"]),
            self.out,
            settings,
            backend=self.backend,
            objective=self.objective,
            full_overlap=self.full_overlap,
            generator=self.generator,
            efr=self.efr,
            samples=self.spp,
            tokens=self.tokens,
            guidance=self.guidance,
            gradient_steps=self.gradient_steps,
            gradient_checkpointing=self.gradient_checkpointing,
            device=self.device,
            mixed_precision=self.mixed_precision,
            held_out_views=self.held_out_views,
            tensorboard=self.tensorboard,
            resume=resume,
        )
