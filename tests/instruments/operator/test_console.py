"""The operator at a terminal: answers are waited for, a rejection never is."""

import io
import os
import sys

import pytest

from haploop.base.clock import RealClock
from haploop.base.errors import InstrumentError
from haploop.instruments import Consent, Press, Ready
from haploop.instruments.operator.console import Console


@pytest.fixture
def console() -> Console:
    return Console.open(Console.Settings(), RealClock())


CONSENT = "Has P01 read and signed the consent form? [y/n] "


@pytest.mark.parametrize(("typed", "asked", "answer", "said"), [
    *((typed, Ready("P01", "latch", 10), True, "Ready? [Y/n] ") for typed in ("\n", "y\n", "Yes\n")),
    *((typed, Ready("P01", "latch", 10), False, "Ready? [Y/n] ") for typed in ("n\n", "what?\n")),
    # Consent is never given by Enter alone.
    ("\n\nYes\n", Consent("P01"), True, 3 * CONSENT),
    ("what?\nn\n", Consent("P01"), False, 2 * CONSENT),
])  # fmt: skip
def test_an_answer(console, monkeypatch, capsys, typed, asked, answer, said):
    monkeypatch.setattr(sys, "stdin", io.StringIO(typed))
    assert console.confirm(asked) is answer
    told = capsys.readouterr().err
    assert told == said if isinstance(asked, Consent) else told.endswith(said)


def test_nobody_there(console, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    with pytest.raises(InstrumentError, match="Nobody is at the console"):
        console.confirm(Consent("P01"))


def test_what_comes_from_a_pipe_is_kept_for_a_question(console, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO("r\n"))
    assert console.rejects() is False
    assert sys.stdin.readline() == "r\n"


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a terminal that a test can type at")
def test_r_and_enter_reject_the_press_before(console, monkeypatch, capsys):
    keyboard, terminal = os.openpty()
    with os.fdopen(terminal, "r") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        assert console.rejects() is False
        os.write(keyboard, b"r")
        assert console.rejects() is False, "the line is not over"
        os.write(keyboard, b"\n")
        assert console.rejects() is True
        assert console.rejects() is False, "it is said once"
        os.write(keyboard, b"hello\n")
        assert console.rejects() is False
    os.close(keyboard)
    console.tell(Press("latch", "P01", 2, 10, 2, "It was pressed twice."))
    assert capsys.readouterr().err == "It was pressed twice. Press the latch button again (2 of 10).\n"
