"""A flag is made from a record's field: written once, there."""

from dataclasses import dataclass, fields
from inspect import signature
from pathlib import Path
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from cnca.attack.settings import Settings
from cnca.cli.attack import optimize
from cnca.cli.options import Given, takes
from cnca.core.errors import RunError
from cnca.core.options import COST, OUTPUT, Flag
from cnca.jobs.attack.request import Request


@dataclass(frozen=True)
class Wheels:
    """A record in a record."""

    count: Annotated[int, Flag("How many.", COST)] = 4
    spare: Annotated[bool, Flag("Carry one more.")] = False
    round: Annotated[bool, Flag("As they should be.")] = True
    made: float = 0.5
    """Not asked for."""

    def __post_init__(self) -> None:
        if self.count < 3:
            raise RunError(f"--count {self.count}: falls over")


@dataclass(frozen=True)
class Car:
    """A record."""

    plate: Annotated[str, Flag("Its number.", positional=True)]
    out: Annotated[Path, Flag("Where it goes.", OUTPUT, short="o")]
    wheels: Wheels
    colors: Annotated[tuple[str, ...], Flag("Of the paint.", name="color")] = ("grey",)
    owner: Annotated[str | None, Flag("Who drives it.")] = None


def _run(*arguments: str, **options):
    """The records that a command with all of Car's flags came to, and what it was told beside."""
    came, app = [], typer.Typer()

    @app.command()
    @takes(Car, **options)
    def drive(given: Given[Car], speed: Annotated[int, typer.Option(help="km/h.")] = 50) -> None:
        """Drive."""
        came.append((given.record(), speed))

    answer = CliRunner().invoke(app, arguments)
    return came[0] if came else answer


NEEDED = "AB-1", "-o", "garage"


def test_what_is_not_said_is_the_fields_default():
    assert _run(*NEEDED) == (Car("AB-1", Path("garage"), Wheels()), 50)


def test_every_flag_reaches_its_field():
    flags = "--count 3 --spare --no-round --color red --color blue --owner me --speed 30"
    car, speed = _run("AB-1", "--out", "road", *flags.split())
    wheels = Wheels(3, spare=True, round=False)
    assert car == Car("AB-1", Path("road"), wheels, ("red", "blue"), "me")
    assert speed == 30


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["AB-1"], "--out"),
        (NEEDED[1:], "plate"),
        ([*NEEDED, "--count", "many"], "--count"),
        ([*NEEDED, "--made", "1"], "--made"),
        ([*NEEDED, "--no-spare"], "--no-spare"),
    ],
)
def test_what_does_not_fit_is_refused(arguments, complaint):
    answer = _run(*arguments)
    assert answer.exit_code == 2
    assert complaint in answer.output


def test_the_records_checks_are_the_commands():
    error = _run(*NEEDED, "--count", "2").exception
    assert isinstance(error, RunError)
    assert "--count 2" in str(error)


def test_help_says_what_the_field_says():
    shown = _run("--help").output
    assert "Carry one more." in shown
    assert "[default: (grey)]" in shown


def test_a_field_without_a_flag_keeps_its_default():
    answer = _run(*NEEDED, "--owner", "me", without=["owner"])
    assert answer.exit_code == 2
    assert _run(*NEEDED, without=["owner"])[0].owner is None


def test_a_flag_of_the_commands_own_stands_in_the_fields_place():
    came, app = [], typer.Typer()

    @app.command()
    @takes(Car, Wheels)
    def paint(
        car: Given[Car],
        wheels: Given[Wheels],
        color: Annotated[str, typer.Option(help="One.")] = "red",
    ) -> None:
        """Paint."""
        came.append((car.record(colors=(color,)), wheels.record()))

    assert CliRunner().invoke(app, [*NEEDED, "--count", "6"]).exit_code == 0
    [(car, wheels)] = came
    assert car.colors == ("red",)
    assert car.wheels == wheels == Wheels(6)  # two records share the flag


def test_every_setting_of_an_attack_has_its_flag():
    """But for those that say so by having none."""
    unasked = {"view_pool", "start_spread"}
    renamed = {"detectors": "detector", "samples": "spp"}
    named = {field.name for record in (Settings, Request) for field in fields(record)}
    asked = set(signature(optimize).parameters)
    assert {renamed.get(name, name) for name in named - {"settings"}} - asked == unasked
