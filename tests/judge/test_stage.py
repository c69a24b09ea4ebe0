"""Pictures are taken once for all detectors, and a rerun goes on where it stopped."""

import pytest
import torch

from cnca.judge.evaluate import Shots
from cnca.judge.stage import Eye, Stage, see
from cnca.scene.cameras import orbit_view
from cnca.scene.weather import Weather
from tests.fakes import BrightnessDetector, FlatRenderer

VIEWS = [orbit_view(a, 10, 7, fov=45, width=12, height=12) for a in (0, 90, 180)]
SHOTS = Shots([VIEWS[:2], VIEWS[2:]], [Weather(sun_altitude=20), Weather(sun_altitude=40)], seed=0)


def stage(folder, **coats):
    levels = {"normal": 0.5, "A": 0.1} | coats
    made = {n: lambda weather, v=v: torch.full((3, 4, 4), v) for n, v in levels.items()}
    return Stage("s", FlatRenderer(), SHOTS, made, folder, key="k")


def eye(name="a"):
    return Eye(name, BrightnessDetector(), key=name)


def test_every_texture_is_rendered_once_whatever_the_number_of_detectors(tmp_path):
    here, eyes = stage(tmp_path), [eye("a"), eye("b")]
    advanced = []
    seen = see([here], eyes, lambda: advanced.append(1))
    assert here.renderer.calls == 4 == len(advanced)
    assert list(seen) == ["normal", "A"]
    assert len(seen["A"]["b"].detections) == 3
    assert all(len(e.detector.looks) == 6 for e in eyes)
    assert here.boxes().shape == (3, 4)


def test_a_rerun_does_nothing_anew_and_another_detector_only_looks(tmp_path):
    first = see([stage(tmp_path)], [eye()])
    again, same, new = stage(tmp_path), eye(), eye("new")
    seen = see([again], [same, new])
    assert again.renderer.calls == 0 == len(same.detector.looks)
    assert len(new.detector.looks) == 6
    for row in first:
        for one, other in zip(first[row]["a"].detections, seen[row]["a"].detections, strict=True):
            assert torch.equal(one.scores, other.scores)


def test_only_a_changed_texture_is_rendered_again(tmp_path):
    see([stage(tmp_path)], [eye()])
    changed = stage(tmp_path, A=0.2)
    see([changed], [eye()])
    assert changed.renderer.calls == 2


def test_an_interrupted_evaluation_goes_on(tmp_path):
    here = stage(tmp_path)

    def stop():
        if here.renderer.calls == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        see([here], [eye()], stop)
    again = stage(tmp_path)
    see([again], [eye()])
    assert again.renderer.calls == 1


def test_views_of_several_stages_follow_each_other(tmp_path):
    bright = Stage("t", FlatRenderer(), SHOTS, stage(tmp_path, A=0.9).coats, tmp_path, key="k")
    seen = see([stage(tmp_path), bright], [eye()])
    scores = [float(found.scores[0]) for found in seen["A"]["a"].detections]
    assert scores[:3] == pytest.approx([scores[0]] * 3)
    assert scores[3:] == pytest.approx([scores[3]] * 3)
    assert scores[0] < scores[3]
