"""Whatever ends a command, and whenever: no patch has voltage, the files are whole, and the next run starts.

The commands run in this process on twins, and a timer interrupts them at a random moment with an
exception from nowhere, one Ctrl-C, many, SIGTERM or a closed terminal. Its time is the process's own,
so that moments spread alike over a command on a busy machine. What the patches have is read at the
plant. (Kill -9, servers that die and lines that are pulled: test_cut_off.py.)
"""

import random
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import pytest

from haploop.acquisition import recover, verify
from haploop.base import signals
from haploop.calibration.recalibration.history import History
from haploop.commands.cli import cli
from haploop.mocks.plant import Plant
from haploop.mocks.simulation import Simulation
from haploop.terminal.exits import Commands

pytestmark = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs POSIX timers")

WAYS = ("exception", "ctrl-c", "ctrl-c again and again", "SIGTERM", "closed terminal")
SIGNALS = {
    "ctrl-c": signal.SIGINT,
    "SIGTERM": signal.SIGTERM,
    "closed terminal": getattr(signal, "SIGHUP", None),
}


class InjectedError(Exception):
    """What no code expects."""


@dataclass
class Ready:
    """What the commands work on, made once."""

    recording: Path
    calibration: Path
    calibrations: Path
    """A folder with one generation, active; with --full only."""
    drifted: Path
    """A rig file of the same table, some time later."""
    seconds: dict[str, float]
    """Of the processor, that each command takes when nobody interrupts it."""


@pytest.fixture(scope="module")
def plants() -> Iterator[list[Plant]]:
    """Every plant that a command opens, in order."""
    seen: list[Plant] = []
    original = Simulation.__init__

    def noted(self: Simulation, *args: object, **more: object) -> None:
        original(self, *args, **more)
        seen.append(self.plant)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Simulation, "__init__", noted)
        yield seen


def commands(ready: Ready, out: Path) -> dict[str, list[object]]:
    return {
        "record": ["record", "latch", "-p", "P01", "-n", 3, "--out", out],
        "calibrate": ["calibrate", "--out", out / "calibration.h5"],
        "check": ["check", ready.recording, "-c", ready.calibration, "--out", out],
        "demo": ["demo", "--out", out / "demo"],
        "recalibrate": ["recalibrate", "--rig", ready.drifted, "--calibrations", out / "calibrations"],
    }


def run(args: list[object]) -> int:
    with pytest.raises((SystemExit, KeyboardInterrupt)) as ended:
        cli.main([str(arg) for arg in args])
    return int(ended.value.code or 0) if isinstance(ended.value, SystemExit) else 130


@pytest.fixture(scope="module")
def ready(tmp_path_factory: pytest.TempPathFactory, full: bool) -> Ready:
    """Each command once, uninterrupted: everything is imported, and the time that each takes known."""
    folder, again = tmp_path_factory.mktemp("ready"), tmp_path_factory.mktemp("again")
    drifted = again / "drifted.toml"
    drifted.write_text("[simulation]\nmode_drift = 0.03\n", encoding="utf-8")
    ready = Ready(folder / "P01-latch.h5", folder / "calibration.h5", folder / "calibrations", drifted, {})
    for name, args in commands(ready, folder).items():
        if name in ("demo", "recalibrate") and not full:
            continue
        if name == "recalibrate":
            made = folder / "latch-button.h5"
            run(["button", "make", ready.recording, "-c", ready.calibration, "--iterations", 0, "-o", made])
            adopt = ["calibrations", "adopt", made, "--reason", "it begins"]
            assert run([*adopt, "--calibrations", ready.calibrations]) == 0
            shutil.copytree(ready.calibrations, again / "calibrations")
            args = commands(ready, again)[name]  # noqa: PLW2901
        began = time.process_time()
        assert run(args) == 0
        ready.seconds[name] = time.process_time() - began
    return ready


def interrupted(way: str, after: float, args: list[object]) -> int:
    """Run a command and interrupt it after some seconds."""

    def again(_number: int, frame: FrameType | None) -> None:
        while frame is not None:
            if frame.f_code is Commands.main.__code__:
                signal.raise_signal(signal.SIGINT)
                return
            frame = frame.f_back

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        if way == "exception":
            raise InjectedError
        if way == "ctrl-c again and again":
            # Every 2 ms from now on: in the clean-up too, until the command has ended.
            signal.signal(signal.SIGPROF, again)
            signal.setitimer(signal.ITIMER_PROF, 0.002, 0.002)
            signal.raise_signal(signal.SIGINT)
        else:
            signal.raise_signal(SIGNALS[way])

    before = signal.signal(signal.SIGPROF, interrupt)
    # A signal that arrives while Python clears something away is reported, not raised: it is not looked at.
    reported, sys.unraisablehook = sys.unraisablehook, lambda _: None
    signal.setitimer(signal.ITIMER_PROF, after)
    try:
        return run(args)
    finally:
        signal.signal(signal.SIGPROF, signal.SIG_IGN)
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
        sys.unraisablehook = reported


def assert_safe(plant: Plant) -> None:
    assert plant.truth.closed == frozenset(), "the relay is open"
    for patch, volts in plant.truth.patch_voltages.items():
        assert abs(volts) < 1e-3, f"patch {patch} has no voltage"
    assert not any(plant._inputs.values()), "the outputs are at zero too"


def assert_whole(out: Path) -> None:
    """Every file under its own name can be read, or recovered; and one calibration is active, and whole."""
    if (out / "calibrations").exists():
        history = History(out / "calibrations")
        history.active().verify()
        for generation in history.generations:
            generation.verify()
        return
    for path in out.rglob("*.h5"):
        if any("haploop recover" in problem for problem in verify(path)):
            recover(path)
        else:
            assert not verify(path)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Every way by every command, with --full."""
    if "number" in metafunc.fixturenames:
        metafunc.parametrize("number", range(300 if metafunc.config.getoption("--full") else 6))


@pytest.fixture(scope="module")
def codes() -> list[int]:
    """How each interrupted command ended."""
    return []


def test_no_way_out_leaves_voltage(number, ready, plants, codes, tmp_path, mode):
    if mode != "twin":
        pytest.skip("its commands run on twins")
    r, names = random.Random(number), list(ready.seconds)
    name, way = names[number % len(names)], WAYS[(number + number // len(WAYS)) % len(WAYS)]
    if name == "recalibrate":
        shutil.copytree(ready.calibrations, tmp_path / "calibrations")
    before = len(plants)
    after = r.uniform(0.0, 0.9) * ready.seconds[name]
    code = interrupted(way, after, commands(ready, tmp_path)[name])
    codes.append(code)
    # An exception within the way out is said, because nobody knows what it kept from being done.
    said = (3,) if way == "exception" else ()
    assert code in (0, 70, 129, 130, 143, *said), (name, way, after)
    assert not signals._held, "what asks the program to stop is heard again"
    for plant in plants[before:]:
        assert_safe(plant)
    plants.clear()
    assert_whole(tmp_path)


def test_many_were_interrupted(codes):
    assert sum(code != 0 for code in codes) >= len(codes) / 3
    print(len(codes), {code: codes.count(code) for code in sorted(set(codes))}, file=sys.stderr)


def test_the_next_run_starts_without_repair(ready, tmp_path, mode):
    if mode != "twin":
        pytest.skip("its commands run on twins")
    assert interrupted("ctrl-c", 0.3 * ready.seconds["record"], commands(ready, tmp_path)["record"]) in (
        0,
        130,
    )
    assert run(["record", "latch", "-p", "P02", "-n", 2, "--out", tmp_path]) == 0
