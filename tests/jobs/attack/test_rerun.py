"""``cnca rerun``: a manifest is enough to come to the same texture."""

from dataclasses import replace
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console

from cnca.attack.settings import Settings
from cnca.core.errors import RunError
from cnca.core.images import write_texture_srgb
from cnca.core.manifest import Manifest, hashes, versions, write_json
from cnca.core.records import read_record
from cnca.gen.feature import StoredFeature
from cnca.jobs.attack import run
from cnca.jobs.attack.rerun import read_request, rerun
from cnca.judge.summary import Summary
from tests.gen.tiny import save_pipeline, tiny_pipeline
from tests.jobs.attack.test_run import SCENE, one_thread  # noqa: F401  (a fixture)

QUIET = Console(quiet=True)


@pytest.fixture
def request_(tmp_path) -> run.Request:
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE)
    settings = Settings(
        "zebra strips", tau=0.5, steps=2, views_per_step=1, learning_rate=0.1, variable="both"
    )
    return run.Request(
        scene,
        tmp_path / "first",
        settings,
        generator=save_pipeline(tiny_pipeline(), tmp_path / "tiny"),
        samples=2,
        ddim_steps=2,
        held_out_views=1,
    )


@pytest.mark.usefixtures("one_thread")
def test_the_texture_is_the_same_to_the_bit(request_, tmp_path):
    summary = run.run(request_, QUIET)
    manifest, out = request_.out / "manifest.json", tmp_path / "again"
    again = rerun(manifest, out, QUIET)
    assert (again.difference, again.other_versions) == (0.0, {})
    features = [StoredFeature.load(folder / "F_adv.safetensors") for folder in (request_.out, out)]
    assert torch.equal(features[0].feature, features[1].feature)
    assert torch.equal(features[0].noises, features[1].noises)
    assert features[0].feature.abs().max() > 0
    assert read_record(Summary, out / "summary.json") == summary


def test_what_differs_is_said(request_, tmp_path, monkeypatch):
    manifest = request_.out / "manifest.json"
    then = {"versions": versions() | {"torch": "1.0"}, "inputs": hashes([request_.scene])}
    write_json(manifest, {"request": request_.as_dict(), **then})
    write_texture_srgb(manifest.with_name("texture.png"), np.zeros((8, 8, 3), np.float32))
    asked = []

    def paint_it_grey(request, console):
        asked.append(request)
        write_texture_srgb(request.out / "texture.png", np.full((8, 8, 3), 0.2, np.float32))

    monkeypatch.setattr("cnca.jobs.attack.rerun.run", paint_it_grey)
    again = rerun(manifest, tmp_path / "again", QUIET)
    assert asked == [replace(request_, out=tmp_path / "again")]
    assert again.difference == pytest.approx(0.2, abs=0.5 / 255)  # 8 bits
    assert again.other_versions == {"torch": ("1.0", metadata.version("torch"))}

    request_.scene.write_text(SCENE + "# another\n")
    with pytest.raises(RunError, match=r"scene\.yaml: has changed since .*manifest\.json"):
        rerun(manifest, tmp_path / "third", QUIET)
    request_.scene.unlink()
    with pytest.raises(RunError, match=r"scene\.yaml: is gone.*start from the folder"):
        rerun(manifest, tmp_path / "third", QUIET)
    assert len(asked) == 1


def test_a_request_comes_back_as_it_was_written():
    settings = Settings("p", tau=float("inf"), decay=True, feature="replace")
    asked = run.Request(
        Path("a.yaml"), Path("c"), settings, ("b.cfg", "c.cfg=2"), generator=Path("d")
    )
    assert read_request(Path("m"), Manifest("", asked.as_dict(), {}, {}), Path("c")) == asked


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"request": {"settings": "a"}}, "m: not the manifest of a cnca optimize"),
        ({"stepps": 3}, "m: stepps: unknown key; did you mean 'steps'?"),
        ({"steps": "many"}, "m: settings.steps: Input should be a valid integer"),
        ({"steps": 0}, "steps is 0"),
    ],
)
def test_a_manifest_that_is_none_is_named(change, message):
    asked = run.Request(Path("a.yaml"), Path("c"), Settings("p")).as_dict()
    content = {**asked, "settings": asked["settings"] | change, **change.pop("request", {})}
    with pytest.raises(RunError, match=message.replace("?", r"\?")) as caught:
        read_request(Path("m"), Manifest("optimize", content, {}, {}), Path("c"))
    assert "\n" not in str(caught.value)
