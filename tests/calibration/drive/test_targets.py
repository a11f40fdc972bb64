"""Presses of any rate on the clock of any drive."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import resample_poly

from haploop.calibration.drive.targets import BEFORE, target_grid
from tests.calibration.conftest import make_press

PRESS = make_press()


def at(rate_hz: float) -> object:
    """`PRESS` as a rig of another rate would have recorded it."""
    up, down = int(rate_hz) // 10, 500
    return replace(PRESS, rate_hz=rate_hz, acceleration=resample_poly(PRESS.acceleration, up, down))


@pytest.mark.parametrize(("pressed_hz", "driven_hz", "grid_hz"), [
    (5000, 50_000, 5000),
    (5000, 51_200, 5120),
    (5000, 48_000, 48_000 / 9),
    (5000, 44_100, 44_100 / 8),
    (5120, 50_000, 50_000 / 9),
    (48_000, 50_000, 50_000),
    (2000, 50_000, 5000),
    (1000, 48_000, 48_000 / 9),
])  # fmt: skip
def test_any_rates_drive_a_press_as_recorded(pressed_hz, driven_hz, grid_hz):
    """It moves as it did, at the same time; nothing is added that was not recorded."""
    table = SimpleNamespace(rate_hz=float(driven_hz), ringing=0.1, carriers=(0.0,))
    grid = target_grid([at(pressed_hz)], table, "broadband")
    assert grid.rate_hz == pytest.approx(grid_hz)
    assert grid.rate_hz * grid.oversampling == pytest.approx(driven_hz)
    driven = grid.on_drive(grid.acceleration)[0]
    t = np.arange(len(driven)) / driven_hz - round(BEFORE * grid.rate_hz) / grid.rate_hz
    true = np.interp(
        t, np.arange(len(PRESS.acceleration) * 20) / 1e5, resample_poly(PRESS.acceleration, 20, 1)
    )
    inside = (t > 0.02) & (t < 0.57)
    error = np.linalg.norm((driven - true)[inside]) / np.linalg.norm(true)
    assert error < (0.08 if pressed_hz < 2001 else 0.02)
    f = np.fft.rfftfreq(len(driven), 1 / driven_hz)
    power = np.abs(np.fft.rfft(driven)) ** 2
    assert power[f > 0.52 * min(pressed_hz, 5000)].sum() < 1e-3 * power.sum()


def test_presses_of_two_rates_are_played_at_once():
    table = SimpleNamespace(rate_hz=51_200.0, ringing=0.1, carriers=(0.0, 0.0, 0.0))
    grid = target_grid([at(5000), None, at(10_000)], table, "broadband")
    one, silent, other = grid.acceleration
    assert grid.rate_hz == pytest.approx(10_240) and not silent.any()
    assert np.linalg.norm(one - other) < 0.02 * np.linalg.norm(one)
