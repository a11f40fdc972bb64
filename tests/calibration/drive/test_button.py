from dataclasses import replace

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError
from haploop.calibration import DigitalButton, build_button, play_button
from tests.calibration.conftest import Calibrated, make_press, tamper
from tests.raising import raises


@pytest.fixture(scope="module")
def button(calibrated: Calibrated) -> DigitalButton:
    seen: list[tuple[object, ...]] = []
    given = calibrated.rig, make_press(), calibrated.calibration
    made = build_button(*given, iterations=0, plays=8, progress=lambda *step: seen.append(step))
    assert seen[-1] == ("Check the push button", 8, 8, "plays")
    return made


@pytest.mark.long
def test_a_button_holds_all_that_made_it(calibrated, button):
    assert button.passed and button.simulated == calibrated.rig.simulated
    assert button.drive.calibration == button.calibrations[0].digest
    assert button.drive.sources == button.press.sources
    assert button.drive.rig == calibrated.rig.name
    assert np.array_equal(button.learning.iterations[button.learning.best].volts, button.drive.volts)
    assert button.calibrations[0].response.rig_file


@pytest.mark.long
def test_playing_it_verifies_it(calibrated, button, monkeypatch):
    assert play_button(calibrated.rig, button, plays=8).passed
    tamper(calibrated.rig, monkeypatch, laser=lambda v: 0.7 * v)
    assert not play_button(calibrated.rig, button, plays=8).passed


def test_a_button_of_another_world_is_refused(calibrated, button):
    response = replace(button.calibrations[0].response, simulated=not calibrated.rig.simulated)
    other = replace(button, calibrations=(replace(button.calibrations[0], response=response),))
    raises(ConfigurationError, "calibrate that rig first", play_button, calibrated.rig, other)
    foreign = replace(button, check=replace(button.check, drive=replace(button.drive, rig="haptable")))
    raises(ConfigurationError, "'haptable'", play_button, calibrated.rig, foreign)
