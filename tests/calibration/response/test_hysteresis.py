from dataclasses import replace

import numpy as np
import pytest

from haploop.calibration.response.hysteresis import Hysteresis


@pytest.fixture
def patch() -> Hysteresis:
    return Hysteresis(np.array([0, 3, 8, 20.0]), np.array([0.6, 0.2, 0.1, 0.15]), 50.0)


def test_the_inverse_undoes_the_loop(patch):
    walk = np.random.default_rng(0).standard_normal(5000).cumsum()
    linear_volts = patch.to_linear_volts(walk)
    assert np.abs(linear_volts - walk).max() > 3
    assert np.abs(patch.from_linear_volts(linear_volts) - walk).max() < 1e-9
    assert np.abs(patch.to_linear_volts(patch.from_linear_volts(walk)) - walk).max() < 1e-9
    assert patch.from_linear_volts(np.zeros(10)) == pytest.approx(0)


@pytest.mark.parametrize("even", [(0.04, 0.0), (0.0, 0.07), (-0.03, 0.05), (0.05, -0.1)])
def test_the_inverse_undoes_the_even_order_too(patch, even):
    bent = replace(patch, even=np.array(even))
    volts = 48 * np.sin(np.random.default_rng(1).standard_normal(5000).cumsum() / 5)
    linear_volts = bent.to_linear_volts(volts)
    assert np.abs(linear_volts - patch.to_linear_volts(volts)).max() > 0.3
    assert np.abs(bent.from_linear_volts(linear_volts) - volts).max() < 1e-9
    # A limit in volts is kept in both directions: the weaker one sets what is planned.
    steps = [bent.to_linear_volts(sign * np.linspace(0, 48, 100))[-1] for sign in (1, -1)]
    assert bent.reach(48) == pytest.approx(min(np.abs(steps)))


@pytest.mark.parametrize("amplitude", [2, 10, 30, 50])
def test_the_gain_is_the_first_harmonic(patch, amplitude):
    turn = 2 * np.pi * np.arange(20000) / 10000
    linear_volts = patch.to_linear_volts(amplitude * np.sin(turn))[10000:]
    measured = 2j * np.mean(linear_volts * np.exp(-1j * turn[10000:])) / amplitude
    assert patch.gain(amplitude) == pytest.approx(measured, abs=1e-4)


def test_what_was_fitted_is_what_was_measured(calibrated):
    hysteresis, response = calibrated.calibration.hysteresis, calibrated.calibration.response
    at_full = hysteresis.gain(response.level)
    assert abs(at_full) == pytest.approx(1)
    for level, gain in zip(response.levels, response.level_gain, strict=True):
        assert hysteresis.gain(level) / at_full == pytest.approx(gain, abs=0.01)
    if calibrated.rig.simulated:
        # The loop's opening over its height at 100 Vpp, as the rig file has it.
        turn = 2 * np.pi * np.arange(20000) / 10000
        volts = response.level * np.sin(turn)
        linear_volts = hysteresis.to_linear_volts(volts)[10000:]
        opening = linear_volts[5000] - linear_volts[0]
        assert abs(opening) / np.ptp(linear_volts) == pytest.approx(
            calibrated.rig.file.simulation.hysteresis, rel=0.15
        )
