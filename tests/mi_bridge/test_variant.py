"""Which Mitsuba variant is chosen."""

import subprocess

import pytest

from cnca.core.errors import BackendError
from cnca.mi_bridge import variant


@pytest.mark.parametrize(("works", "expected"), [(True, "cuda_ad_rgb"), (False, "llvm_ad_rgb")])
def test_the_gpu_is_used_where_it_traces_rays(monkeypatch, works, expected):
    monkeypatch.delenv("CNCA_VARIANT", raising=False)
    monkeypatch.setattr(variant, "cuda_traces_rays", lambda: works)
    assert variant.wanted_variant() == expected


def test_the_environment_decides_without_a_trial(monkeypatch):
    def never():
        raise AssertionError("the GPU was tried although the variant is given")

    monkeypatch.setattr(variant, "cuda_traces_rays", never)
    monkeypatch.setenv("CNCA_VARIANT", "llvm_ad_rgb")
    assert variant.wanted_variant() == "llvm_ad_rgb"
    monkeypatch.setenv("CNCA_VARIANT", "llvm")
    with pytest.raises(BackendError, match="did you mean 'llvm_ad_rgb'"):
        variant.wanted_variant()


@pytest.mark.parametrize(("words", "threads"), [("1", 1), ("3", 3), ("", 5), ("many", 5)])
def test_the_renderer_has_as_many_threads_as_torch(monkeypatch, words, threads):
    before = variant.dr.thread_count()
    try:
        variant.dr.set_thread_count(5)
        monkeypatch.setenv("OMP_NUM_THREADS", words)
        variant.bound_threads()
        assert variant.dr.thread_count() == threads
    finally:
        variant.dr.set_thread_count(before)


def test_without_a_driver_nothing_is_started(monkeypatch):
    def no_driver(name):
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(variant.ctypes, "CDLL", no_driver)
    monkeypatch.setattr(variant.subprocess, "run", None)  # calling it would raise
    assert not variant.cuda_traces_rays()


def test_a_gpu_that_aborts_is_not_used(monkeypatch):
    aborted = subprocess.CompletedProcess([], -6)
    monkeypatch.setattr(variant.ctypes, "CDLL", lambda name: None)
    monkeypatch.setattr(variant.subprocess, "run", lambda *_, **__: aborted)
    assert not variant.cuda_traces_rays()
