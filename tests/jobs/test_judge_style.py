"""``cnca judge-style`` on pictures and run folders."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from cnca.cli import app
from cnca.core.errors import GeneratorError, RunError
from cnca.core.images import write_texture_srgb
from cnca.gen.textures import draw
from cnca.jobs.judge_style import judge_style


@pytest.fixture
def zebra(tmp_path):
    """The folder of a run that was asked for zebra strips, and got them."""
    folder = tmp_path / "run"
    picture = draw("zebra", "", "", np.random.default_rng(0)).clip(0, 1)
    write_texture_srgb(folder / "texture.png", picture)
    (folder / "summary.json").write_text(json.dumps({"prompt": "zebra strips"}))
    return folder


def test_a_run_says_what_was_asked_for(zebra, tmp_path):
    other = f"other={zebra / 'texture.png'}"
    (zebra / "summary.json").write_text(json.dumps({"prompt": "red plaid"}))
    (verdict, _) = judge_style([str(zebra), other], out=tmp_path / "verdicts.json")
    assert verdict.asked == "red plaid"
    assert verdict.ranked[0][0] == "zebra strips"
    assert verdict.right is False
    assert sum(verdict.shares.values()) == pytest.approx(1, abs=1e-3)
    assert len(verdict.shares) == 11  # the ten, and the one that was asked for
    written = json.loads((tmp_path / "verdicts.json").read_text())
    assert written["textures"][0]["shares"] == verdict.shares


def test_the_command_prints_a_table(zebra):
    answer = CliRunner().invoke(app, ["judge-style", str(zebra)])
    assert answer.exit_code == 0, answer.output
    assert "zebra strips" in answer.output
    assert "the prompt that was asked for: 1 of 1 textures" in answer.output


def test_bad_input(zebra):
    (zebra / "summary.json").unlink()
    with pytest.raises(GeneratorError, match="a judge needs two or more"):
        judge_style([str(zebra)], prompts=["zebra strips"])
    (zebra / "summary.json").write_text(json.dumps({"prompt": 3}))
    with pytest.raises(RunError, match="summary.json: prompt is 3, must be text"):
        judge_style([str(zebra)])
