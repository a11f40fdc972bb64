"""Times of samples from times of arrival: whatever the rate, the delays and the losses."""

import numpy as np
import pytest

from haploop.instruments.daq.free_running import ArrivalClock


def arrivals(rate_hz: float, seconds: float, wait: float, rng: np.random.Generator) -> np.ndarray:
    """Handed over by turns, at most `wait` s apart, as USB does."""
    times = 3.0 + np.arange(round(seconds * rate_hz)) / rate_hz
    turns = 3.0 + np.cumsum(rng.uniform(0.1 * wait, wait, round(4 * seconds / wait)))
    return np.asarray(turns[np.searchsorted(turns, times)])


@pytest.mark.long
@pytest.mark.parametrize(
    ("rate_hz", "drift"), [(80.0, -0.08), (80.0, 0.03), (1000.0, 50e-6), (2000.0, -2e-4)]
)
def test_the_earliest_arrivals_tell_begin_and_rate(rate_hz, drift, full):
    own, wait = rate_hz * (1 + drift), 0.01
    for seed in range(20 if full else 2):
        clock = ArrivalClock(rate_hz)
        came = arrivals(own, 30.0, wait, np.random.default_rng(seed))
        for index, time in enumerate(came):
            clock.note(index, float(time))
        true = 3.0 + np.arange(len(came)) / own
        error = clock.at(np.arange(len(came), dtype=float)) - true
        # No estimate lies before the sample, and none is later than a few shortest delays.
        assert error.min() > -1e-3 and error.max() < 0.25 * wait
        assert clock.rate_hz == pytest.approx(own, rel=2e-4)
        assert 0.5 * wait < clock.jitter < 2 * wait
        assert clock.slip == 0


def test_stalls_of_the_host_move_nothing():
    """Half a second in which nothing was read, every five: what comes then comes at once."""
    clock, own = ArrivalClock(80.0), 79.0
    for index in range(3000):
        time = 3.0 + index / own
        clock.note(index, max(time, np.floor(time / 5) * 5 + 0.5))
    error = clock.at(np.array([1000.0, 2999.0])) - (3.0 + np.array([1000.0, 2999.0]) / own)
    assert np.abs(error).max() < 2e-3 and clock.slip == 0


def test_samples_that_are_lost_without_a_trace_are_told():
    clock, rng = ArrivalClock(80.0), np.random.default_rng(1)
    slips = []
    for number in range(4000):
        if 2000 <= number < 2006:
            continue
        index = number if number < 2000 else number - 6
        clock.note(index, 3.0 + number / 80.0 + rng.uniform(0, 0.005))
        if clock.slip:
            slips.append(clock.slip)
            break
    assert slips == [pytest.approx(6 / 80.0, abs=0.004)]


def test_before_anything_is_known_the_nominal_rate_holds():
    clock = ArrivalClock(100.0)
    assert not clock.ready and clock.rate_hz == 100.0 and clock.jitter == 0.0
    clock.note(0, 5.0)
    assert clock.at(np.array([10.0])) == pytest.approx(5.1) and not clock.ready
