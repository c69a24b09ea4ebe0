"""``cnca optimize`` through kills, full disks and damaged files: nothing lost, nothing wrong."""

import json
import math
import os
import resource
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from tests.attack_process import AttackProcess, result

SHORT = 9
"""Three for each of three kills: none comes later than in the third step after a start."""
LONG = 72


def undisturbed(attacks: AttackProcess, out: Path) -> float:
    """Run an attack to its end; returns the seconds from its start to the end of its first step."""
    began, process = time.monotonic(), attacks.start(out)
    _poll(process, lambda: _size(out / "log.jsonl") > 0, 0.01)
    startup = time.monotonic() - began
    _, words = process.communicate(timeout=9000)
    assert process.returncode == 0, words
    return startup


def killed(
    process: subprocess.Popen, out: Path, moment: str, startup: float, chance: float
) -> bool:
    """Send SIGKILL at a moment of a kind, ``chance`` in [0, 1); False if the process had ended."""
    log, before = out / "log.jsonl", _size(out / "log.jsonl")
    until = time.monotonic() + chance * startup if moment == "startup" else math.inf
    _poll(process, lambda: _size(log) > before or time.monotonic() > until, 0.001)
    if moment == "step":
        last = json.loads(log.read_text().splitlines()[-1])
        time.sleep(chance * last["seconds_total"])
    elif moment == "writing":
        _poll(process, lambda: any(n.startswith(".writing-") for n in os.listdir(out)), 0)
    alive = process.poll() is None
    process.kill()
    process.communicate()
    return alive


def _poll(process: subprocess.Popen, reached, pause: float) -> None:
    while process.poll() is None and not reached():
        time.sleep(pause)


def _size(file: Path) -> int:
    return file.stat().st_size if file.exists() else 0


def survives(attacks: AttackProcess, folder: Path, moments: list[str]) -> None:
    whole, parts, rng = folder / "whole", folder / "parts", np.random.default_rng(0)
    startup = undisturbed(attacks, whole)
    for moment in moments:
        process = attacks.start(parts, "--resume")
        assert killed(process, parts, moment, startup, rng.uniform())
    attacks.finish(parts, "--resume")
    assert result(parts) == result(whole)
    assert len(result(parts)[2]) == attacks.steps
    assert not list(parts.glob(".writing-*"))


def test_three_kills_change_nothing(tmp_path):
    survives(AttackProcess(tmp_path, steps=SHORT), tmp_path, ["startup", "step", "writing"])


@pytest.mark.slow
def test_many_kills_change_nothing(tmp_path):
    moments = ["startup", "step", "writing", "writing"] * 6
    survives(AttackProcess(tmp_path, steps=LONG), tmp_path, moments)


def complaint(process: subprocess.Popen) -> str:
    """The one line with which a process ends that meets bad luck."""
    _, words = process.communicate(timeout=900)
    assert process.returncode == 2, words
    lines = [line for line in words.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    assert "Traceback" not in words
    return lines[0]


@pytest.fixture(scope="module")
def attacks(tmp_path_factory) -> AttackProcess:
    return AttackProcess(tmp_path_factory.mktemp("attacks"), steps=2)


@pytest.fixture(scope="module")
def whole(attacks, tmp_path_factory):
    out = tmp_path_factory.mktemp("whole") / "out"
    attacks.finish(out)
    return result(out)


def test_sigterm_leaves_a_run_that_goes_on(attacks, whole, tmp_path):
    process = attacks.start(tmp_path)
    _poll(process, lambda: _size(tmp_path / "log.jsonl") > 0, 0.001)
    process.terminate()
    _, words = process.communicate(timeout=600)
    assert process.returncode == 143
    assert "with --resume goes on" in words
    attacks.finish(tmp_path, "--resume")
    assert result(tmp_path) == whole


def test_a_full_disk_is_told_and_survived(attacks, whole, tmp_path):
    def limited() -> None:
        # No file may grow beyond this: a log fits in, a checkpoint of this attack does not.
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    out = tmp_path / "out"
    assert "checkpoint.pt: cannot be written (File too large)" in complaint(
        attacks.start(out, "--resume", first=limited)
    )
    assert not (out / "checkpoint.pt").exists()
    attacks.finish(out, "--resume")
    assert result(out) == whole


@pytest.mark.slow
def test_kernel_caches_that_cannot_be_used_change_nothing(attacks, whole, tmp_path):
    """Dr.Jit keeps compiled kernels below HOME; without a place, or damaged, it compiles anew."""
    attacks.finish(tmp_path / "nowhere", HOME="/dev/null")
    assert result(tmp_path / "nowhere") == whole
    home = tmp_path / "home"
    home.mkdir()
    attacks.finish(tmp_path / "fresh", HOME=str(home))
    kernels = sorted(home.glob(".drjit/*.bin"))
    assert len(kernels) > 5
    for index, kernel in enumerate(kernels):
        content = bytearray(kernel.read_bytes())
        content[len(content) // 2] ^= 0xFF
        kernel.write_bytes(content if index % 2 else content[: len(content) // 2])
    attacks.finish(tmp_path / "damaged", HOME=str(home))
    assert result(tmp_path / "damaged") == whole
