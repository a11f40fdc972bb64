"""Drives by the force of the finger, and who is told when nobody rests one."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError, DataError, InstrumentError
from haploop.calibration import Calibration, Check, DigitalButton, Drive
from haploop.calibration.drive import (
    PressedDrives,
    build_button,
    button_under_finger,
    check_under_finger,
    drive_for,
    play_button,
    pressed,
    pressed_drives,
)
from haploop.calibration.model import at_force, calibrate_finger
from haploop.instruments import Rig, load_rig_file
from haploop.instruments.operator import LiftFinger, RestFinger
from haploop.reports.contents.check import button_contents
from tests.calibration.conftest import Calibrated, make_press
from tests.conftest import OpenRig
from tests.raising import raises

DRIVE = Drive(
    button="push", patches=("A",), point="button", rate_hz=20_000.0, volts=np.ones((1, 9)), target=np.ones(9),
    scale=0.1, method="modulated", carrier_hz=264.0, band=(75.0, 600.0), in_band=0.9, known=(15.0, 625.0),
    predicted_error=0.02, unreached="", rig="simulated", simulated=True, sources=(), calibration="",
)  # fmt: skip

pytestmark = [pytest.mark.many_plays, pytest.mark.requires("simulation"), pytest.mark.long]


@pytest.fixture
def weighed(tmp_path: Path) -> str:
    """The simulated rig, with its force sensor under the table."""
    path = tmp_path / "weighed.toml"
    path.write_text('base = "simulated"\n[table]\nforce = true\n')
    return str(path)


@pytest.fixture
def finger(calibrated: Calibrated, open: OpenRig) -> Calibration:
    return calibrate_finger(open(pane_mass=0.2), calibrated.calibration, "P07")


def pressing(rig: Rig, monkeypatch: pytest.MonkeyPatch, force: float | None) -> None:
    """The person rests with another force than the one asked for; None: nobody comes."""
    confirm = rig.operator.confirm

    def answered(request: Any) -> bool:
        if not isinstance(request, RestFinger):
            return confirm(request)
        return True if force is None else confirm(replace(request, force=force))

    monkeypatch.setattr(rig.operator, "confirm", answered)


def of_rig(check: Check, name: str) -> Check:
    return replace(check, drive=replace(check.drive, rig=name))


def test_the_drive_is_that_of_the_force_which_the_sensor_reads(finger, weighed, open, monkeypatch):
    """A finger that presses with 4 N instead of 1 N gets the firm drive, which has less error there."""
    rig = open(weighed, pane_mass=0.2)
    made = pressed_drives(make_press(), finger, rig.limits)
    assert made.forces == pytest.approx((0.4, 1.0, 3.0)) and made.nominal == 1.0
    assert np.ptp([one.scale for one in made.drives]) < 0.011 * made.drives[1].scale
    pressing(rig, monkeypatch, 4.0)
    firm = check_under_finger(rig, made, "P07", plays=3)
    nominal = check_under_finger(rig, made.drives[1], "P07", plays=3)
    assert firm.drive is made.drives[2] and firm.error < 0.6 * nominal.error
    assert firm.notes[1].startswith("The force sensor read ") and "the drive for 3 N" in firm.notes[1]
    for force, number in ((0.05, 0), (0.3, 0), (1.2, 1), (2.2, 2), (19.0, 2), (-1.0, 0), (None, 1)):
        assert made.number(force) == number


@pytest.mark.night
def test_without_a_force_sensor_the_nominal_is_played(finger, open):
    rig = open(pane_mass=0.2)
    made = pressed_drives(make_press(), finger, rig.limits)
    result = check_under_finger(rig, made, "P08", force=4.0, plays=3)
    told = check_under_finger(rig, made.drives[1], "P08", plays=3, made_for=finger.finger).notes
    assert told[1] == "The drive was made for P07's finger at 1 N."
    assert result.drive is made.drives[1]
    assert result.notes[1].startswith("No force sensor carries the table") and "nominal" in result.notes[1]
    assert result.notes[2] == "The drive was made for P07's finger."


def test_a_finger_s_calibration_states_the_force_that_the_sensor_read(calibrated, weighed, open, monkeypatch):
    rig = open(weighed, pane_mass=0.3)
    pressing(rig, monkeypatch, 3.0)
    made = calibrate_finger(rig, calibrated.calibration, "P07")
    assert made.finger is not None and made.finger.force == pytest.approx(3.0, rel=0.15)
    lighter = at_force(made, 1.0)
    assert lighter.finger is not None and lighter.finger.changed == made.finger.changed
    f = made.response.frequencies
    back = at_force(lighter, made.finger.force).response.velocity
    assert np.allclose(back, made.response.velocity, rtol=1e-9)
    assert np.allclose(
        lighter.response.velocity,
        calibrated.calibration.response.velocity * made.finger.factor(f, 1.0),
        rtol=1e-9,
    )
    raises(DataError, "of no force", at_force, calibrated.calibration, 1.0)


@pytest.mark.night
@pytest.mark.parametrize("sensor", [True, False])
def test_nobody_there_and_a_finger_that_leaves_are_told(calibrated, weighed, open, monkeypatch, sensor):
    rig, bare = open(*([weighed] if sensor else [])), calibrated.calibration
    drive = drive_for(make_press(), bare, rig.limits)
    confirm = rig.operator.confirm
    pressing(rig, monkeypatch, None)
    raises(InstrumentError, "Nobody rests a finger", check_under_finger, rig, drive, "P07", plays=3)
    with pytest.raises((InstrumentError, DataError), match=r"Nobody rests a finger|Nothing seems to rest"):
        calibrate_finger(rig, bare, "P07")

    monkeypatch.setattr(rig.operator, "confirm", confirm)
    excite, plays = rig.excite_each, []

    def leaving(*args: Any, **more: Any) -> Any:
        plays.append(1)
        if len(plays) == 2:
            confirm(LiftFinger())
        return excite(*args, **more)

    monkeypatch.setattr(rig, "excite_each", leaving)
    raises(InstrumentError, "left the table before", check_under_finger, rig, drive, "P07", plays=3)


def test_fingers_rest_with_force(finger, open, monkeypatch):
    """Of a calibration with 10 N three times that was asked for, after two checks had been played."""
    rig = open(pane_mass=0.2)
    monkeypatch.setattr(pressed, "drive_for", lambda *_args, **_more: DRIVE)
    assert finger.finger is not None
    for nominal, forces in ((10.0, (4.0, 10.0, 20.0)), (20.0, (8.0, 20.0)), (0.1, (0.1, 0.3))):
        own = replace(finger, finger=replace(finger.finger, force=nominal))
        made = pressed_drives(make_press(), own, rig.limits)
        assert made.forces == pytest.approx(forces) and len(made.drives) == len(forces)
        made.refuse_nonsense()


def test_a_finger_that_lifts(calibrated, open, monkeypatch):
    rig = open(pane_mass=0.3)
    excite = rig.excite

    def short(volts: np.ndarray, *args: Any, **more: Any) -> Any:
        if len(volts) > 2 * rig.table.rate_hz:  # the multisine; the table is settled before
            rig.simulation.plant.hands[-1].end = rig.clock.now() + len(volts) / rig.table.rate_hz / 2
        return excite(volts, *args, **more)

    monkeypatch.setattr(rig, "excite", short)
    raises(DataError, "unexplained", calibrate_finger, rig, calibrated.calibration, "P07")


def test_a_force_sensor_that_cannot_feel_a_finger_is_refused_in_the_rig_file(tmp_path):
    for lines in ("[sensors]\nforce = false", "[sensors.force]\nhigh_pass_hz = 0.5"):
        path = tmp_path / "rig.toml"
        path.write_text(f'base = "simulated"\n[table]\nforce = true\n{lines}\n')
        raises(ConfigurationError, "is felt by a DC-coupled sensor", load_rig_file, path)


def test_a_button_holds_all(calibrated, weighed, open, tmp_path):
    rig, bare = open(weighed), calibrated.calibration
    button = build_button(rig, make_press(), bare, iterations=0, plays=3)
    with pytest.raises(ConfigurationError, match="made for the bare table"):
        play_button(rig, button, finger=RestFinger("P07", "button", 1.0))
    raises(ConfigurationError, "under one person's finger", button_under_finger, rig, button, bare)
    own = calibrate_finger(rig, bare, "P07")
    with pytest.raises(ConfigurationError, match="from a calibration of the rig 'another'"):
        button_under_finger(rig, replace(button, check=of_rig(button.check, "another")), own)
    elsewhere = replace(own, response=replace(own.response, point="31"))
    raises(ConfigurationError, "with patch A at 31", button_under_finger, rig, button, elsewhere)
    made = button_under_finger(rig, button, own, plays=8)
    assert made.passed and len(made.pressed_checks) == 3 and made.learning is button.learning
    made.save(tmp_path / "push-P07.h5")
    again = DigitalButton.load(tmp_path / "push-P07.h5")
    assert again.digest == made.digest != button.digest and again.pressed is not None
    assert again.pressed.participant == "P07"
    assert made.verdict == "pass" and len(button_contents(made).verdicts) == 4
    lost = replace(made.pressed_checks[2], verdict="fail")
    spoilt = replace(made, pressed_checks=(*made.pressed_checks[:2], lost))
    assert not spoilt.passed and spoilt.verdict == "fail" and "FAIL" in button_contents(spoilt).title
    assert "fail" in repr(spoilt) and spoilt.check.passed
    firm = play_button(rig, again, finger=RestFinger("P07", "button", 4.0), plays=3)
    assert np.array_equal(firm.drive.volts, again.pressed.drives[2].volts)
    with pytest.raises(DataError, match="a check each"):
        replace(made, pressed_checks=made.pressed_checks[:2]).refuse_nonsense()
    with pytest.raises(DataError, match="rising"):
        replace(again.pressed, forces=(1.0, 0.4, 3.0)).refuse_nonsense()
    assert isinstance(again.pressed, PressedDrives) and "P07" in repr(again.pressed)
