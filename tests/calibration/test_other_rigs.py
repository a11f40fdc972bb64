"""A coil without a relay, another laser, a glued accelerometer: each beside the surface's own motion."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haploop.base.errors import InstrumentError
from haploop.calibration import Multisine, calibrate, drive_for, quick_response
from haploop.calibration.band import BAND
from haploop.calibration.self_test import examine
from haploop.instruments import Rig, load_rig_file, open_rig
from haploop.mocks.plant.table import FEWEST_HZ, make_plate
from tests.calibration.conftest import make_press
from tests.calibration.drive.test_truth import played_and_true

pytestmark = pytest.mark.requires("simulation")

PICKUPS = {
    "displacement": """
quantity = "displacement"
scale = 5e-6
range = 2e-5
bandwidth_hz = 2500
delay = 1e-4
""",
    "acceleration": """
quantity = "acceleration"
scale = 98.0665
range = 490
bandwidth_hz = 10000
high_pass_hz = 0.5
delay = 2e-5
mass = 0.002
""",
}


@contextmanager
def rig_of(name: str, folder: Path, mode: Any = "twin", **simulation: Any) -> Iterator[Rig]:
    """The shipped rig with a coil, or the simulated one with another pick-up."""
    path = folder / f"{name}.toml"
    if name == "coil":
        path.write_text('base = "voice-coil"\n', encoding="utf-8")
    else:
        head = f'driver = "analog-vibrometer"\nname = "{name}"\nsource = "a test"\nchannel = "laser"'
        text = f'base = "simulated"\nname = "{name}"\n[vibrometer]\n{head}{PICKUPS[name]}'
        path.write_text(text, encoding="utf-8")
    with open_rig(path, simulate=mode, simulation=simulation) as rig:
        yield rig


def difference(found: np.ndarray, true: np.ndarray) -> float:
    return float(np.linalg.norm(found - true) / np.linalg.norm(true))


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "within"), [("coil", 0.002), ("displacement", 0.002), ("acceleration", 0.003)]
)
def test_the_response_is_the_surfaces_own_velocity(name, within, tmp_path):
    with rig_of(name, tmp_path, hysteresis=0.0) as rig:
        calibration = calibrate(rig)
        response = calibration.response
        resonance = rig.simulation.truth.resonance_hz
        truth = rig.simulation.truth.velocity_response("A", "button", response.frequencies)
    assert difference(response.velocity, truth) < within
    if BAND[0] < resonance < BAND[1]:  # a carrier lies in the band of drives; the coil's strongest does not
        assert calibration.model.resonance_hz == pytest.approx(resonance, abs=0.05)
    assert response.pickup == ("velocity" if name == "coil" else name)


@pytest.mark.long
@pytest.mark.many_plays
@pytest.mark.parametrize("name", ["coil", *(pytest.param(n, marks=pytest.mark.long) for n in PICKUPS)])
def test_the_verdict_is_right_of_a_drive(name, tmp_path, monkeypatch):
    # Twice differentiated, a displacement's noise up to the corner would leave nothing to be told: see below.
    still = {"highest_hz": FEWEST_HZ} if name == "displacement" else {}
    with rig_of(name, tmp_path, **still) as rig:
        drive = drive_for(make_press(), calibrate(rig), rig.limits)
        result, error, _ = played_and_true(rig, drive, 12, monkeypatch)
        low, high = result.interval
        assert low - 0.005 <= error <= high + 0.005
        if name == "displacement":
            assert result.above.bound is not None
            assert 1200 < result.judged_hz < 1400 and 0 < result.above.bound < 0.02
        assert result.verdict == "pass" and error < 0.05
        plays = 16 if name == "displacement" else 6
        result, error, _ = played_and_true(rig, replace(drive, volts=0.7 * drive.volts), plays, monkeypatch)
        low, high = result.interval
        assert result.verdict == "fail" and error > 0.2
        assert low - 0.03 <= error <= high + 0.03


@pytest.mark.long
def test_modes_that_noise_hides_are_bounded(tmp_path, monkeypatch):
    with rig_of("displacement", tmp_path) as rig:
        drive = drive_for(make_press(), calibrate(rig), rig.limits)
        result, error, outside = played_and_true(rig, drive, 12, monkeypatch)
    print(f"true {error:.3f}, outside {outside:.3f}; bound {result.above.bound}; {result}")
    assert result.verdict == "not shown" and error < 0.15
    # Of noise alone it was 0.64; what is left is what no play of this sensor tells of the distortion.
    assert result.above.bound is not None and outside < result.above.bound < 0.5


@pytest.mark.long
@pytest.mark.parametrize(("hz", "push"), [(1800.0, 0.06), (2300.0, 0.15), (3400.0, 0.3), (7000.0, 0.6)])
def test_a_hidden_mode(hz, push, tmp_path, monkeypatch):
    """Above the judged band, within the sensor's or beyond it: the calibration saw what the plays do not."""
    plate = make_plate(np.random.default_rng(1), highest_hz=FEWEST_HZ)
    ringing = {
        "plant": "modal",
        "natural_hz": [*plate.natural_hz, hz],
        "damping": [*plate.damping, 0.005],
        "coupling": {patch: [*forces, push] for patch, forces in plate.coupling.items()},
        "shapes": {"button": [*plate.shape((0.27, 0.3)), 1.0]},
    }
    with rig_of("displacement", tmp_path, **ringing) as rig:
        drive = drive_for(make_press(), calibrate(rig), rig.limits)
        result, error, outside = played_and_true(rig, drive, 12, monkeypatch)
    print(f"true {error:.3f}, outside {outside:.3f}; bound {result.above.bound}; {result}")
    assert error > 0.2 and result.verdict != "pass"
    assert result.judged_hz < hz and (result.above.bound or 0.0) > outside


@pytest.mark.long
@pytest.mark.parametrize("name", ["coil", "displacement", "acceleration"])
def test_each_is_measured_through_its_wire(name, tmp_path):
    with rig_of(name, tmp_path, "wire", hysteresis=0.0) as rig:
        response = quick_response(rig)
        truth = rig.simulation.truth.velocity_response("A", "button", response.frequencies)
        assert difference(response.velocity, truth) < 0.01


def test_a_glued_accelerometer_lowers_the_resonance_by_its_mass(tmp_path):
    """2 g at the button, on modes of 240 g: by half of its share, where the mode has its antinode."""
    with rig_of("acceleration", tmp_path) as rig, open_rig("simulated") as free:
        loaded, unloaded = (one.simulation.truth for one in (rig, free))
        place = loaded._scene.place("button")
        shape = unloaded.surface.modes(0.0).shape(place)[unloaded.surface.modes(0.0).main]
        expected = unloaded.resonance_hz / np.sqrt(1 + 0.002 / 0.24 * shape**2)
        assert loaded.resonance_hz == pytest.approx(expected, rel=1e-9)
        assert loaded.resonance_hz < unloaded.resonance_hz - 0.5


@pytest.mark.long
def test_a_drive_stays_within_the_range_of_what_is_shown(tmp_path):
    """The displacement that a drive makes is within the share of the range that a drive may use."""
    with rig_of("displacement", tmp_path) as rig:
        calibration = calibrate(rig, excitation=Multisine())
        drive = drive_for(make_press(), calibration, rig.limits)
        assert "V at the patch" in drive.unreached
        small = replace(calibration, response=replace(calibration.response, pickup_range=1e-7))
        tight = drive_for(make_press(), small, rig.limits)
        assert "of the vibrometer's 0.1 µm" in tight.unreached and tight.peak < drive.peak / 2
        capture = rig.excite_each(tight.by_patch, ("laser",))
        assert 0.05e-6 < np.abs(rig.vibrometer.to_si(capture.volts[0])).max() < 0.1e-6


def test_a_pickup_at_the_end_of_its_range_is_told_in_its_unit(tmp_path):
    path = tmp_path / "small.toml"
    text = PICKUPS["displacement"].replace("2e-5", "2e-7").replace("5e-6", "5e-8")
    head = 'driver = "analog-vibrometer"\nname = "x"\nsource = "a test"\nchannel = "laser"'
    path.write_text(f'base = "simulated"\n[vibrometer]\n{head}{text}', encoding="utf-8")
    with open_rig(path) as rig, pytest.raises(InstrumentError, match=r"left its range of 0.2 µm: choose"):
        quick_response(rig)


@pytest.mark.long
def test_a_coil_is_planned_within_its_heat(tmp_path):
    """With a tenth of the power, calibration and check lower their levels, and nothing is refused."""
    file = load_rig_file("voice-coil")
    actuator = file.actuator.model_copy(update={"watts": 0.004})
    with open_rig(file.model_copy(update={"actuator": actuator})) as rig:
        calibration = calibrate(rig, excitation=Multisine())
        drive = drive_for(make_press(), calibration, rig.limits)
        assert drive.peak < 1.0 and calibration.response.level < 0.5
        rig.excite_each(drive.by_patch, ("laser",))


def test_doctor_says_that_a_glued_accelerometer_loads_the_table(tmp_path):
    with rig_of("acceleration", tmp_path) as rig:
        findings = examine(rig)
    (shown,) = [f for f in findings if f.name == "Mass"]
    assert shown.status == "yellow" and "adds 2 g to the table where it is glued" in shown.sentence
    assert not [f for f in findings if f.status == "red"]
