"""The doctor's verdict on this machine and on broken ones."""

import json
import subprocess

import numpy as np
import pytest

from cnca.jobs import doctor


def _process_that(monkeypatch, returncode=0, stdout="", stderr=""):
    answer = subprocess.CompletedProcess([], returncode, stdout, stderr)
    monkeypatch.setattr(doctor.subprocess, "run", lambda *_, **__: answer)


def test_this_machine_renders():
    report = doctor.diagnose()
    assert report.healthy, report.render.failure
    assert report.render.variant in ("llvm_ad_rgb", "cuda_ad_rgb")
    assert json.loads(report.as_json())["healthy"] is True
    assert report.lines()[-1].startswith("test render: works")


def test_the_ball_of_the_test_render_is_lit_and_the_corner_is_not():
    from cnca.mi_bridge.selftest import render_sphere

    image = render_sphere()
    assert np.isfinite(image).all()
    assert image[16, 16].min() > 0.1
    assert image[0, 0].max() == 0


def test_an_aborting_renderer_is_reported_not_suffered(monkeypatch):
    _process_that(monkeypatch, returncode=-6, stderr="LLVM ERROR: Cannot select: fminimum\n")
    trial = doctor.try_render()
    assert trial.failure == "the renderer died of SIGABRT: LLVM ERROR: Cannot select: fminimum"


def test_a_backend_error_is_passed_on(monkeypatch):
    stderr = "Traceback\n  …\ncnca.core.errors.BackendError: no usable LLVM found\n"
    _process_that(monkeypatch, returncode=1, stderr=stderr)
    assert doctor.try_render().failure == "no usable LLVM found"


@pytest.mark.parametrize(
    ("outcome", "failure"),
    [
        ({"mean": 0.0, "finite": True}, "the picture is black"),
        ({"mean": 0.3, "finite": False}, "the picture holds NaN or infinity"),
    ],
)
def test_a_bad_picture_is_no_success(monkeypatch, outcome, failure):
    _process_that(monkeypatch, stdout=json.dumps({"variant": "llvm_ad_rgb", **outcome}))
    assert doctor.try_render().failure == failure
