"""An attack in several processes ends as in one."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from cnca.attack.loop import draw_pool
from cnca.attack.settings import Settings
from cnca.core import parallel
from cnca.core.errors import RunError
from cnca.scene.schema import Scene
from tests.attack_process import AttackProcess, result
from tests.attack_rank import SETTINGS, run_rank
from tests.gen.branches_rank import run_rank as run_branches

TORCHRUN = [sys.executable, "-m", "torch.distributed.run", "--standalone"]


def launch(processes: int, *arguments: str, options: tuple[str, ...] = ()) -> str:
    """Run under torchrun; returns what was printed."""
    command = [*TORCHRUN, f"--nproc-per-node={processes}", *options, "-m", *arguments]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=900, check=False)
    assert answer.returncode == 0, answer.stderr
    return answer.stdout


def outcome(folder: Path, rank: int) -> tuple[torch.Tensor, list[dict]]:
    content = json.loads((folder / f"rank{rank}.json").read_text())
    return torch.tensor(content["feature"]), content["records"]


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    folder = tmp_path_factory.mktemp("alone")
    run_rank(folder)
    return outcome(folder, 0)


def check(folder: Path, processes: int, alone) -> None:
    feature, records = outcome(folder, 0)
    # Sums of float32 in another order: each step moves F_adv by 0.1, a millionth of it is rounding.
    assert torch.allclose(feature, alone[0], rtol=0, atol=1e-6)
    assert [r["step"] for r in records] == [r["step"] for r in alone[1]][-len(records) :]
    for own, other in zip(records[::-1], alone[1][::-1], strict=False):
        assert own["loss_adv"] == pytest.approx(other["loss_adv"], rel=1e-5)
        assert own["D_s"] == pytest.approx(other["D_s"], rel=1e-5)
    for rank in range(1, processes):
        assert torch.equal(outcome(folder, rank)[0], feature)


def test_two_processes_end_as_one(tmp_path, alone):
    launch(2, "tests.attack_rank", str(tmp_path))
    check(tmp_path, 2, alone)
    assert len(outcome(tmp_path, 1)[1]) == SETTINGS.steps


@pytest.mark.parametrize("processes", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_the_branches_of_the_denoiser_are_divided(tmp_path, processes):
    """Two of three processes run the same one."""
    run_branches(tmp_path)
    alone = torch.load(tmp_path / "rank0.pt", weights_only=True)
    launch(processes, "tests.gen.branches_rank", str(tmp_path))
    every = [torch.load(tmp_path / f"rank{k}.pt", weights_only=True) for k in range(processes)]
    assert alone.pop("branches").tolist() == [2, 2]
    assert all(own["branches"].tolist() == [1, 1] for own in every)
    for name, expected in alone.items():
        largest = float(expected.abs().max())
        assert largest > 1e-3  # or nothing is compared
        for own in every:
            assert torch.equal(own[name], every[0][name])
            torch.testing.assert_close(own[name], expected, rtol=0, atol=1e-5 * largest)


@pytest.mark.slow
@pytest.mark.parametrize("processes", [3, 4])
def test_also_with_uneven_shares(tmp_path, alone, processes):
    launch(processes, "tests.attack_rank", str(tmp_path))
    check(tmp_path, processes, alone)


@pytest.mark.slow
def test_a_process_that_dies_is_started_again(tmp_path, alone):
    launch(2, "tests.attack_rank", str(tmp_path), "3", options=("--max-restarts=1",))
    assert (tmp_path / "died").exists()
    check(tmp_path, 2, alone)
    assert len(outcome(tmp_path, 0)[1]) < SETTINGS.steps  # it went on from a checkpoint


@pytest.mark.slow
def test_the_command_in_two_processes(tmp_path):
    """The path tracer's noise too is the same: it belongs to the view."""
    attacks = AttackProcess(tmp_path, steps=3)
    for name, processes in (("one", 1), ("two", 2)):
        more = ("--views-per-step", "4", "--check-every", "2")
        printed = launch(processes, *attacks.command(tmp_path / name, *more)[2:])
        assert printed.count("camouflage over shuffled control") == 1
    one, two = (result(tmp_path / name) for name in ("one", "two"))
    assert [r["step"] for r in two[2]] == [1, 2, 3]
    for own, other in zip(two[2], one[2], strict=True):
        assert own["loss_adv"] == pytest.approx(other["loss_adv"], rel=1e-3)
    assert two[3]["score_after"] == pytest.approx(one[3]["score_after"], abs=0.01)


def test_alone_nothing_happens():
    assert parallel.LAUNCHED not in os.environ
    with parallel.joined():
        assert (parallel.rank(), parallel.count()) == (0, 1)
        assert parallel.share([1, 2, 3]) == [1, 2, 3]
        assert parallel.by_first(lambda: "done") == "done"
    values = torch.ones(2)
    parallel.add_up(values, None)
    assert values.tolist() == [1, 1]


def test_each_process_needs_a_view(monkeypatch):
    monkeypatch.setattr(parallel, "count", lambda: 4)
    with pytest.raises(RunError, match="views_per_step is 2: give each of the 4 processes"):
        draw_pool(Scene(), Settings("grey", views_per_step=2))
