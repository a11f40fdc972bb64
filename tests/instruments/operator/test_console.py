"""The operator at a terminal: answers are waited for, a rejection never is."""

from __future__ import annotations

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


@pytest.mark.parametrize(
    ("typed", "answer"), [("\n", True), ("y\n", True), ("Yes\n", True), ("n\n", False), ("what?\n", False)]
)
def test_an_answer(console: Console, monkeypatch, capsys, typed: str, answer: bool) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(typed))
    assert console.confirm(Ready("P01", "latch", 10)) is answer
    assert capsys.readouterr().err.endswith("Ready? [Y/n] ")


@pytest.mark.parametrize(("typed", "answer", "times"), [("\n\nYes\n", True, 3), ("what?\nn\n", False, 2)])
def test_consent_is_never_given_by_enter_alone(
    console: Console, monkeypatch, capsys, typed: str, answer: bool, times: int
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(typed))
    assert console.confirm(Consent("P01")) is answer
    assert capsys.readouterr().err == times * "Has P01 read and signed the consent form? [y/n] "


def test_nobody_there(console: Console, monkeypatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    with pytest.raises(InstrumentError, match="Nobody is at the console"):
        console.confirm(Consent("P01"))


def test_what_comes_from_a_pipe_is_kept_for_a_question(console: Console, monkeypatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("r\n"))
    assert console.rejects() is False
    assert sys.stdin.readline() == "r\n"


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a terminal that a test can type at")
def test_r_and_enter_reject_the_press_before(console: Console, monkeypatch, capsys) -> None:
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
