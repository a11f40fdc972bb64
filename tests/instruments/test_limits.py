from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haploop.instruments import LimitError, Limits

RATE_HZ = 50_000.0
LIMITS = Limits(
    min=-50,
    max=50,
    peak_to_peak=90,
    slew=0.5e6,
    current_peak=0.1,
    current_average=0.05,
    capacitance=90e-9,
    max_duration=2,
    max_offset=0.5,
    max_end=0.5,
)


def tone(peak: float, frequency: float = 263.5, duration: float = 0.2) -> np.ndarray:
    t = np.arange(round(duration * RATE_HZ)) / RATE_HZ
    return peak * np.sin(2 * np.pi * frequency * t) * np.sin(np.pi * t / duration) ** 2


def test_a_drive_within_every_limit_passes() -> None:
    LIMITS.check(tone(44), RATE_HZ)


@pytest.mark.parametrize(
    ("drive", "says"),
    [
        (tone(60), "falls to|rises to"),
        (tone(46), "has a peak-to-peak voltage of"),
        (tone(44) + 0.6, "offset|starts or ends"),
        (np.concatenate([tone(10), [8.0]]), "starts or ends"),
        (np.concatenate([[0.0], np.tile([20.0, -20.0], 100), [0.0]]), "slews"),
        (tone(40, duration=2.1), "lasts"),
        (np.array([0.0, np.nan, 0.0]), "nan at sample 1"),
        (np.array([0.0, np.inf, 0.0]), "inf at sample 1"),
        (np.zeros(0), "shape"),
        (np.zeros((2, 5)), "shape"),
        (np.zeros(5, dtype=complex), "real numbers"),
        (np.zeros(5, dtype=bool), "real numbers"),
    ],
)
def test_each_limit_refuses_and_says_which(drive: np.ndarray, says: str) -> None:
    with pytest.raises(LimitError, match=says):
        LIMITS.check(drive, RATE_HZ)


def test_current_limits_follow_the_capacitance() -> None:
    ramp = np.concatenate([np.linspace(0, 40, 20), np.linspace(40, 0, 20)])
    four = Limits(current_peak=0.03, capacitance=360e-9)
    Limits(current_peak=0.03, capacitance=90e-9).check(ramp, RATE_HZ)
    with pytest.raises(LimitError, match="draws a peak of"):
        four.check(ramp, RATE_HZ)
    with pytest.raises(LimitError, match="draws on average"):
        Limits(current_average=1e-3, capacitance=360e-9).check(ramp, RATE_HZ)


def test_peak_is_half_of_peak_to_peak_or_the_nearer_limit() -> None:
    assert LIMITS.peak == 45
    assert Limits(min=-30, max=100).peak == 30


@given(low=st.floats(-200, -1), high=st.floats(1, 200), width=st.floats(1, 300), peak=st.floats(0, 300))
def test_what_passes_two_limits_passes_their_union(
    low: float, high: float, width: float, peak: float
) -> None:
    a, b, drive = Limits(min=low, max=high), Limits(peak_to_peak=width), tone(peak)

    def passes(limits: Limits) -> bool:
        try:
            limits.check(drive, RATE_HZ)
        except LimitError:
            return False
        return True

    assert passes(a.within(b)) == (passes(a) and passes(b))


@pytest.mark.parametrize(
    "limit", ["min", "max", "peak_to_peak", "slew", "max_offset", "max_end", "max_duration"]
)
def test_a_nan_limit_refuses_every_drive(limit: str) -> None:
    with pytest.raises(LimitError):
        Limits(**{limit: float("nan")}).check(tone(1), RATE_HZ)


def test_measured_volts_are_held_against_min_max_and_peak_to_peak() -> None:
    LIMITS.check_measured(tone(44), 1.1)
    for measured in (tone(60), tone(30) + 30, tone(30) - 30, np.full(5, np.nan)):
        with pytest.raises(LimitError, match="The patch got"):
            LIMITS.check_measured(measured, 1.1)
