"""SIGTERM and Ctrl-C: the words that go on, the exit code, and the handler given back."""

import os
import signal

import pytest
from rich.console import Console

from cnca.core.interrupts import resumable


@pytest.fixture(autouse=True)
def ctrl_c_is_heard():
    """Shells start what runs in the background with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_signals_end_with_their_code_and_the_advice(capsys, number, code):
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(SystemExit) as ended, resumable(Console(stderr=True), "do it again"):
        os.kill(os.getpid(), number)
    assert ended.value.code == code
    assert capsys.readouterr().err == "interrupted; do it again\n"
    assert signal.getsignal(signal.SIGTERM) == before


def test_an_interrupt_behind_another_error_is_one(capsys):
    """Which the renderer makes of a Ctrl-C that comes while it works."""
    from cnca.mi_bridge.variant import dr, mi

    class Interrupted(dr.CustomOp):
        def eval(self, value):
            raise KeyboardInterrupt

    with pytest.raises(SystemExit) as ended, resumable(Console(stderr=True), "do it again"):
        dr.custom(Interrupted, mi.Float(1))
    assert ended.value.code == 130
    assert capsys.readouterr().err == "interrupted; do it again\n"


def test_other_errors_pass():
    with pytest.raises(ZeroDivisionError), resumable(Console(quiet=True), "do it again"):
        raise ZeroDivisionError
