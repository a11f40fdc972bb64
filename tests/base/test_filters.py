"""Each function gives what scipy.signal gives, whose import a command would wait for."""

import numpy as np
import pytest
import scipy.fft
import scipy.signal

from haploop.acquisition.presses.filtering import high_pass
from haploop.base import filters
from haploop.base.parts import PART

RATE = 5000.0
RATIOS = [(1, 5), (5, 1), (2, 4), (3, 3), (3, 7), (48, 125), (125, 48), (441, 480)]


def noise(samples: int) -> np.ndarray:
    return np.random.default_rng(samples).normal(size=samples)


@pytest.mark.parametrize("samples", [1, 2, 3, 100, 2001])
@pytest.mark.parametrize("ratio", RATIOS)
def test_resampling(samples, ratio):
    wanted = scipy.signal.resample_poly(noise(samples), *ratio)
    assert filters.resample_poly(noise(samples), *ratio) == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize("samples", [1, 2, 10, 11, 999])
def test_the_envelope(samples):
    wanted = scipy.signal.hilbert(noise(samples))
    assert filters.analytic(noise(samples)) == pytest.approx(wanted, abs=1e-12)
    assert filters.envelope(noise(samples)) == pytest.approx(np.abs(wanted), abs=1e-12)


def test_correlation():
    long, short = noise(200), noise(33)
    assert filters.correlate(long, short) == pytest.approx(scipy.signal.correlate(long, short), abs=1e-12)
    within = scipy.signal.correlate(long, short, "valid")
    assert filters.correlate_within(long, short) == pytest.approx(within, abs=1e-12)


@pytest.mark.parametrize("cutoff_hz", [1.0, 10.0, 60.0])
@pytest.mark.parametrize("samples", [PART // 8, PART + 5, 3 * PART])
def test_a_high_pass_without_phase(samples, cutoff_hz):
    """As forwards and backwards, at any cut-off, across parts, and with a large value at rest."""
    signal = np.cumsum(noise(samples)) / 30 + [[9.81], [-300.0]]
    sections = scipy.signal.butter(2, cutoff_hz, "highpass", fs=RATE, output="sos")
    wanted = scipy.signal.sosfiltfilt(sections, signal, padlen=round(RATE / 2))
    found = high_pass(signal, RATE, cutoff_hz)
    apart = np.abs(found - wanted)
    inner = round(2.5 * RATE)
    assert apart[:, inner:-inner].max() < 1e-5
    assert cutoff_hz < 10 or apart.max() < 1e-6


@pytest.mark.parametrize("samples", [0, 1, 63, 64, 65, 1000])
@pytest.mark.parametrize(("last", "before"), [(-1.9, 0.91), (0.0, 0.5), (-1.99995, 0.99995)])
def test_a_recursion_goes_on_where_the_part_before_ended(samples, last, before):
    values = noise(samples + 100)
    wanted = scipy.signal.lfilter([1.0], [1.0, last, before], values)
    first = filters.recursion(values[:100], last, before, np.zeros(2))
    found = filters.recursion(values[100:], last, before, first[-2:])
    assert np.concatenate([first, found]) == pytest.approx(wanted, rel=1e-9, abs=1e-9)


def test_a_slow_high_pass_does_not_see_the_other_end():
    """Of a signal that ends far from where it began, whose spectrum has the two side by side."""
    signal = np.where(np.arange(20_000) < 10_000, 0.0, 1000.0)
    assert np.abs(high_pass(signal, RATE, 1.0)[:100]).max() < 0.1  # the step, two periods away, leaves 0.06


@pytest.mark.parametrize("samples", [20, 3000])
@pytest.mark.parametrize("prominence", [0.0, 0.5, 2.0])
def test_peaks(samples, prominence):
    wandering = np.cumsum(noise(samples))
    wanted = scipy.signal.find_peaks(wandering, prominence=prominence)[0]
    found = filters.peaks(wandering, prominence)
    assert found == wanted.tolist()
    widths = scipy.signal.peak_widths(wandering, wanted, rel_height=0.5)[0]
    assert [filters.half_width(wandering, top) for top in found] == pytest.approx(widths, rel=1e-9)


def test_a_row_without_a_peak_has_none():
    for row in (np.arange(5.0), np.zeros(5), np.zeros(0)):
        assert filters.peaks(row, 0.0) == []


def test_lengths_that_are_quick_to_transform():
    lengths = [*range(1, 3000), 50_001, 1_000_003, 123_456_789]
    assert [filters.fast_length(n) for n in lengths] == [
        scipy.fft.next_fast_len(n, real=True) for n in lengths
    ]
