"""Rigs with other sensors than the paper's: presses, activations and representative presses beside the truth.

Each rig is the paper's with other sensors, on a table and a participant that a hash chooses.
"""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import scipy

import haploop
from haploop.acquisition import find_presses, high_pass
from haploop.base.errors import ConfigurationError, DataError

RIG = """
base = "haptable"
name = "other-sensors"
[daq.channels]
one_force = {{ terminal = "Dev1/ai6", range = 10, config = "diff" }}
one_acceleration = {{ terminal = "Dev2/ai6", range = 5, config = "rse" }}
travel = {{ terminal = "Dev2/ai7", range = 10, config = "rse" }}
[simulation]
seed = {seed}
[sensors]
{sensors}
"""
LOAD_CELL = '[sensors.force]\nchannels = ["one_force"]\nscale = 10\n'
CHARGE = (
    '[sensors.force]\nchannels = ["one_force"]\nsensitivity = "4 pC/N"\namplifier = "20 mV/pC"\n'
    "high_pass_hz = 0.1\n"
)
MEMS = (
    '[sensors.acceleration]\nchannels = ["one_acceleration"]\nsensitivity = "300 mV/g"\nlow_pass_hz = 500\n'
)
IEPE = (
    '[sensors.acceleration]\nchannels = ["one_acceleration"]\nsensitivity = "100 mV/g"\nhigh_pass_hz = 0.5\n'
    "low_pass_hz = 2000\n"
)
VIBROMETER = '[sensors.velocity]\nchannels = ["travel"]\nscale = "100 mm/s/V"\n'
LASER = '[sensors.displacement]\nchannels = ["travel"]\nscale = 1e-3\n'

KINDS = {
    "one axis each, and a switch": LOAD_CELL + MEMS,
    "charge and IEPE, no switch": "activation = false\n" + CHARGE + IEPE,
    "force over travel": "acceleration = false\nactivation = false\n" + LOAD_CELL + LASER,
    "acceleration alone": "force = false\nactivation = false\n" + IEPE,
    "travel and a switch": "force = false\nacceleration = false\n" + LASER,
    "velocity alone": "force = false\nacceleration = false\nactivation = false\n" + VIBROMETER,
}
TOLD_BY = {
    "one axis each, and a switch": ("acceleration", "activation", 1.5e-3),
    "charge and IEPE, no switch": ("acceleration", "force", 4e-3),
    "force over travel": ("displacement", "force", 8e-3),
    "acceleration alone": ("acceleration", "acceleration", 4e-3),
    "travel and a switch": ("displacement", "activation", 1.5e-3),
    "velocity alone": ("velocity", "velocity", 4e-3),
}
"""What the motion of the representative press is from, what tells an activation, and how near (s) it lies."""


def written(folder: Path, kind: str, button: str = "") -> Path:
    seed = int(hashlib.sha256(f"{kind} {button}".encode()).hexdigest(), 16) % 100_000
    path = folder / "rig.toml"
    path.write_text(RIG.format(seed=seed, sensors=KINDS[kind]), encoding="utf-8")
    return path


def assert_timed(recording: haploop.Recording, truth, presses: int, kind: str) -> None:
    _, told_by, near = TOLD_BY[kind]
    found = find_presses(recording)
    assert len(found) == len(truth) == presses
    for press, true in zip(found, truth, strict=True):
        assert press.activation is not None and press.activated_by == told_by
        assert abs(press.activation / recording.rate_hz - true.activation_time) < near


@pytest.mark.parametrize(("kind", "button"), [
    pytest.param(kind, button, marks=[pytest.mark.long] * (row % 3 != column))
    for row, kind in enumerate(KINDS)
    for column, button in enumerate(("latch", "toggle", "push"))
])  # fmt: skip
def test_presses_are_found_timed_and_represented(tmp_path, kind, button):
    motion, told_by, _ = TOLD_BY[kind]
    with haploop.open_rig(written(tmp_path, kind, button), simulate="twin") as rig:
        recording = haploop.record(rig, button, "P01", 4, tmp_path / "recordings")
        truth = rig.simulation.truth.presses
    assert_timed(recording, truth, 4, kind)
    assert len(recording.accepted) == 4
    press = haploop.representative([recording])
    assert (press.motion, press.activated_by) == (motion, told_by)
    assert (press.force is None) == (not recording.has("force"))
    assert (press.travel is None) == (not recording.has("displacement"))
    assert agreement(press, truth) > (0.5 if motion == "displacement" else 0.9)  # a travel has its noise


@pytest.mark.long
@pytest.mark.parametrize("kind", ["one axis each, and a switch", "acceleration alone"])
def test_the_drivers_record_them_too(tmp_path, kind):
    with haploop.open_rig(written(tmp_path, kind), simulate="wire") as rig:
        recording = haploop.record(rig, "push", "P01", 2, tmp_path / "recordings")
        truth = rig.simulation.truth.presses
    assert_timed(recording, truth, 2, kind)


def agreement(press: haploop.Representative, truth) -> float:
    """Correlation with the mean of the true motions about their activations, in the band of a click."""
    rate_hz = press.rate_hz
    times = np.arange(-round(0.06 * rate_hz), round(0.12 * rate_hz)) / rate_hz
    true = np.mean([one.acceleration(one.activation_time + times) for one in truth], axis=0)
    at = press.activation_index + np.arange(-round(0.09 * rate_hz), round(0.15 * rate_hz))
    own = press.acceleration[at[(at >= 0) & (at < len(press.acceleration))]]
    band = scipy.signal.butter(2, (60.0, 400.0), "bandpass", fs=rate_hz, output="sos")
    a, b = scipy.signal.sosfiltfilt(band, own), scipy.signal.sosfiltfilt(band, high_pass(true, rate_hz))
    found = scipy.signal.correlate(a, b, "valid") / np.linalg.norm(b)
    sizes = np.sqrt(scipy.signal.correlate(a**2, np.ones(len(b)), "valid"))
    return float((found / sizes).max())


@pytest.mark.long
@pytest.mark.parametrize(
    "kind", [pytest.param("charge and IEPE, no switch", marks=pytest.mark.long), "travel and a switch"]
)
def test_what_is_missing_takes_its_figures_away_and_nothing_else(tmp_path, kind, run):
    rig = written(tmp_path, kind)
    out = tmp_path / "recordings"
    words = f"record push -p P01 -n 2 --rig {rig} --simulate twin -o {out}"
    assert run(*words.split()).exit_code == 0
    recording, press = out / "P01-push.h5", tmp_path / "press.h5"
    assert run("represent", recording, "-o", press).exit_code == 0
    motion, told_by, _ = TOLD_BY[kind]
    values = json.loads(run("show", press, "--json").stdout)
    assert (values["motion"], values["activated_by"]) == (motion, told_by)
    for file in (recording, press):
        shown = run("show", file, "--plot", tmp_path / f"{file.stem}.png")
        assert shown.exit_code == 0, shown.output
        csv = tmp_path / f"{file.stem}.csv"
        assert run("export", file, "--to", "csv", "--out", csv).exit_code == 0
        assert ("force" in csv.read_text(encoding="utf-8").split("\n\n")[0]) == (kind[0] == "c")
    report = run("report", recording, press, "--out", tmp_path / "report.html")
    assert report.exit_code == 0, report.output
    assert run("list", "--in", out).exit_code == 0


def test_force_alone_shows_presses_and_makes_no_digital_one(tmp_path):
    path = tmp_path / "rig.toml"
    sensors = "acceleration = false\nactivation = false\n" + LOAD_CELL
    path.write_text(RIG.format(seed=8, sensors=sensors), encoding="utf-8")
    with haploop.open_rig(path, simulate="twin") as rig:
        recording = haploop.record(rig, "latch", "P01", 2, tmp_path)
    assert len(find_presses(recording)) == 2
    with pytest.raises((DataError, ConfigurationError), match="acceleration"):
        haploop.representative([recording])
