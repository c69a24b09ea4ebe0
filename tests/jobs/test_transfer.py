"""``cnca transfer``: attacks that take no time, judged on pictures as small as can be."""

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from cnca.attack.settings import Settings
from cnca.core.errors import DetectorError, NonFiniteError, RunError
from cnca.core.images import write_texture_srgb
from cnca.core.records import read_record
from cnca.jobs import transfer as job
from cnca.jobs.attack.request import Request
from cnca.jobs.transfer import Transfer, square_rows, transfer
from cnca.jobs.transfer_request import Judging

SCENE = """
vehicle: {mesh: builtin:sedan, texture_size: 32}
variation: {distance: [6, 7], elevation: [10, 20]}
image: {width: 64, height: 64, samples: 2}
"""
QUIET = Console(quiet=True)
WHITE = ("builtin", "builtin:anchor-free")


@pytest.fixture
def request_(tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE)
    return Request(scene, tmp_path / "out", Settings("zebra", seed=3), detectors=WHITE)


@pytest.fixture
def attacked(monkeypatch):
    """Replaces the attacks; the one on the anchor-free detector fails."""
    requests = []

    def attack(request, label, console):
        requests.append(request)
        if "anchor-free" in request.detectors[0]:
            raise NonFiniteError("step 3: the loss is not finite")
        write_texture_srgb(request.out / "texture.png", np.full((8, 8, 3), 0.3, np.float32))

    monkeypatch.setattr(job, "finished", attack)
    return requests


def test_a_square_with_its_failures(request_, attacked):
    results = transfer(request_, Judging(views=2), QUIET)
    assert results.attacks[0].problem is None
    assert "not finite" in results.attacks[1].problem
    assert results.rows == ["normal", "random", "on_builtin shuffled", "on_builtin"]
    assert set(results.AP_voc["normal"]) == {*WHITE, "total"}
    assert read_record(Transfer, request_.out / "transfer.json") == results
    head, rows = square_rows(results)
    assert head == ["texture", *WHITE, "total"]
    assert rows[0] == ["on_builtin_anchor-free", "failed", "failed", "failed"]
    starred = {row[0]: [cell.endswith("*") for cell in row[1:]] for row in rows}
    assert starred["on_builtin"] == [True, False, False]
    assert starred["normal"] == [False] * 3
    text = (request_.out / "transfer.md").read_text()
    assert "- on_builtin_anchor-free: step 3: the loss is not finite" in text


def test_nothing_is_attacked_before_all_judges_are_there(request_, attacked):
    with pytest.raises(DetectorError, match="nowhere"):
        transfer(request_, Judging(judges=("nowhere.onnx",)), QUIET)
    assert attacked == []


def test_all_attacks_fail(request_, attacked):
    """Each detector is attacked with every seed, in a folder of its own."""
    request = replace(request_, detectors=WHITE[1:])
    with pytest.raises(RunError, match="no attack succeeded; the first: step 3"):
        transfer(request, Judging(seeds=2), QUIET)
    folders = [(one.detectors, one.settings.seed, one.out.name) for one in attacked]
    name = "on_builtin_anchor-free"
    assert folders == [((f"{WHITE[1]}=1",), seed, f"{name}_seed{seed}") for seed in (3, 4)]


def test_no_seeds():
    with pytest.raises(RunError, match="--seeds 0: attack each detector at least once"):
        Judging(seeds=0)
