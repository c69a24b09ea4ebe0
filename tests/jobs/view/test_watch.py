"""The page that watches runs: from folders as a running and a finished attack leave them."""

import json

import cv2
import numpy as np
import pytest
import torch

from cnca.core.errors import RunError
from cnca.jobs.attack.now import TEXTURE_NOW, VIEWS_NOW, Display
from cnca.jobs.view.serve import serving
from cnca.jobs.view.watch import POINTS, WatchPage, curves_of, read_log
from tests.accessibility import complaints


def line(step, **more):
    record = {"step": step, "loss_adv": 2 / step, "D_s": 1 / step, "seconds_total": 2.0, **more}
    return json.dumps(record) + "\n"


@pytest.fixture
def run(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    request = {"scene": "s.yaml", "settings": {"prompt": "zebra", "steps": 8}}
    content = {"job": "optimize", "request": request, "versions": {}, "inputs": {}}
    (folder / "manifest.json").write_text(json.dumps(content))
    return folder


def test_a_run_that_goes_on(run):
    page = WatchPage([run])
    empty = page.read(run)
    assert (empty.step, empty.steps, empty.seconds_left) == (0, 8, None)
    seen = {"loss_adv": 0.5, "D_s": 0.25}
    (run / "log.jsonl").write_text(line(1) + line(2, validation=seen) + line(3)[:9])
    now = page.read(run)
    assert (now.step, now.prompt, now.seconds_left) == (2, "zebra", 12.0)
    curves = {curve.name: (curve.steps, curve.values) for curve in now.curves}
    assert curves["score"] == ([1, 2], [1.0, 0.5])
    assert curves["loss, validation"] == ([2], [0.5])
    first = page.newer(0, timeout=0)
    assert page.newer(first["number"], timeout=0) is None
    cv2.imwrite(str(run / "texture.png"), np.zeros((512, 512, 3), np.uint8))
    later = page.newer(first["number"], timeout=0)
    assert later["runs"][0]["pictures"]["texture.png"].startswith("data:image/jpeg")


def test_the_current_paint_until_it_is_removed(run):
    display, page = Display(run), WatchPage([run])
    texture, views = torch.rand(3, 16, 16), torch.rand(8, 3, 12, 20)
    display.show(texture, views)
    assert cv2.imread(str(run / VIEWS_NOW)).shape == (24, 80, 3)
    written = cv2.imread(str(run / TEXTURE_NOW))[..., ::-1] / 255
    assert np.abs(written - texture.permute(1, 2, 0).numpy()).max() <= 0.5 / 255 + 1e-6
    assert page.read(run).pictures.keys() == {TEXTURE_NOW, VIEWS_NOW}
    display.remove()
    assert page.read(run).pictures == {}


def test_the_current_paint_takes_a_hundredth_of_the_time(run, monkeypatch):
    clock = iter([100.0, 100.5, 149.9, 150.1, 150.2])
    monkeypatch.setattr("cnca.jobs.attack.now.time.monotonic", lambda: next(clock))
    display, shown = Display(run), []
    for level in (0.0, 0.5, 1.0):
        display.show(torch.full((3, 4, 4), level), torch.zeros(1, 3, 4, 4))
        shown.append(cv2.imread(str(run / TEXTURE_NOW)).max())
    assert shown == [0, 0, 255]


def test_long_curves_are_thinned_and_keep_their_end(run):
    (run / "log.jsonl").write_text("".join(line(k) for k in range(1, 1001)))
    score = curves_of(read_log(run / "log.jsonl"))[0]
    assert len(score.steps) <= POINTS + 1
    assert (score.steps[0], score.steps[-1]) == (1, 1000)


def test_a_folder_without_a_run(tmp_path):
    with pytest.raises(RunError, match="holds no run"):
        WatchPage([tmp_path])


@pytest.mark.parametrize("width", [400, 1100])
def test_two_runs_in_the_browser(open_page, run, width):
    (run / "log.jsonl").write_text(line(1) + line(2))
    with serving(WatchPage([run, run]), 0) as address:
        page = open_page(address, width=width)
        page.get_by_text("step 2 of 8: about 12 s of steps to go").first.wait_for()
        assert page.locator("article").count() == 2
        assert complaints(page) == []
        assert page.evaluate("document.documentElement.scrollWidth") == width
        (run / "log.jsonl").write_text(line(1) + line(2) + line(3))
        page.get_by_text("step 3 of 8").first.wait_for()
