"""Records as JSON and back."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest
from pydantic import Field

from cnca.core.errors import RunError
from cnca.core.records import Omitted, as_json, from_json, read_record


@dataclass(frozen=True)
class Wheel:
    radius: float
    flat: Omitted[str] = None


@dataclass(frozen=True)
class Car:
    name: str | None
    precision: Annotated[Mapping[str, float], Field(alias="AP@0.5")]
    wheels: Sequence[Wheel]


CAR = Car(None, {"sedan": 0.5}, [Wheel(0.25), Wheel(0.25, flat="nail")])
PLAIN = {
    "name": None,
    "AP@0.5": {"sedan": 0.5},
    "wheels": [{"radius": 0.25}, {"radius": 0.25, "flat": "nail"}],
}


def test_fields_are_keys_and_what_is_omitted_has_none():
    assert as_json(CAR) == PLAIN


def test_a_record_comes_back_from_its_file(tmp_path):
    path = tmp_path / "car.json"
    path.write_text(json.dumps(as_json(CAR)))
    assert read_record(Car, path) == CAR


def test_keys_of_later_versions_are_ignored():
    assert from_json(Wheel, {"radius": 1, "width": 2}, Path("w.json")) == Wheel(1.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"AP@0.5": {"sedan": "x"}}, r"car\.json: AP@0\.5\.sedan: .*number"),
        ({"wheels": [{}]}, r"car\.json: wheels\.0\.radius: Field required"),
        ({"wheels": None}, r"car\.json: wheels: "),
    ],
)
def test_what_is_wrong_is_named(change, words):
    with pytest.raises(RunError, match=words):
        from_json(Car, PLAIN | change, Path("car.json"))


@pytest.mark.parametrize("text", [None, "{", "[]"])
def test_a_file_that_is_damaged_or_missing_is_named(tmp_path, text):
    path = tmp_path / "car.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(RunError, match=r"car\.json: "):
        read_record(Car, path)
