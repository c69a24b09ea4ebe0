"""The code blocks of docs/api.md run, in their order, and do what the page says."""

import ast
import inspect
import re
from pathlib import Path

import pytest
import torch
from rich.console import Console

import cnca
from cnca.gen.feature import StoredFeature
from cnca.jobs.attack import run
from tests.jobs.attack.test_run import SCENE, one_thread  # noqa: F401  (a fixture)

PAGE = Path(__file__).parents[1] / "docs" / "api.md"
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    """A scene of little pictures in place of the one that the page names."""
    path = tmp_path_factory.mktemp("examples") / "scene.yaml"
    path.write_text(SCENE)
    return path


@pytest.mark.usefixtures("one_thread")
def test_every_block_runs_and_the_first_is_the_command(small, tmp_path, monkeypatch, capsys):
    scene = cnca.load_scene(small)
    monkeypatch.setattr(cnca, "load_scene", lambda name: scene, raising=False)
    page: dict = {}
    scores = []
    for block in BLOCKS:
        exec(compile(block, str(PAGE), "exec"), page)
        scores.append(_last_numbers(capsys.readouterr().out))
        if "shots" not in page:
            by_page, settings = page["latents"].feature, page["settings"]
    assert len(scores[1]) == 2  # before and after
    assert scores[5][-1] < scores[5][0]
    # Its detector likes red and dislikes green, always: F_adv ends at its bound, ±τ = ±1.
    assert page["latents"].feature[0, [0, 3]].eq(-1).all()
    assert page["latents"].feature[0, [1, 4]].eq(1).all()
    assert len(scores[7]) == 4

    request = run.Request(small, tmp_path / "run", settings, held_out_views=1)
    run.run(request, Console(quiet=True))
    by_command = StoredFeature.load(request.out / "F_adv.safetensors").feature
    assert torch.equal(by_page, by_command)
    assert by_page.abs().max() > 0


def _last_numbers(output: str) -> list[float]:
    return [float(line.split()[-1]) for line in output.splitlines()]


def test_what_the_package_gives_is_what_type_checkers_are_told():
    tree = ast.parse(inspect.getsource(cnca))
    told = {
        (node.module, alias.asname)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("cnca")
        for alias in node.names
    }
    given = {(f"cnca.{m}", name) for m, names in cnca.PLACES.items() for name in names.split()}
    told.remove(("cnca.core.version", "__version__"))
    assert told - {("cnca", "evaluate"), ("cnca", "optimize")} == given
    for _, name in told:
        assert getattr(cnca, name) is not None
    with pytest.raises(AttributeError, match="has no attribute 'optimise'"):
        cnca.optimise  # noqa: B018
