import numpy as np
import pytest

from haploop.base.errors import LimitError
from haploop.instruments import Limits
from haploop.instruments.limits import Coil

RATE_HZ = 50_000.0
COIL = Coil(8.0, 0.5e-3, 2.0)


def tone(peak: float, frequency: float, seconds: float) -> np.ndarray:
    return peak * np.sin(2 * np.pi * frequency * np.arange(round(seconds * RATE_HZ)) / RATE_HZ)


@pytest.mark.parametrize("frequency", [40.0, 263.5, 2000.0])
def test_a_coils_current_is_volts_over_its_impedance(frequency):
    current = COIL.current(tone(2.0, frequency, 0.5), RATE_HZ)[-round(0.1 * RATE_HZ) :]
    impedance = abs(8.0 + 2j * np.pi * frequency * 0.5e-3)
    assert np.abs(current).max() == pytest.approx(2.0 / impedance, rel=5e-3)


def test_without_an_inductance_the_current_is_never_smaller():
    volts = tone(2.0, 1000.0, 0.1)
    assert np.abs(Coil(8.0, 0.0, 1.0).current(volts, RATE_HZ)).max() == pytest.approx(0.25, rel=5e-3)
    assert np.abs(COIL.current(volts, RATE_HZ)).max() < 0.25


def test_a_steady_voltage_heats_as_one_body_does():
    volts = np.full(round(4 * RATE_HZ), 2.0)
    seconds = np.arange(1, len(volts) + 1) / RATE_HZ
    np.testing.assert_allclose(COIL.heat(volts, RATE_HZ), 0.5 * (1 - np.exp(-seconds / 2.0)), atol=1e-4)
    warm = COIL.heat(0 * volts, RATE_HZ, warm=0.3)
    np.testing.assert_allclose(warm, 0.3 * np.exp(-seconds / 2.0), rtol=1e-3)


def test_repeated_without_a_pause_a_drive_heats_to_its_mean():
    drive = np.concatenate([tone(2.0, 250.0, 0.3), np.zeros(round(0.3 * RATE_HZ))])
    often = np.tile(drive, 60)
    assert COIL.for_ever(drive, RATE_HZ) == pytest.approx(COIL.heat(often, RATE_HZ).max(), rel=1e-3)


def test_a_coils_power_and_current_refuse_a_drive():
    limits = Limits(coil=COIL, power=0.1, current_peak=0.2, current_average=0.1)
    hot = Limits(coil=COIL, power=0.05)
    for within in (limits, hot):
        within.check(tone(1.2, 250.0, 1.0), RATE_HZ)
    for beyond, volts, seconds, warm, says in (
        (limits, 2.0, 0.1, 0.0, r"draws a peak of 0\.2"),
        (limits, 1.4, 2.0, 0.0, r"draws on average 0\.1"),
        (hot, 1.2, 3.0, 0.0, r"heats the coil to 0\.0\d+ W .* beyond the 0\.05 W"),
        (hot, 1.2, 1.0, 0.045, "heats the coil"),
    ):
        with pytest.raises(LimitError, match=says):
            beyond.check(tone(volts, 250.0, seconds), RATE_HZ, warm=warm)


def test_headroom_plans_for_a_drive_that_is_repeated_for_ever():
    limits = Limits(coil=COIL, power=0.05)
    drive = tone(2.0, 250.0, 0.3)
    factor, by = limits.headroom(drive, RATE_HZ)
    assert by == "0.05 W in the coil"
    heat = COIL.heat(np.tile(factor * drive, 100), RATE_HZ).max()
    assert 0.7 * 0.05 < heat < 0.82 * 0.05


def test_the_stricter_limit_keeps_the_coil():
    both = Limits(power=1.0).within(Limits(coil=COIL, power=2.0))
    assert both.coil == COIL and both.power == 1.0
