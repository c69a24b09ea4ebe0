"""The generator's price list: its numbers against closed forms, and the command on a tiny model."""

import dataclasses
import json

import pytest
import torch
from rich.console import Console

from cnca.core.errors import RunError
from cnca.jobs.accuracy import generator as generator_accuracy
from cnca.jobs.accuracy.request import GradientRequest
from tests.gen.conftest import tiny, tiny_folder  # noqa: F401


def test_cosine_and_length_against_the_full_gradient():
    gradients = {
        1: [torch.tensor([1.0, 0.0]), torch.tensor([0.0, 3.0])],
        2: [torch.tensor([1.0, 1.0]), torch.tensor([0.0, 6.0])],
    }
    short, full = generator_accuracy.prices(gradients, {1: [0.5, 0.4], 2: [1.0, 0.7]})
    assert short.cosine == pytest.approx((0.5**0.5 + 1) / 2)
    assert short.length == pytest.approx((0.5**0.5 + 0.5) / 2)
    assert full.cosine == pytest.approx(1)
    assert (full.steps, full.seconds, full.seconds_kept, full.length) == (2, 1.0, 0.7, 1.0)


def test_the_command_writes_table_picture_and_numbers(tiny_folder, tmp_path):  # noqa: F811
    out = tmp_path / "prices"
    request = GradientRequest(out, "zebra", generator=tiny_folder, probes=1)
    report = generator_accuracy.generator_accuracy(request, Console(quiet=True))
    assert json.loads((out / "generator.json").read_text())["prices"] == [
        dataclasses.asdict(row) for row in report.prices
    ]
    rows = {row.steps: row for row in report.prices}
    assert rows[20].cosine == pytest.approx(1)
    assert rows[1].seconds < rows[20].seconds
    assert (out / "generator.md").read_text().count("\n") == 2 + len(rows)
    assert (out / "generator.png").stat().st_size > 1000


def test_no_probes_are_refused(tmp_path):
    with pytest.raises(RunError, match="--probes 0"):
        GradientRequest(tmp_path, "zebra", probes=0)
