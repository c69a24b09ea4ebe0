"""What else several processes divide comes to the same as in one."""

import json
import subprocess
import sys

import pytest
import torch
from rich.console import Console
from safetensors.torch import load_file

from cnca.jobs.datasets.rendered import render_dataset
from cnca.jobs.datasets.request import DatasetRequest
from tests.core.test_parallel import launch
from tests.jobs.datasets.test_rendered import SCENE as DATASET_SCENE
from tests.jobs.datasets.test_rendered import files
from tests.jobs_rank import SCENE, run_jobs, write_inputs


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """The same jobs in one process and in two."""
    one, two = (tmp_path_factory.mktemp(name) for name in ("one", "two"))
    for folder in (one, two):
        write_inputs(folder)
    run_jobs(one)
    launch(2, "tests.jobs_rank", str(two))
    return one, two


def numbers(content) -> list[float]:
    """All numbers of a JSON document, in its order."""
    if isinstance(content, dict):
        content = list(content.values())
    if isinstance(content, list):
        return [number for each in content for number in numbers(each)]
    return [content] if isinstance(content, int | float) else []


@pytest.mark.parametrize("evaluation", ["evidence", "table2"])
def test_an_evaluation(folders, evaluation):
    one, two = (json.loads((f / evaluation / "results.json").read_text()) for f in folders)
    assert list(one) == list(two)
    assert len(numbers(one)) > 10
    # The detector's sums of float32 depend on its number of threads.
    assert numbers(two) == pytest.approx(numbers(one), abs=1e-3)


def test_each_picture_is_rendered_by_one(folders):
    one, two = folders
    every = int((one / "taken0").read_text())
    shares = [int((two / f"taken{rank}").read_text()) for rank in (0, 1)]
    assert shares == [every - every // 2, every // 2]


def test_a_training_of_the_efr(folders):
    one, two = folders
    alone = load_file(one / "efr0.safetensors")
    first, second = (load_file(two / f"efr{rank}.safetensors") for rank in (0, 1))
    for name, weights in alone.items():
        assert torch.equal(first[name], second[name])
        assert weights.dtype == torch.float64
        assert torch.allclose(first[name], weights, rtol=0, atol=1e-9)  # of steps of 1e-2


def test_a_data_set(tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(DATASET_SCENE)
    render_dataset(DatasetRequest(scene, tmp_path / "one", images=12), Console(quiet=True))
    command = "cnca", "render-dataset", "--scene", str(scene), "--out", str(tmp_path / "two")
    printed = launch(2, *command, "--images", "12")
    assert printed.count("12 pictures rendered") == 1
    assert files(tmp_path / "two") == files(tmp_path / "one")


def both(last_words: str, *command: str) -> None:
    """A command alone and in two processes, below folders ``one`` and ``two``; each speaks once."""
    alone = [sys.executable, "-m", "cnca", *(word.format("one") for word in command)]
    printed = subprocess.run(alone, capture_output=True, text=True, check=True).stdout
    divided = launch(2, "cnca", *(word.format("two") for word in command))
    assert (printed.count(last_words), divided.count(last_words)) == (1, 1)


def reports(folder, name) -> list:
    return [json.loads((folder / where / name).read_text()) for where in ("one", "two")]


@pytest.mark.slow
def test_the_command_evaluate(tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE)
    given = "--scene", f"{tmp_path}/scene.yaml", "--out", f"{tmp_path}/{{}}", "--views", "8"
    both("tables and pictures", "evaluate", *given)
    one, two = reports(tmp_path, "results.json")
    assert list(one) == list(two)
    assert numbers(two) == pytest.approx(numbers(one), abs=1e-3)  # as in test_an_evaluation


@pytest.mark.slow
def test_the_command_train_efr(tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE)
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    given = "--from-render", f"{tmp_path}/scene.yaml", "--out", f"{tmp_path}/{{}}/efr.safetensors"
    both("mean absolute error", "train-efr", *given, "--views", "4", "--epochs", "1", "--spp", "1")
    one, two = reports(tmp_path, "efr.json")
    assert two["error_before"] == pytest.approx(one["error_before"], abs=2e-5)  # rounded to 1e-5
    # After four steps of Adam, which makes much of the rounding of small gradients.
    assert two["per_epoch"][0] == pytest.approx(one["per_epoch"][0], rel=1e-3)
    assert (tmp_path / "two" / "efr.safetensors").exists()
