"""A table calibrated for a finger, and a check under it, against the plant's own motion under the finger."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.fft import irfft, rfft, rfftfreq

from haploop.base.errors import ConfigurationError, DataError, InstrumentError
from haploop.calibration import Calibration, Check, Drive, Finger
from haploop.calibration.drive import build_button, check_under_finger, drive_for, pressed
from haploop.calibration.drive.actuation import Actuation
from haploop.calibration.drive.targets import target_grid
from haploop.calibration.model import calibrate_finger, under_finger
from haploop.instruments import Rig
from haploop.instruments.operator import RestFinger
from haploop.instruments.operator.unattended import Unattended
from tests.calibration.conftest import make_press
from tests.raising import raises, raising

pytestmark = [pytest.mark.many_plays, pytest.mark.requires("simulation"), pytest.mark.long]

BAND = np.arange(80.0, 600.0, 0.25)


def relative(found: np.ndarray, true: np.ndarray) -> float:
    return float(np.linalg.norm(found - true) / np.linalg.norm(true))


def true_response(rig: Rig, force: float | None) -> np.ndarray:
    """The plant's own response at the button, bare or under P07's finger."""
    if force:
        rig.operator.confirm(RestFinger("P07", "button", force))
        rig.clock.sleep(0.6)
    response = rig.simulation.truth.velocity_response("A", "button", BAND)
    rig.simulation.plant.lift()
    rig.clock.sleep(0.5)
    return np.asarray(response)


def finger_of(made: Calibration) -> Finger:
    assert made.finger is not None
    return made.finger


@pytest.mark.parametrize(
    ("mass", "beside", "most"), [(0.96, "", 0.015), (0.96, "21", 0.03), (0.096, "", 0.03)]
)
def test_the_response_under_a_finger_is_the_plant_s(calibrated, open, mass, beside, most):
    """At the force that was measured, and by the force law at others; the force itself wanders by 6 %."""
    rig, bare = open(pane_mass=mass), calibrated.calibration
    made = calibrate_finger(rig, bare, "P07", beside=beside or ())
    finger, without = finger_of(made), true_response(rig, None)
    assert not any(rig.simulation.plant.surface._contacts)
    changes = []
    for force, share in ((1.0, 1.0), (0.25, 2.0), (5.0, 2.5)):
        under = true_response(rig, force)
        changes.append(relative(without, under))
        assert relative(finger.factor(BAND, force) * without, under) < share * most
    assert changes[1] < changes[0] < changes[2] and changes[0] > 2 * most
    assert finger.changed == pytest.approx(changes[0], rel=0.4)
    assert finger.beside == ((beside,) if beside else ())
    f = made.response.frequencies
    inside = (f > 80) & (f < 600)
    f, fitted = f[inside], made.model.velocity(made.response.frequencies[inside])
    assert relative(fitted, bare.model.velocity(f) * finger.factor(f)) < 0.01


def test_a_fingers_file_keeps_the_bare_carrier(calibrated, open, tmp_path):
    rig, bare = open(pane_mass=0.1), calibrated.calibration
    made = calibrate_finger(rig, bare, "P07")
    made.save(tmp_path / "P07.h5")
    assert Calibration.load(tmp_path / "P07.h5").digest == made.digest != bare.digest
    assert "P07's finger" in repr(made)
    assert made.carrier_hz == bare.carrier_hz == bare.model.resonance_hz
    assert (
        target_grid([make_press()], Actuation.of([made]), "modulated").carriers[0] == bare.model.resonance_hz
    )
    harder = under_finger(bare, finger_of(made), 5.0)
    assert finger_of(harder).force == 5.0 and finger_of(harder).load.sum() > finger_of(made).load.sum()
    raises(ConfigurationError, "a finger's already", calibrate_finger, rig, made, "P07")


def under(rig: Rig, drive: Drive, monkeypatch: pytest.MonkeyPatch) -> tuple[Check, float]:
    """The check under P07's finger, and the error of the surface's own mean motion, 20 Hz to 2.5 kHz."""
    excite, seen, truth, own = rig.excite_each, [], rig.simulation.truth, drive.volts[0]

    def watched(drives: Any, *args: Any, **more: Any) -> Any:
        record = truth.record()
        capture = excite(drives, *args, **more)
        volts = drives[drive.patch]
        rest = len(volts) - len(own)
        if rest >= 0 and np.array_equal(volts[rest:], own):
            start = truth.began(record)
            seen.append(truth.velocity(drive.point, start + (rest + np.arange(len(own))) / drive.rate_hz))
        return capture

    with monkeypatch.context() as patch:
        patch.setattr(rig, "excite_each", watched)
        result = check_under_finger(rig, drive, "P07")
    f = rfftfreq(len(own), 1 / drive.rate_hz)
    moved = irfft(np.where(f >= 20, rfft(np.mean(seen, axis=0)) * 2j * np.pi * f, 0), len(own))
    assert len(seen) == result.plays
    return result, relative(moved, drive.target)


def test_the_check_s_verdict_is_of_the_motion_under_the_finger(calibrated, drive, open, monkeypatch):
    """The bare drive on a light pane fails under the finger; the one made for the finger passes."""
    rig = open(pane_mass=0.1)
    without, true = under(rig, drive, monkeypatch)
    assert not without.passed and true > 0.2
    assert "under P07's fingertip" in without.notes[0]
    low, high = without.interval
    assert low - 0.02 < true < high + 0.02
    made = calibrate_finger(rig, calibrated.calibration, "P07")
    own = drive_for(make_press(), made, rig.limits)
    found, true = under(rig, own, monkeypatch)
    assert found.passed and true < 0.15
    low, high = found.interval
    assert low - 0.02 < true < high + 0.02


def test_nobody_and_wrong_requests_are_told_and_the_finger_leaves(calibrated, drive, open, monkeypatch):
    rig, bare = open(), calibrated.calibration
    wrong = [("P07", force, "fingertip rests with") for force in (0.0, 30.0)]
    wrong += [(who, 1.0, "not a valid participant pseudonym") for who in ("", "Jane Doe", "../../etc")]
    for who, force, says in wrong:
        raises(ConfigurationError, says, calibrate_finger, rig, bare, who, force=force)
        raises(ConfigurationError, says, check_under_finger, rig, drive, who, force=force)
    with monkeypatch.context() as nobody:
        nobody.setattr(rig.operator, "confirm", lambda _request: pytest.fail("somebody was asked"))
        for given, plays, says in ((drive, 2, "3 plays"), (replace(drive, rig="x"), 8, "of the rig 'x'")):
            raises(ConfigurationError, says, check_under_finger, rig, given, "P07", plays=plays)
    with monkeypatch.context() as failing, pytest.raises(InstrumentError, match="it broke"):
        failing.setattr(pressed, "check", raising(InstrumentError("it broke")))
        check_under_finger(rig, drive, "P07")
    rig.clock.sleep(1.0)
    rig.simulation.truth.velocity_response("A", "button", BAND)
    assert not any(rig.simulation.plant.surface._contacts)
    drifted = open(mode_drift=0.01)
    raises(DataError, "unexplained", calibrate_finger, drifted, bare, "P07")
    rig.adopt("operator", Unattended())
    for asked in (lambda: calibrate_finger(rig, bare, "P07"), lambda: check_under_finger(rig, drive, "P07")):
        raises(InstrumentError, "Nobody rests a finger", asked)


def test_a_button_is_not_learned_from_a_finger_s_calibration(calibrated, open):
    rig = open()
    made = calibrate_finger(rig, calibrated.calibration, "P07")
    raises(ConfigurationError, "checked on the bare table", build_button, rig, make_press(), made)
