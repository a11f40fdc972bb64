"""Sweeps while the laser hums: the response, its uncertainty, and the modes that are named."""

import numpy as np
import pytest

from haploop.calibration import calibrate

pytestmark = [pytest.mark.requires("simulation"), pytest.mark.many_plays]


@pytest.mark.long
@pytest.mark.parametrize("fault", [
    {"kind": "mains-hum", "volts": 0.02, "frequency": 49.9},
    {"kind": "rotating-machine", "volts": 0.02, "frequency": 117.3},
], ids=["hum", "fan"])  # fmt: skip
def test_a_steady_tone_is_no_mode_and_no_error(open, fault):
    """Sweeps 410 periods of 50 Hz apart showed no scatter by hum: a mode at 49.99 Hz was named."""
    rig = open(seed=7, faults=[{"channel": "laser", **fault}])
    calibration = calibrate(rig)
    response, truth = calibration.response, rig.simulation.truth
    inside = (response.frequencies > 30) & (response.frequencies < 600)
    true = truth.velocity_response("A", "button", response.frequencies)[inside]
    found = response.velocity[inside]
    found = found / (np.vdot(true, found) / np.vdot(true, true))  # the patch's law is a gain
    assert np.linalg.norm(found - true) < 0.003 * np.linalg.norm(true)
    assert response.uncertainty < 0.01
    assert np.mean(np.abs(found - true) < 2 * response.deviation[inside]) > 0.9
    hz = np.array([mode.frequency_hz for mode in calibration.model.resonances])
    tones = np.arange(1, 6) * fault["frequency"]
    assert np.abs(hz[:, None] - tones).min() > 1.0
    assert calibration.model.resonance_hz == pytest.approx(truth.resonance_hz, abs=0.05)


@pytest.mark.long
def test_a_tone_that_is_not_steady_is_in_the_stated_deviation(open):
    fan = {"kind": "rotating-machine", "channel": "laser", "volts": 0.02, "frequency": 117.3, "wander": 1e-3}
    response = (rig := open(seed=7, faults=[fan])) and calibrate(rig).response
    inside = (response.frequencies > 30) & (response.frequencies < 600)
    true = rig.simulation.truth.velocity_response("A", "button", response.frequencies)[inside]
    found = response.velocity[inside]
    found = found / (np.vdot(true, found) / np.vdot(true, true))
    error = np.linalg.norm(found - true) / np.linalg.norm(true)
    assert 0.02 < error < response.uncertainty
