"""The law of a patch as a response's levels tell it, and the distortion that it leaves.

That is motion on lines that were not played, without the noise there. A multisine on odd lines makes an odd
distortion on the odd lines that it leaves out, and an even one on even lines. Its negative turns the odd one
around and leaves the even one as it is, so that the product of both plays' motion holds the distortion, and
nothing of noise that differs between them. After Pintelon and Schoukens, System Identification, 2012, chapter
4.
"""

from __future__ import annotations

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray, IntArray
from ..spectra import third_octave
from .from_multisine import local_rational, looked_at, smoothed
from .hysteresis import Hysteresis, first_harmonic
from .measuring import QUICK, BothSigns
from .response import Response

_PASSED, _SHOWN = 0.1, 0.48
"""Share of what a pick-up passes at its corner that it passes at least where it is believed beyond; highest
frequency of that over the sample rate."""
_CORRELATED = 2.0
"""Variance of a sum of `_rough` lines' products over that of as many independent ones."""


def distortion(both: BothSigns, law: Hysteresis) -> float:
    """Motion on lines that were not played, over that on those played, with a law taken out.

    The median over the lines played, of both orders together. 0 where nothing stands out of the noise.
    """
    channels, one = both.channels, both.volts.shape[-1]
    lines, excited, even, odd, inner = looked_at(QUICK)
    f = lines * channels.rate_hz / one
    order = np.fft.rfft(QUICK.volts(channels.rate_hz, 1.0))[lines]
    linear = np.array([law.to_linear_volts(volts) for volts in both.volts])
    factor = channels.drive(np.fft.rfft(both.volts[:1])[:, lines], order, f)
    driven = np.fft.rfft(linear)[:, lines] * factor / law.gain(law.level)
    moved = channels.velocity(np.fft.rfft(both.velocity)[:, lines], f)
    first, second = (local_rational(x, y, inner) for x, y in zip(driven, moved, strict=True))
    left = (first.surprise * second.surprise.conj()).real

    def power(silent: IntArray, turned: float) -> FloatArray:
        return smoothed(turned * left[silent - inner[0]], silent, excited)

    followed = (first.response * second.response.conj()).real[excited - inner[0]]
    share = (power(even, 1.0) + power(odd, -1.0)) / (followed * np.abs(driven[0, excited]) ** 2)
    return float(np.sqrt(max(np.median(share), 0.0)))


def beyond(both: BothSigns, law: Hysteresis, above: Response) -> FloatArray:
    """(3, bands): motion above the frequencies played, as far as the response `above` goes, by third octaves.

    Lowest frequency (Hz) of each; power (m/s^2)^2 over all squared linear volts of the play, with what the
    law and the response explain taken out; and its standard deviation. A power that is less than its
    deviation from zero, or negative, is noise.
    """
    channels, one = both.channels, both.volts.shape[-1]
    lines = np.arange(QUICK.excited()[0], int(above.frequencies[-1] * one / channels.rate_hz) + 1)
    f = lines * channels.rate_hz / one
    order = np.fft.rfft(QUICK.volts(channels.rate_hz, 1.0))[lines]
    linear = np.fft.rfft([law.to_linear_volts(volts) for volts in both.volts])[:, lines]
    factor = channels.drive(np.fft.rfft(both.volts[:1])[:, lines], order, f) / law.gain(law.level)
    moved = channels.velocity(np.fft.rfft(both.velocity)[:, lines], f)
    left = moved - linear * factor * np.interp(f, above.frequencies, above.velocity)
    silent = f > f[QUICK.excited()[-1] - lines[0]]
    volts = (np.abs(linear[:, QUICK.excited() - lines[0]]) ** 2).sum() / 2
    return _by_bands(_rough(left)[:, silent], lines[silent], f[silent], volts)


def hidden(both: BothSigns, law: Hysteresis, above: Response) -> FloatArray:
    """(3, bands) as `beyond`: motion above the response `above`, as far as the pick-up shows a part of it.

    By the filter that it declares, and with what the law explains: no response tells how much that is.
    """
    channels, one = both.channels, both.volts.shape[-1]
    low, high = above.frequencies[-1], _SHOWN * channels.rate_hz
    lines = np.arange(int(low * one / channels.rate_hz), int(high * one / channels.rate_hz))
    f = lines * channels.rate_hz / one
    passed = np.abs(channels.laser(f))
    kept = passed > _PASSED * passed[0]
    moved = channels.velocity(np.fft.rfft(both.velocity)[:, lines], f)
    linear = np.fft.rfft([law.to_linear_volts(volts) for volts in both.volts])[:, QUICK.excited()]
    return _by_bands(_rough(moved)[:, kept], lines[kept], f[kept], (np.abs(linear) ** 2).sum() / 2)


def _by_bands(left: ComplexArray, lines: IntArray, f: FloatArray, volts: float) -> FloatArray:
    """See `beyond`, from (plays, lines) velocities and all squared volts."""
    # As in `distortion`. What is not in phase is noise, and as much of it is in phase.
    products = left[0] * left[1].conj() * (2 * np.pi * f) ** 2 * np.where(lines % 2, -1.0, 1.0)
    number = third_octave(f)
    found = []
    for band in np.unique(number):
        own = products[number == band]
        deviation = np.sqrt(_CORRELATED * (own.imag**2).sum())
        found.append((f[number == band][0], own.real.sum(), deviation))
    return np.asarray(np.reshape(found, (-1, 3)).T / np.array([[1.0], [volts], [volts]]))


def _rough(spectra: ComplexArray) -> ComplexArray:
    """(plays, lines) less the mean of two neighbours of the same order; independent lines keep their power.

    A surface that still rings when the record ends adds to all lines, smoothly.
    """
    rough = np.zeros_like(spectra)
    rough[:, 2:-2] = (spectra[:, 2:-2] - (spectra[:, 4:] + spectra[:, :-4]) / 2) / np.sqrt(1.5)
    return rough


_SHARES = np.array([0.0, 0.02, 0.03, 0.04, 0.055, 0.075, 0.1, 0.14, 0.2, 0.28, 0.39, 0.54, 0.75])
"""Half-widths of the operators fitted to sweeps, over the largest level; 0 is the part without hysteresis."""
_TRUST = 1e-3
_RIDGE = 1e-4
"""Regularisation of weights that the levels do not determine."""


def fit_hysteresis(response: Response) -> Hysteresis:
    """Fit the hysteresis to the measured differences of the response between levels.

    Without further levels it is the law that the response was computed with. Non-negative least squares in
    the weights keeps the loop invertible.
    """
    if not len(response.levels):
        return response.hysteresis
    full = response.level
    radii = _SHARES * full
    at_full = first_harmonic(radii, full)
    rows = [at_full.real, *(_RIDGE * np.eye(len(radii))[1:])]
    for level, ratio in zip(response.levels, response.level_gain, strict=True):
        equation = first_harmonic(radii, float(level)) - ratio * at_full
        # Each level is weighted by its uncertainty, taken as a thousandth at least.
        trust = _TRUST / np.hypot(_TRUST, _uncertainty(response, float(level)))
        rows += [trust * equation.real, trust * equation.imag]
    weights, _ = scipy.optimize.nnls(np.array(rows), np.array([1.0] + [0.0] * (len(rows) - 1)))
    weights[0] = max(weights[0], 0.1)
    found = Hysteresis(radii, np.asarray(weights), full)
    return Hysteresis(radii, weights / abs(found.gain(full)), full)


def _uncertainty(response: Response, level: float) -> float:
    """Standard deviation of the relative gain that one sweep at `level` gave."""
    single = response.deviation * np.sqrt(response.repeats) * response.level / level
    return float(np.linalg.norm(np.abs(response.velocity) * single) / np.linalg.norm(response.velocity) ** 2)
