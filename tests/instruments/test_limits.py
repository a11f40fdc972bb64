import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haploop.base.errors import LimitError
from haploop.instruments import Limits
from haploop.instruments.limits import sounding
from tests.raising import raises

RATE_HZ = 50_000.0
LIMITS = Limits(
    min=-50, max=50, peak_to_peak=90, slew=0.5e6, current_peak=0.1, current_average=0.05, capacitance=90e-9,
    max_duration=2, max_offset=0.5, max_end=0.5,
)  # fmt: skip


def tone(peak: float, frequency: float = 263.5, duration: float = 0.2) -> np.ndarray:
    t = np.arange(round(duration * RATE_HZ)) / RATE_HZ
    return peak * np.sin(2 * np.pi * frequency * t) * np.sin(np.pi * t / duration) ** 2


def test_a_drive_within_every_limit_passes():
    LIMITS.check(tone(44), RATE_HZ)


@pytest.mark.parametrize(("drive", "says"), [
    (np.array([0.0, np.nan, 0.0]), "nan at sample 1"),
    (np.array([0.0, np.inf, 0.0]), "inf at sample 1"),
    (np.zeros(0), "shape"),
    (np.zeros((2, 5)), "shape"),
    (np.zeros(5, dtype=complex), "real numbers"),
    (np.zeros(5, dtype=bool), "real numbers"),
])  # fmt: skip
def test_each_limit_refuses_and_says_which(drive, says):
    raises(LimitError, says, LIMITS.check, drive, RATE_HZ)


def test_current_limits_follow_the_capacitance():
    ramp = np.concatenate([np.linspace(0, 40, 20), np.linspace(40, 0, 20)])
    Limits(current_peak=0.03, capacitance=90e-9).check(ramp, RATE_HZ)
    for says, limit in (
        ("draws a peak of", {"current_peak": 0.03}),
        ("on average", {"current_average": 1e-3}),
    ):
        raises(LimitError, says, Limits(capacitance=360e-9, **limit).check, ramp, RATE_HZ)


def test_peak_is_half_of_peak_to_peak_or_the_nearer_limit():
    assert LIMITS.peak == 45
    assert Limits(min=-30, max=100).peak == 30


@given(low=st.floats(-200, -1), high=st.floats(1, 200), width=st.floats(1, 300), peak=st.floats(0, 300))
def test_two_limits_are_met_by_their_union(low, high, width, peak):
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
def test_a_nan_limit_refuses_every_drive(limit):
    raises(LimitError, "", Limits(**{limit: float("nan")}).check, tone(1), RATE_HZ)


# By hand: 10 samples/s, 1 F; the drive begins at sample 3 with a step of 1 V and ends with one.
SMALL = np.array([0.0, 0.0, 0.0, 1.0, 3.0, -2.0, 1.0, 0.0, 0.0])


@pytest.mark.parametrize(("limit", "at", "below", "says"), [
    ("min", -2.0, -1.5, "falls to -2 V at sample 5, 0.5 V beyond the -1.5 V"),
    ("max", 3.0, 2.5, "rises to 3 V at sample 4, 0.5 V beyond the 2.5 V"),
    ("peak_to_peak", 5.0, 4.0, "has a peak-to-peak voltage of 5 V at sample 4, 1 V beyond the 4 V"),
    ("slew", 50.0, 49.0, "slews at 50 V/s at sample 5, 1 V/s beyond the 49 V/s"),
    ("current_peak", 50.0, 49.0, "draws a peak of 50 A at sample 5, 1 A beyond the 49 A"),
    ("current_average", 12.0, 11.0, "draws on average 12 A at sample 3, 1 A beyond the 11 A"),
    ("max_duration", 0.4, 0.3, "lasts 0.4 s at sample 6, 0.1 s beyond the 0.3 s"),
    ("max_offset", 0.75, 0.5, "has an offset of 0.75 V at sample 3, 0.25 V beyond the 0.5 V"),
])  # fmt: skip
def test_each_limit_is_exact_and_says_how_much_where(limit, at, below, says):
    exact = Limits(**{"capacitance": 1.0, limit: at})
    exact.check(SMALL, 10.0)
    exact.check(SMALL + 0.0, 10.0)
    with pytest.raises(LimitError) as refused:
        Limits(**{"capacitance": 1.0, limit: below}).check(SMALL, 10.0, "a patch")
    assert str(refused.value) == f"The drive {says} of a patch."


def test_an_end_is_where_it_is_and_rounding_is_allowed_and_no_more():
    for ends, sample, most in (([0.5, 1.0, -0.25], 0, 0.5), ([0.5, 1.0, -0.7], 2, 0.7)):
        drive = np.array(ends)
        Limits(max_end=most).check(drive, 10.0)
        with pytest.raises(LimitError, match=f"starts or ends at {most} V at sample {sample}, 0.3 V beyond"):
            Limits(max_end=most - 0.3).check(drive, 10.0)
    for most in (1e-3, 1.0, 1e3):
        allowed = most + 0.9e-9 * max(1.0, most)
        Limits(max=most).check(np.array([0.0, allowed, 0.0]), 10.0)
        with pytest.raises(LimitError):
            Limits(max=most).check(np.array([0.0, most + 1.1e-9 * max(1.0, most), 0.0]), 10.0)
    raises(LimitError, "nan at sample 1:", LIMITS.check, np.array([0.0, np.nan, np.inf]), 10.0)
    LIMITS.check(np.zeros(5), 10.0)
    assert sounding(np.zeros(5)) == (0, 5) and sounding(SMALL) == (3, 7)


@given(
    drive=st.lists(st.integers(-9, 9), min_size=1, max_size=40).map(lambda v: np.array(v, float)),
    rate_hz=st.sampled_from((1.0, 4.0, 10.0, 100.0)),
)
def test_the_current_is_that_of_the_worst_second(drive, rate_hz):
    sounds = np.trim_zeros(drive) if drive.any() else drive
    current = np.abs(np.diff([0.0, *sounds, 0.0])) * rate_hz * 2.0
    window = min(round(rate_hz), len(current))
    worst = max(float(np.mean(current[k : k + window])) for k in range(len(current) - window + 1)) / 2
    Limits(current_average=worst, capacitance=2.0).check(drive, rate_hz)
    if worst:
        with pytest.raises(LimitError, match="draws on average"):
            Limits(current_average=worst - 1e-3, capacitance=2.0).check(drive, rate_hz)


@pytest.mark.parametrize(("limits", "factor", "binding"), [
    (Limits(max=30.0), 10.0, "30.0 V at the patch"),
    (Limits(slew=100.0), 2.0, "100 V/s at the patch"),
    (Limits(current_peak=25.0, capacitance=1.0), 0.5, "25 A into the patch"),
    (Limits(current_average=3.0, capacitance=1.0), 0.25, "3 A on average into the patch"),
    (Limits(max=30.0, slew=100.0), 2.0, "100 V/s at the patch"),
])  # fmt: skip
def test_headroom_is_the_factor_up_to_the_first_limit(limits, factor, binding):
    found, what = limits.headroom(SMALL[3:7], 10.0)
    assert found == pytest.approx(factor, rel=1e-12) and what == binding
    limits.check(SMALL * found, 10.0)
    raises(LimitError, "", limits.check, SMALL * found * 1.001, 10.0)


def test_zeros_have_any_headroom():
    assert Limits(max=30.0, slew=100.0).headroom(np.zeros(5), 10.0) == (np.inf, "")


def test_measured_volts_at_a_limit_are_within_it():
    limits = Limits(min=-2.0, max=3.0, peak_to_peak=5.0)
    limits.check_measured(np.array([-4.0, 6.0]), 2.0)
    for beyond in ([-4.001, 5.0], [-3.0, 6.001], [np.nan, 0.0]):
        with pytest.raises(LimitError, match="-2 to 3 V and 5 V from peak to peak"):
            limits.check_measured(np.array(beyond), 2.0)
    raises(LimitError, "", Limits(peak_to_peak=5.0).check_measured, np.array([-5.0, 5.001]), 2.0)


def test_the_stricter_of_each_limit_is_taken():
    loose, strict = Limits(min=-5.0, max=5.0, capacitance=1.0), Limits(min=-4.0, max=6.0, capacitance=2.0)
    for both in (loose.within(strict), strict.within(loose)):
        assert (both.min, both.max, both.capacitance) == (-4.0, 5.0, 2.0)
