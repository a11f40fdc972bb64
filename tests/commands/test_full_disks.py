"""A disk that cannot take a result is found before the patch is driven; room that is held stays held."""

import errno
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haploop.calibration import DigitalButton, sizes
from haploop.mocks.daq.card_twin import Terminal
from tests.acquisition.recording.test_disks import disk
from tests.command_line import Demo, Run

Plays = list[Callable[[], None]]
Commands = Callable[[Path], dict[str, tuple[object, ...]]]


@pytest.fixture
def plays(monkeypatch: pytest.MonkeyPatch) -> Plays:
    """What happens before each voltage on an output."""
    each: Plays = []
    real = Terminal.play

    def played(self: Terminal, run: Any) -> None:
        for act in each if np.any(run.values) else ():
            act()
        real(self, run)

    monkeypatch.setattr(Terminal, "play", played)
    return each


@pytest.fixture(scope="module")
def button(made: Path) -> Path:
    return made / "latch.h5"


@pytest.fixture
def commands(demo: Demo, button: Path) -> Callable[[Path], dict[str, tuple[object, ...]]]:
    """Every command that measures, with its result in a folder."""
    press, table = demo.folder / "presses" / "latch.h5", demo.folder / "calibration.h5"

    def into(folder: Path) -> dict[str, tuple[object, ...]]:
        return {
            "calibrate": ("calibrate", "-o", folder / "table.h5"),
            "map": ("map", "-o", folder / "map", "--points", "3,17"),
            "check": ("check", press, "-c", table, "-o", folder / "check"),
            "make": ("button", "make", press, "-c", table, "-o", folder / "new.h5", "--iterations", 0),
            "button check": ("button", "check", button, "-o", folder / "check.h5"),
            "recalibrate": ("recalibrate", "--calibrations", folder / "history"),
        }

    return into


EVERY = ("calibrate", "map", "check", "make", "button check", "recalibrate")


@pytest.fixture(params=EVERY)
def command(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def history_in(folder: Path, run: Run, button: Path) -> None:
    run("calibrations adopt", button, "--reason", "x", "--calibrations", folder / "history", ends=0)


def filled(folder: Path, left: int) -> Path:
    """Fill a disk but for `left` bytes."""
    filler = folder / "filler"
    with filler.open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, shutil.disk_usage(folder).free - left)
    return filler


@pytest.mark.parametrize("left", [0, 200_000])
def test_a_full_disk_is_found_before_a_voltage_is_put_out(
    tmp_path, run, plays, commands, command, left, button
):
    plays.append(lambda: pytest.fail("something was played"))
    with disk(tmp_path / "small", "size=40m") as small:
        arguments = commands(small)[command]
        if command == "recalibrate":
            history_in(small, run, button)
        filled(small, left)
        there = sorted(small.rglob("*"))
        result = run(*arguments, ends=2)
        assert "No space left on device" in " ".join(result.output.split())
        if command != "map":  # its folder and its plan may be there: the same command goes on with them
            assert [p for p in sorted(small.rglob("*")) if p.is_file()] == [p for p in there if p.is_file()]
        plays.clear()
        (small / "filler").unlink()
        if command != "recalibrate" and left == 0:
            run("button check", button, "-o", small / "again.h5", ends=0)


def test_a_name_that_is_too_long_is_found_before_a_voltage_is_put_out(tmp_path, run, plays):
    """The calibration's own name would fit; that of its waveforms does not. The patch was driven 15 times."""
    plays.append(lambda: pytest.fail("something was played"))
    result = run("calibrate --out", tmp_path / ("c" * 220 + ".h5"), ends=2)
    assert "characters, which is too long a name for a file" in " ".join(result.output.split())
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_may_only_be_read_is_found_before_a_voltage_is_put_out(
    tmp_path, run, plays, commands, command, button
):
    plays.append(lambda: pytest.fail("something was played"))
    with disk(tmp_path / "kept", "size=40m") as kept:
        arguments = commands(kept)[command]
        if command == "recalibrate":
            history_in(kept, run, button)
        subprocess.run(["mount", "-o", "remount,ro", str(kept)], check=True)
        result = run(*arguments, ends=2)
        assert "read-only file system" in " ".join(result.output.lower().split())


@pytest.mark.long
def test_a_disk_that_others_fill_meanwhile_takes_the_result(tmp_path, run, plays, commands, command, button):
    with disk(tmp_path / "small", "size=120m") as small:
        arguments = commands(small)[command]
        if command == "recalibrate":
            history_in(small, run, button)
        fill: Iterator[Path] = (filled(small, 0) for _ in range(1))
        plays.append(lambda: next(fill, None) and None)
        result = run(*arguments)
        assert (small / "filler").exists()
        assert result.exit_code == 0, result.output
        assert not list(small.rglob(".*"))


@pytest.mark.long
def test_a_disk_that_takes_the_calibration_only_keeps_neither(tmp_path, run, monkeypatch):
    def full(_self, _path):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr("haploop.calibration.response.response.hdf5.flatten", full)
        run("calibrate -o", tmp_path / "table.h5")
    assert list(tmp_path.iterdir()) == []
    run("calibrate -o", tmp_path / "table.h5", ends=0)


def test_results_need_half_the_room_that_is_held_or_less(demo, button, tmp_path):
    made = DigitalButton.load(button)
    made.check.save(tmp_path / "check.h5")
    assert (demo.folder / "calibration.h5").stat().st_size < sizes.CALIBRATION / 2
    assert (tmp_path / "check.h5").stat().st_size < (sizes.CHECK + 8 * sizes.PLAY) / 2
    assert button.stat().st_size < (sizes.BUTTON + sizes.STEP) / 2
