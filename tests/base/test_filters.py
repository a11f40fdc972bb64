"""Each function gives what scipy.signal gives, whose import a command would wait for."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal

from haploop.base import filters

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
