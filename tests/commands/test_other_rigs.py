"""The README's commands on a rig with a coil and no relay, and on one with an accelerometer for a laser."""

from __future__ import annotations

from pathlib import Path

import pytest

from haploop.commands.cli import cli
from tests.calibration.test_other_rigs import PICKUPS


def run(*args: object) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main([str(arg) for arg in args])
    return int(ended.value.code or 0)


def written(name: str, folder: Path) -> Path:
    path = folder / f"{name}.toml"
    if name == "coil":
        path.write_text('base = "voice-coil"\nname = "coil"\n', encoding="utf-8")
        return path
    head = f'driver = "analog-vibrometer"\nname = "{name}"\nsource = "a test"\nchannel = "laser"'
    text = f'base = "simulated"\nname = "{name}"\n[vibrometer]\n{head}{PICKUPS[name]}'
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", ["coil", "acceleration"])
def test_from_doctor_to_recalibrate(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rig = ("--rig", written(name, tmp_path))
    assert run("doctor", *rig) == 0
    assert run("record", "latch", "-p", "P01", "-n", 3, "--out", "data", *rig) == 0
    assert run("represent", "data/P01-latch.h5", "--out", "press.h5") == 0
    assert run("calibrate", "--out", "c.h5", *rig) == 0
    assert run("button", "make", "data/P01-latch.h5", "-c", "c.h5", "-o", "latch.h5", *rig) == 0
    assert run("check", "data/P01-latch.h5", "-c", "c.h5", *rig) == 0
    kept = ("--calibrations", "kept")
    assert run("calibrations", "adopt", "latch.h5", "--reason", "the first", *kept, *rig) == 0
    assert run("recalibrate", *kept, *rig) == 0


@pytest.mark.parametrize("name", ["coil", "acceleration"])
def test_the_same_rig_through_its_wires(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rig = ("--rig", written(name, tmp_path), "--simulate", "wire")
    assert run("doctor", *rig) == 0
    assert run("record", "latch", "-p", "P01", "-n", 2, "--out", "data", *rig) == 0
