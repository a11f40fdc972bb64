from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import rfft, rfftfreq

from haploop.base.errors import DataError
from haploop.calibration import Calibration, Response, drive_for, modulate
from tests.calibration.conftest import make_press


def test_modulation_is_equation_1():
    t = np.arange(1000) / 5000
    a = np.exp(-t)
    assert modulate(a, 5000.0, 263.5) == pytest.approx(a * np.sin(2 * np.pi * 263.5 * t))


def test_a_drive_uses_the_limits_and_keeps_them(calibrated, drive):
    limits = calibrated.rig.limits
    limits.check(drive.volts[0], drive.rate_hz)
    assert 0.95 * limits.peak < drive.peak <= limits.peak
    path = float(np.median(np.abs(calibrated.calibration.response.path)))
    assert drive.peak * path <= limits.peak * (1 + 1e-9)
    assert drive.volts[:, [0, -1]] == pytest.approx(0, abs=0.05)
    assert drive.volts.mean() == pytest.approx(0, abs=1e-6)
    # Most of it is what the patch's distortion moves above the band.
    assert 0.01 < drive.predicted_error <= 0.12
    assert drive.volts.shape == (1, *drive.target.shape)
    assert drive.simulated and drive.calibration == calibrated.calibration.digest


def test_a_drive_has_no_power_where_the_response_was_not_measured(drive):
    """What is left is of fades and of the hysteresis that is compensated."""
    low, high = drive.known
    f, power = rfftfreq(len(drive.target), 1 / drive.rate_hz), np.abs(rfft(drive.volts[0])) ** 2
    below, above = (10 * np.log10(power[where].sum() / power.sum()) for where in (f < low, f > high))
    assert below < -20 and above < -45


def test_the_target_is_the_press_in_band(calibrated, drive, press):
    assert drive.carrier_hz == calibrated.calibration.model.resonance_hz
    low, high = drive.band
    assert low < drive.carrier_hz < high
    modulated = np.zeros(len(drive.target) // 10)
    begin = 1500
    modulated[begin : begin + len(press.acceleration)] = modulate(
        press.acceleration, press.rate_hz, drive.carrier_hz
    )
    f = rfftfreq(len(modulated), 1 / press.rate_hz)
    expected = rfft(modulated) * drive.scale
    got = rfft(drive.target)[: len(f)] / 10
    inside = (f > 1.35 * low) & (f < 0.93 * high)
    assert np.abs(got - expected)[inside].max() < 0.02 * np.abs(expected).max()
    beyond = (f < 0.95 * low) | (f > 1.02 * high)
    assert np.abs(got[beyond]).max() < 0.01 * np.abs(expected).max()
    share = (np.abs(got) ** 2).sum() / (np.abs(expected) ** 2).sum()
    assert drive.in_band == pytest.approx(share, abs=0.02)


def test_broadband_is_the_press_itself(calibrated, press):
    drive = drive_for(press, calibrated.calibration, calibrated.rig.limits, method="broadband")
    assert drive.carrier_hz == 0 and drive.method == "broadband"
    begin = 1500 * 10
    own = press.acceleration * drive.scale
    got = drive.target[begin : begin + 10 * len(own) : 10]
    # A snap at 235 Hz that rings at 120 Hz lies within the band, nearly.
    assert np.linalg.norm(got - own) < 0.4 * np.linalg.norm(own)
    assert drive.in_band > 0.85


def test_what_is_not_reached_is_said(calibrated, drive, press):
    assert f"at {drive.scale:.1%} of the recorded acceleration" in drive.unreached
    assert "48.0 V at the patch" in drive.unreached
    assert f"{1 - drive.in_band:.0%} of the energy lies outside 75 to 600 Hz" in drive.unreached
    whisper = replace(press, acceleration=1e-3 * press.acceleration)
    loud = drive_for(whisper, calibrated.calibration, calibrated.rig.limits)
    assert "of the recorded acceleration" not in loud.unreached


def test_half_the_limit_halves_the_scale(calibrated, drive, press):
    limits = replace(calibrated.rig.limits, peak_to_peak=calibrated.rig.limits.peak)
    softer = drive_for(press, calibrated.calibration, limits)
    limits.check(softer.volts[0], softer.rate_hz)
    assert softer.scale < 0.7 * drive.scale
    slow = replace(calibrated.rig.limits, slew=5e3)
    slower = drive_for(press, calibrated.calibration, slow)
    slow.check(slower.volts[0], drive.rate_hz)
    assert "5e+03 V/s" in slower.unreached


def test_the_vibrometers_range_is_a_limit_too(calibrated, press):
    own = calibrated.calibration
    narrow = replace(own, response=replace(own.response, pickup_range=0.1e-3))
    drive = drive_for(press, narrow, calibrated.rig.limits)
    assert drive.peak < 0.8 * calibrated.rig.limits.peak
    assert np.abs(drive.target).max() / (2 * np.pi * drive.band[1]) < 0.1e-3


@pytest.mark.parametrize("acceleration", [np.zeros(3000), np.full(3000, np.nan), np.ones(3), np.ones((2, 9))])
def test_a_press_that_cannot_be_driven_is_refused(calibrated, acceleration):
    with pytest.raises(DataError, match="no acceleration"):
        drive_for(
            replace(make_press(), acceleration=acceleration), calibrated.calibration, calibrated.rig.limits
        )


def test_a_response_that_is_noise_is_refused(calibrated, press):
    response = calibrated.calibration.response
    useless = replace(calibrated.calibration, response=replace(response, coherence=0.1 * response.coherence))
    with pytest.raises(DataError, match="too noisy"):
        drive_for(press, useless, calibrated.rig.limits)


def test_a_response_is_fitted(calibrated, drive, monkeypatch):
    fitted: list[Response] = []
    monkeypatch.setattr(Calibration, "of", lambda one: (fitted.append(one), calibrated.calibration)[1])
    response = calibrated.calibration.response
    alone = drive_for(make_press(), response, calibrated.rig.limits)
    assert fitted == [response] and np.array_equal(alone.volts, drive.volts)
