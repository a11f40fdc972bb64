"""On each lab's rig, the README's words lead from a doctor to a night's recalibration.

The rigs are those that are shipped, and one with a glued accelerometer for a laser.

The verdict of the check is compared with the surface's own motion, which no pick-up saw.
"""

import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy

import haploop
from haploop.base.arrays import FloatArray
from haploop.calibration import Check, Drive
from haploop.calibration.drive.check import compare
from haploop.calibration.drive.playing import play
from haploop.instruments import Capture, Rig, load_rig_file
from tests.calibration.test_other_rigs import PICKUPS

LABS = ("usb-6211", "compactdaq-iepe", "no-ni", "voice-coil")
"""Shipped rigs that are not the paper's."""
ACCELEROMETER = f"""
base = "simulated"
name = "glued"
[vibrometer]
driver = "analog-vibrometer"
name = "glued"
source = "a test"
channel = "laser"{PICKUPS["acceleration"]}"""


@pytest.mark.rig
@pytest.mark.timeout(900)
@pytest.mark.usefixtures("few_callbacks")
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=pytest.mark.long if n in ("voice-coil", "usb-6211") else pytest.mark.night)
        for n in (*LABS, "glued", "four-channel")
    ],
)
def test_from_doctor_to_recalibration(name, mode, run, tmp_path, monkeypatch):
    if mode not in ("twin", "wire"):
        pytest.skip("the rig of the session is another")
    rig_file: str | Path = name
    if name == "glued":
        rig_file = tmp_path / "glued.toml"
        rig_file.write_text(ACCELEROMETER, encoding="utf-8")
    on = ("--rig", rig_file, "--simulate", mode)
    several = ("--patches", "A,B,C,D") if name == "four-channel" else ()
    recording, press, calibration, button = (
        tmp_path / one for one in ("P01-push.h5", "press.h5", "calibration.h5", "push.h5")
    )

    def done(*args):
        result = run(*args, ends=0)
        return result.output

    done("doctor", *on)
    done("record", "push", "-p", "P01", "-n", 2, *on, "--out", tmp_path)
    done("represent", recording, "--out", press)
    done("calibrate", *on, *several, "--out", calibration)
    assert "pass" in done(
        "button", "make", recording, "-c", calibration, *several, "-o", button, "--iterations", 0, *on
    )
    checked = tmp_path / "check.h5"
    assert "pass" in done("button", "check", button, *on, "--out", checked)
    for file in (button, checked):
        assert f"at patch {', '.join('ABCD' if several else 'A')}" in done("show", file)
    history = ("--calibrations", tmp_path / "history")
    done("calibrations", "adopt", button, "--rig", rig_file, "--reason", "first", *history)
    assert "The calibration holds" in done("recalibrate", *on, *history)

    drive = haploop.DigitalButton.load(button).drive
    with haploop.open_rig(rig_file, simulate=mode) as rig:
        result, error = played_and_true(rig, drive, 16, monkeypatch)
    assert result.passed and error < 0.2
    low, high = result.interval
    assert low - 0.03 <= error <= high + 0.03, (low, error, high)


def played_and_true(
    rig: Rig, drive: Drive, plays: int, monkeypatch: pytest.MonkeyPatch
) -> tuple[Check, float]:
    """A check, and the true error of the mean motion from 20 Hz on, whenever it began."""
    excite, seen, size = rig.excite_each, [], len(drive.target)

    def watched(drives: dict[str, FloatArray], *args: Any, **more: Any) -> Capture:
        truth = rig.simulation.truth
        record = truth.record()
        volts = drives[drive.patches[0]]
        capture = excite(drives, *args, **more)
        if len(volts) >= size and np.array_equal(volts[len(volts) - size :], drive.volts[0]):
            start = truth.began(record)
            last = rig.clock.now() - 2 / drive.rate_hz
            times = np.arange(start, min(last, start + len(volts) / drive.rate_hz + 0.3), 1 / drive.rate_hz)
            seen.append(np.gradient(truth.velocity(drive.point, times), 1 / drive.rate_hz))
        return capture

    with monkeypatch.context() as patch:
        patch.setattr(rig, "excite_each", watched)
        result = compare(drive, play(rig, drive, plays), rig)
    assert len(seen) == plays
    moved = []
    for one in seen:  # a sound card begins when its buffers do
        begin = int(np.argmax(scipy.signal.correlate(one, drive.target, mode="valid", method="fft")))
        moved.append(one[begin : begin + size])
    f = np.fft.rfftfreq(size, 1 / drive.rate_hz)
    wide = f >= 20
    off = np.fft.rfft(np.mean(moved, axis=0) - drive.target)[wide]
    return result, float(np.linalg.norm(off) / np.linalg.norm(np.fft.rfft(drive.target)))


@pytest.mark.parametrize("name", LABS)
def test_a_shipped_rig_is_short_and_says_what_it_is(name):
    text = (resources.files("haploop.rigs") / f"{name}.toml").read_text(encoding="utf-8")
    assert text.startswith("# ") and load_rig_file(name).name == name
    assert len(text.splitlines()) <= 100


def test_a_card_of_a_known_family_is_data(tmp_path, run):
    """What somebody writes for a card that haploop does not know: no code, twelve lines of data at most."""
    new = """
[daq.products."USB-6299"]
like = "USB-6211"
ai_rate_hz = 500000.0
ai_rate_single_hz = 500000.0
ai_ranges = [10.0, 5.0, 2.0, 1.0]
ao_rate_hz = 500000.0
source = "its manual"
"""
    assert len(new.strip().splitlines()) <= 12
    tomllib.loads(new)
    path = tmp_path / "lab.toml"
    path.write_text(f'base = "usb-6211"\nname = "lab"\n[daq]\ndevices = {{ Dev1 = "USB-6299" }}\n{new}')
    result = run("doctor --rig", path, "--simulate", "twin")
    assert result.exit_code == 0 and "USB-6299 (Dev1" in result.output, result.output
