"""A stop that comes where Python drops exceptions is heeded all the same, once."""

import ctypes
import gc
import os
import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Callable
from pathlib import Path

import click
import pytest

from haploop.base import at_once, signals
from haploop.base.signals import STOPPING, ending_in_order
from haploop.terminal.exits import Commands


class Stops:
    """Its destructor is where the signal arrives."""

    def __init__(self, number: int) -> None:
        self.number = number

    def __del__(self) -> None:
        signal.raise_signal(self.number)


class StopsTwice(Stops):
    """The signal that is sent again arrives in a destructor as well."""

    def __del__(self) -> None:
        Stops(self.number)
        time.sleep(0.05)


class Plain:
    """Can be referred to weakly."""


def weak_reference(number: int) -> None:
    gone = Plain()
    kept = weakref.ref(gone, lambda _: signal.raise_signal(number))
    del gone
    assert kept() is None


def finaliser(number: int) -> None:
    weakref.finalize(Plain(), signal.raise_signal, number)


def generator(number: int) -> None:
    def steps():
        try:
            yield
        finally:
            signal.raise_signal(number)

    begun = steps()
    next(begun)


def cycle(number: int) -> None:
    gone = Stops(number)
    gone.itself = gone
    del gone
    gc.collect()


def collection(number: int) -> None:
    def called(*_: object) -> None:
        gc.callbacks.remove(called)
        signal.raise_signal(number)

    gc.callbacks.append(called)
    gc.collect()


def import_of_c(number: int) -> None:
    try:
        signal.raise_signal(number)
    except BaseException:
        raise ImportError("numpy.core.multiarray failed to import") from None


def called_from_c(number: int) -> None:
    ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(number))()


PLACES: list[Callable[[int], object]] = [
    *(signal.raise_signal, Stops, StopsTwice, weak_reference, finaliser, generator, cycle, collection),
    *(import_of_c, called_from_c),
]


@click.group(cls=Commands)
def commands() -> None:
    """Stand for the command line."""


@commands.command()
@click.pass_obj
def work(_state: object) -> None:
    place, number, with_rig = DOING[-1]
    if with_rig:
        with ending_in_order():
            place(number)
            time.sleep(60)
            raise AssertionError("The stop was lost.")
    place(number)
    time.sleep(60)
    raise AssertionError("The stop was lost.")


DOING: list[tuple[Callable[[int], object], int, bool]] = []


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("with_rig", [False, True], ids=["before a rig", "with a rig"])
@pytest.mark.parametrize("number", [n for n in STOPPING if n != getattr(signal, "SIGBREAK", None)])
@pytest.mark.parametrize("place", PLACES, ids=lambda place: place.__name__)
def test_no_stop_is_lost(place, number, with_rig, full, capsys):
    handlers = [signal.getsignal(kind) for kind in STOPPING]
    for _ in range(17 if full else 1):
        DOING.append((place, number, with_rig))
        with pytest.raises(SystemExit) as ended:
            commands.main(["work"])
        assert ended.value.code == 128 + number
        assert capsys.readouterr().err.strip() == "Error: Stopped."
    assert handlers == [signal.getsignal(kind) for kind in STOPPING]


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_that_comes_while_another_is_dropped_is_not_lost(number, monkeypatch):
    """On a busy computer a signal was sent again just when the one before it was heard, and dropped."""
    number_of = signals._number_of

    def meanwhile(stop):
        monkeypatch.setattr(signals, "_number_of", number_of)
        signal.raise_signal(number)
        return number_of(stop)

    monkeypatch.setattr(signals, "_number_of", meanwhile)
    with pytest.raises((KeyboardInterrupt, SystemExit)), ending_in_order():
        Stops(number)
        time.sleep(3)
        raise AssertionError("The stop was lost.")


def test_a_program_of_a_user_keeps_its_own_interrupts():
    hook, handler = sys.unraisablehook, signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), ending_in_order():
        Stops(signal.SIGINT)
        time.sleep(3)
    assert sys.unraisablehook is hook and signal.getsignal(signal.SIGINT) is handler


def test_what_else_is_dropped_is_shown_as_before(monkeypatch):
    class Fails:
        def __del__(self) -> None:
            raise ValueError("of somebody else")

    class Exits:
        def __del__(self) -> None:
            sys.exit(3)

    shown: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda what: shown.append(what.exc_type))
    with ending_in_order():
        Fails()
        Exits()
        time.sleep(0.1)
    assert shown == [ValueError, SystemExit]


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_during_the_first_imports_ends_the_command_at_once(tmp_path, number):
    (tmp_path / "lazy_loader.py").write_text(f"import signal; signal.raise_signal({number:d})")
    path = os.pathsep.join([str(tmp_path), str(Path(__file__).parents[3])])
    for command in (["-m", "haploop"], [str(tmp_path / "haploop")]):
        (tmp_path / "haploop").write_text("from haploop.__main__ import main\nmain()")
        ended = subprocess.run(
            [sys.executable, *command, "schema"],
            env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert (ended.returncode, ended.stderr) == (128 + number, "Error: Stopped.\n"), command


@pytest.mark.parametrize(
    ("argv", "orig", "so"),
    [
        (["-m"], ["python", "-m", "haploop", "doctor"], True),
        (["-m"], ["python", "-m", "pytest", "haploop"], False),
        (["-m"], ["python", "-m", "haploop.console.worker"], False),
        (["/venv/bin/haploop", "serve"], [], True),
        (["my_script.py", "haploop"], [], False),
        ([""], [], False),
        ([], [], False),
    ],
)
def test_only_the_command_ends_at_once(monkeypatch, argv, orig, so):
    monkeypatch.setattr(sys, "argv", argv)
    monkeypatch.setattr(sys, "orig_argv", orig)
    assert at_once.is_the_command() is so
