"""Seeds that no generator takes are refused in one line, in every command."""

import pytest
from typer.testing import CliRunner

from cnca.cli.app import app

COMMANDS = {
    "optimize": ["--prompt", "x", "--out", "o"],
    "evaluate": ["--out", "o"],
    "render-scene": ["builtin:sedan_clear", "-o", "o.png"],
}


@pytest.mark.parametrize("seed", ["-1", "4294967296", "18446744073709551616", "1.5", "x"])
@pytest.mark.parametrize("command", COMMANDS)
def test_seeds_out_of_range(command, seed):
    answer = CliRunner().invoke(app, [command, *COMMANDS[command], "--seed", seed])
    assert answer.exit_code == 2
    assert "--seed" in answer.output
