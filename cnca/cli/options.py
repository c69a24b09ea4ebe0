"""Flags of commands: made from the records that they fill, or shared by several commands."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar, get_args, get_origin, get_type_hints

import typer

from cnca.cli.run_file import Config
from cnca.core.options import COST, OUTPUT, PANELS, WHAT, Flag

Record = TypeVar("Record")

Scorer = Annotated[
    Path | None,
    typer.Option(help="Of cnca train-scorer, or a CLIP folder.", rich_help_panel=WHAT),
]
MOST_SEED = 2**32 - 1
"""Seeds that every generator of random numbers takes, those derived from them too."""
Seed = Annotated[
    int,
    typer.Option(min=0, max=MOST_SEED, help="Seed of everything random.", rich_help_panel=WHAT),
]
Resume = Annotated[
    bool,
    typer.Option("--resume", help="Go on with an interrupted run.", rich_help_panel=OUTPUT),
]
Generator = Annotated[
    Path | None,
    typer.Option(
        help="Folder in diffusers format; by default the shipped one.", rich_help_panel=WHAT
    ),
]
Samples = Annotated[
    int | None, typer.Option(help="Rays per pixel instead of the scene's.", rich_help_panel=COST)
]


class Given(Generic[Record]):
    """What a command line said about a record."""

    def __init__(
        self, kind: type[Record], values: Mapping[str, Any], said: Collection[str] = ()
    ) -> None:
        """``values``: field of the record, or of a record in it → value; ``said``: see below."""
        self._kind, self._values, self._said = kind, values, said

    def record(self, **more: Any) -> Record:
        """The record, with ``more`` for the fields that have no flag in this command.

        Raises the CncaError of the record's own checks.
        """
        return _fill(self._kind, {**self._values, **more})

    def said(self, name: str) -> bool:
        """Whether the command line or its run file gave a field, even if with its default."""
        return name in self._said

    def asks_for(self, *names: str) -> bool:
        """Whether one of these fields, empty by default, was given."""
        return any(self._values.get(name) for name in names)


def takes(
    *records: type,
    without: Sequence[str] = (),
    presets: Mapping[str, Mapping[str, Any]] | None = None,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the flags of the fields of ``records``, and ``--config``.

    The command's first parameters are a :class:`Given` for each record.  Its other parameters are
    flags of its own; one by the name of a field's flag stands in its place, so that the command
    hands that value to :meth:`Given.record` itself.  Fields ``without`` a flag keep their default.
    ``presets`` (name → field → value) are what the command puts in place of defaults; the help
    shows each preset's.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        every = list(inspect.signature(command, eval_str=True).parameters.values())
        of_command = every[len(records) :]
        taken = {parameter.name for parameter in of_command}
        sources = [
            [s for s in _sources(record) if s.name not in taken and s.field not in without]
            for record in records
        ]
        shared = {s.name: s.parameter(presets or {}) for part in sources for s in part}

        def run(context: typer.Context, **given: Any) -> None:
            del given["config"]  # its content has become the others' values
            asked: list[Given[Any]] = [
                Given(
                    record,
                    {s.field: s.value(given[s.name]) for s in part if s.tells(given)},
                    [s.field for s in part if _said(context, s.name)],
                )
                for record, part in zip(records, sources, strict=True)
            ]
            command(*asked, **{name: given[name] for name in taken})

        config = Parameter("config", Parameter.KEYWORD_ONLY, default=None, annotation=Config)
        parameters = [p.replace(kind=Parameter.KEYWORD_ONLY) for p in of_command]
        parameters = sorted([*parameters, *shared.values(), config], key=_place)
        context = Parameter("context", Parameter.KEYWORD_ONLY, annotation=typer.Context)
        parameters.append(context)
        # typer reads both.
        run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        run.__name__, run.__doc__ = command.__name__, command.__doc__
        return run

    return decorate


def _said(context: typer.Context, flag: str) -> bool:
    source = context.get_parameter_source(flag)
    return source is not None and source.name != "DEFAULT"


def _place(parameter: Parameter) -> tuple[int, bool]:
    """Where a flag stands in the help: by its panel, those that must be given first."""
    panel = get_args(parameter.annotation)[1].rich_help_panel
    place = PANELS.index(panel) if panel in PANELS else len(PANELS)
    return place, parameter.default is not Parameter.empty


@dataclass(frozen=True)
class _Source:
    """The field of a record that a flag fills."""

    field: str
    name: str
    """Of the flag, with underscores."""
    flag: Flag
    type: Any
    default: Any
    """MISSING where it must be given."""

    @property
    def repeatable(self) -> bool:
        return get_origin(self.type) is tuple

    def tells(self, given: Mapping[str, Any]) -> bool:
        """Whether the command line says more than the field's default."""
        return not (self.repeatable and given[self.name] is None)

    def value(self, given: Any) -> Any:
        """What the field holds for what typer read."""
        return tuple(given) if self.repeatable and given is not None else given

    def parameter(self, presets: Mapping[str, Mapping[str, Any]]) -> Parameter:
        """What typer makes the flag of."""
        flag, default, kind = self.flag, self.default, self.type
        words: dict[str, Any] = {
            "help": flag.help,
            "metavar": flag.metavar,
            "rich_help_panel": flag.panel,
        }
        if self.name == "seed":
            words |= {"min": 0, "max": MOST_SEED, "metavar": flag.metavar or "INTEGER"}
        if self.repeatable:
            kind = list[get_args(kind)[0]]  # type: ignore[misc]
            if default is not MISSING:
                words["show_default"] = ", ".join(map(str, default)) or False
                kind, default = kind | None, None
        elif any(self.field in values for values in presets.values()):
            words["show_default"] = ", ".join(
                f"{name}: {_in_words(values.get(self.field, default))}"
                for name, values in presets.items()
            )
        if flag.positional:
            information: Any = typer.Argument(**words)
        else:
            information = typer.Option(*self._spellings(), **words)
        return Parameter(
            self.name,
            Parameter.KEYWORD_ONLY,
            annotation=Annotated[kind, information],
            default=Parameter.empty if default is MISSING else default,
        )

    def _spellings(self) -> list[str]:
        long = "--" + self.name.replace("_", "-")
        if self.type is bool and self.default:
            long += f"/--no{long[1:]}"
        return [f"-{self.flag.short}", long] if self.flag.short else [long]


def _in_words(value: Any) -> str:
    """A default for people."""
    if value is None:
        return "none"
    return {True: "on", False: "off"}[value] if isinstance(value, bool) else str(value)


def _sources(record: type) -> Iterator[_Source]:
    """The fields of a record, and of the records in it, that have a flag."""
    hints = get_type_hints(record, include_extras=True)
    for field in fields(record):
        kind = hints[field.name]
        if is_dataclass(kind):
            yield from _sources(kind)  # type: ignore[arg-type]
            continue
        flag = next((m for m in getattr(kind, "__metadata__", ()) if isinstance(m, Flag)), None)
        if flag is not None:
            name = flag.name or field.name
            yield _Source(field.name, name, flag, get_args(kind)[0], field.default)


def _fill(record: type[Record], values: Mapping[str, Any]) -> Record:
    """A record from values by the names of its fields and of those of the records in it."""
    hints, content = get_type_hints(record), {}
    for field in fields(record):  # type: ignore[arg-type]
        kind = hints[field.name]
        if field.name in values:
            content[field.name] = values[field.name]
        elif is_dataclass(kind):
            content[field.name] = _fill(kind, values)  # type: ignore[arg-type]
    return record(**content)
