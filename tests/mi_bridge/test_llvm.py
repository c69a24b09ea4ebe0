"""The choice of LLVM, on the real machine and on made-up ones."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cnca.core.errors import BackendError
from cnca.mi_bridge import llvm


@pytest.mark.parametrize(
    ("name", "major"),
    [
        ("libLLVM.so.19.1", 19),
        ("libLLVM-15.so.1", 15),
        ("libLLVM-14.0.6.so", 14),
        ("libLLVM-17.so", 17),
        ("libLLVM.so.22.1-vendor-1.95.0", 22),
        ("libLLVM.so", None),
        ("libLLVM-C.so", None),
    ],
)
def test_file_names_tell_the_version(name, major):
    assert llvm.major_from_name(Path("/usr/lib") / name) == major


def test_candidates_are_real_files_without_duplicates():
    paths = llvm.candidates()
    assert len(paths) == len(set(paths))
    assert all(path.is_file() and path == path.resolve() for path in paths)


def _made_up(folder: Path, majors: dict[str, int | None], monkeypatch) -> list[Path]:
    """Empty files that claim a version by name; None is a library that does not load."""
    for name in majors:
        (folder / name).touch()

    def answer(path: Path) -> int:
        major = majors[path.name]
        if major is None:
            raise OSError("wrong ELF class")
        return major

    monkeypatch.setattr(llvm, "major_from_library", answer)
    paths = [folder / name for name in majors]
    monkeypatch.setattr(llvm, "candidates", lambda: paths)
    monkeypatch.delenv(llvm.VARIABLE, raising=False)
    return paths


def test_the_newest_that_loads_is_chosen(tmp_path, monkeypatch):
    names = {"libLLVM-15.so": 15, "libLLVM-18.so": 18, "libLLVM-21.so": None, "libLLVM.so": 20}
    _made_up(tmp_path, names, monkeypatch)
    assert llvm.choose().path.name == "libLLVM.so"
    assert llvm.choose().major == 20


def test_every_refusal_is_explained(tmp_path, monkeypatch):
    names = {"libLLVM-15.so": 15, "libLLVM.so": 16, "libLLVM-21.so": None}
    _made_up(tmp_path, names, monkeypatch)
    with pytest.raises(BackendError) as caught:
        llvm.choose()
    message = str(caught.value)
    assert "libLLVM-15.so: LLVM 15 is older than 17" in message
    assert "libLLVM.so: LLVM 16 is older than 17" in message
    assert "wrong ELF class" in message
    assert "apt install" in message
    assert "\n" not in message


def test_a_machine_without_llvm_is_told_what_to_install(tmp_path, monkeypatch):
    _made_up(tmp_path, {}, monkeypatch)
    with pytest.raises(BackendError, match=r"none installed.*apt install libllvm19"):
        llvm.choose()


def test_the_users_choice_wins_over_a_newer_one(tmp_path, monkeypatch):
    paths = _made_up(tmp_path, {"libLLVM-18.so": 18, "libLLVM-21.so": 21}, monkeypatch)
    monkeypatch.setenv(llvm.VARIABLE, str(paths[0]))
    assert llvm.choose().major == 18


def test_a_file_that_is_no_library_is_refused_in_one_line(tmp_path):
    path = tmp_path / "libLLVM-20.so"
    path.write_bytes(b"no library")
    refusal = llvm.inspect(path).refusal
    assert refusal is not None
    assert "does not load" in refusal
    assert "\n" not in refusal


def _import_mitsuba(**environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from cnca.mi_bridge.variant import mi; print(mi.variant())"]
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **environment},
    )


def _refused_in_one_line(answer: subprocess.CompletedProcess[str]) -> str:
    assert answer.returncode == 1, f"expected an exception, got code {answer.returncode}"
    last = answer.stderr.strip().splitlines()[-1]
    assert last.startswith("cnca.core.errors.BackendError: ")
    return last


def test_an_old_llvm_raises_instead_of_aborting():
    old = [path for path in llvm.candidates() if (llvm.major_from_name(path) or 99) < llvm.OLDEST]
    if not old:
        pytest.skip(f"this machine has no LLVM older than {llvm.OLDEST}")
    for path in old:
        answer = _import_mitsuba(**{llvm.VARIABLE: str(path), "CNCA_VARIANT": "llvm_ad_rgb"})
        assert "is older than 17" in _refused_in_one_line(answer)


def test_a_missing_llvm_file_raises():
    answer = _import_mitsuba(**{llvm.VARIABLE: "no/libLLVM.so", "CNCA_VARIANT": "llvm_ad_rgb"})
    assert "no/libLLVM.so: no such file" in _refused_in_one_line(answer)


def test_an_unknown_variant_names_the_nearest():
    answer = _import_mitsuba(CNCA_VARIANT="llvm_ad_rg")
    assert "did you mean 'llvm_ad_rgb'?" in _refused_in_one_line(answer)


def test_importing_mitsuba_sets_the_variant_and_the_library():
    from cnca.mi_bridge import variant

    assert variant.mi.variant() in variant.VARIANTS
    assert variant.activate() == variant.mi.variant()
    if variant.mi.variant() == "llvm_ad_rgb":
        assert llvm.inspect(Path(os.environ[llvm.VARIABLE])).refusal is None
