"""The command line: quick help, one-line errors, exit codes."""

import platform
import resource
import subprocess
import sys
from importlib import metadata
from inspect import signature

import pydantic
import pytest

from cnca import __version__, cli
from cnca.cli.attack import optimize
from cnca.cli.render import accuracy_generator
from cnca.core.errors import SceneError
from cnca.gen import GUIDANCE
from cnca.mi_bridge import llvm


def _cnca(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "cnca", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def _seconds_for(*arguments: str) -> float:
    """Processor time: what the code needs, not what else the machine is doing."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert _cnca(*arguments).returncode == 0
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@pytest.mark.parametrize("question", ["--help", "--version"])
def test_an_answer_takes_under_half_a_second(question):
    assert min(_seconds_for(question) for _ in range(3)) < 0.5


def test_help_imports_nothing_heavy():
    script = "import sys, cnca.cli; print(*sorted(m for m in sys.modules if '.' not in m))"
    answer = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    imported = set(answer.stdout.split())
    assert "typer" in imported
    assert not imported & {"torch", "mitsuba", "drjit", "numpy", "pydantic", "diffusers", "cv2"}


def test_version_says_all_versions_that_matter_at_once():
    lines = _cnca("--version").stdout.splitlines()
    said = dict(line.split(" ", 1) for line in lines)
    assert lines[0] == f"cnca {__version__}"
    assert said["python"] == platform.python_version()
    assert said["torch"] == metadata.version("torch")
    assert {"mitsuba", "drjit", "diffusers"} <= set(said)
    assert llvm.choose().path.name == said["LLVM"]


def test_generators_are_guided_as_without_the_command_line():
    for command in (optimize, accuracy_generator):
        assert signature(command).parameters["guidance"].default == GUIDANCE


def test_unknown_command_names_the_nearest():
    answer = _cnca("docter")
    assert answer.returncode == 2
    assert "doctor" in answer.stderr


def _run_main_raising(monkeypatch, error: Exception):
    def fail(**_):
        raise error

    monkeypatch.setattr(cli, "app", fail)
    cli.main()


def test_bad_input_is_one_line_and_exit_code_2(monkeypatch, capsys):
    with pytest.raises(SystemExit) as caught:
        _run_main_raising(monkeypatch, SceneError("a.yaml: sun_altitude: must be\nbelow 90"))
    assert caught.value.code == 2
    assert capsys.readouterr().err == "error: a.yaml: sun_altitude: must be below 90\n"


def test_pydantic_errors_are_one_line(monkeypatch, capsys):
    class Camera(pydantic.BaseModel):
        fov: float

    with pytest.raises(pydantic.ValidationError) as wrong:
        Camera(fov="wide")  # type: ignore[arg-type]
    with pytest.raises(SystemExit):
        _run_main_raising(monkeypatch, wrong.value)
    message = capsys.readouterr().err
    assert message.startswith("error: Camera: fov: ")
    assert "'wide'" in message
    assert message.count("\n") == 1


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        RuntimeError("[enforce fail at alloc_cpu.cpp:124] can't allocate memory: you tried …"),
        RuntimeError("jit_malloc(): out of memory! Could not allocate 8 bytes of device memory."),
    ],
)
def test_too_little_memory_is_one_line(monkeypatch, capsys, error):
    wrapped = RuntimeError("dr.while_loop(): encountered an exception (see above).\nmore")
    wrapped.__cause__ = error
    for each in (error, wrapped):
        with pytest.raises(SystemExit):
            _run_main_raising(monkeypatch, each)
        message = capsys.readouterr().err
        assert message.startswith("error: not enough memory (")
        assert message.count("\n") == 1


def test_a_bug_keeps_its_traceback(monkeypatch):
    with pytest.raises(ZeroDivisionError):
        _run_main_raising(monkeypatch, ZeroDivisionError())
