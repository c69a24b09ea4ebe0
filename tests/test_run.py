"""The ./run script, as far as it goes without installing anything."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

RUN = Path(__file__).parents[1] / "run"


def _run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [shutil.which("bash") or "bash", str(RUN), *arguments]
    env = {**os.environ, **environment}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=env)


@pytest.mark.parametrize("arguments", [(), ("dmeo",)])
def test_a_missing_or_unknown_verb_lists_the_verbs(arguments):
    answer = _run(*arguments)
    assert answer.returncode == 1
    assert answer.stderr.startswith("error: ")
    assert all(
        verb in answer.stderr for verb in ("setup", "demo", "test", "lint", "docs", "package")
    )


def test_help_succeeds():
    answer = _run("--help")
    assert answer.returncode == 0
    assert answer.stdout.startswith("usage: ./run VERB")


def test_without_a_new_enough_python_it_says_what_to_install(tmp_path):
    (tmp_path / "dirname").symlink_to(shutil.which("dirname"))
    answer = _run("setup", PATH=str(tmp_path), PYTHON="")
    assert answer.returncode == 1
    assert answer.stderr.strip().startswith("error: no Python 3.11 or newer found; install one")
