"""Distortion that a patch's law leaves: motion on lines that were not played, without the noise there.

A multisine on odd lines makes an odd distortion on the odd lines that it leaves out, and an even one on even
lines. Its negative turns the odd one around and leaves the even one as it is, so that the product of both
plays' motion holds the distortion, and nothing of noise that differs between them. After Pintelon and
Schoukens, System Identification, 2012, chapter 4.
"""

from __future__ import annotations

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray, IntArray
from ..spectra import third_octave
from .from_multisine import looked_at, smoothed
from .hysteresis import Hysteresis
from .local_rational import local_rational
from .measuring import QUICK, BothSigns
from .response import Response

_CORRELATED = 2.0
"""Variance of a sum of `_rough` lines' products over that of as many independent ones."""


def distortion(both: BothSigns, law: Hysteresis) -> float:
    """Motion on lines that were not played, over that on those played, with a law taken out.

    The median over the lines played, of both orders together. 0 where nothing stands out of the noise.
    """
    channels, one = both.channels, both.volts.shape[-1]
    lines, excited, even, odd, inner = looked_at(QUICK)
    f = lines * channels.rate_hz / one
    order = scipy.fft.rfft(QUICK.volts(channels.rate_hz, 1.0))[lines]
    linear = np.array([law.to_linear_volts(volts) for volts in both.volts])
    factor = channels.drive(scipy.fft.rfft(both.volts[:1])[:, lines], order, f)
    driven = scipy.fft.rfft(linear)[:, lines] * factor / law.gain(law.level)
    moved = channels.velocity(scipy.fft.rfft(both.velocity)[:, lines], f)
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
    order = scipy.fft.rfft(QUICK.volts(channels.rate_hz, 1.0))[lines]
    linear = scipy.fft.rfft([law.to_linear_volts(volts) for volts in both.volts])[:, lines]
    factor = channels.drive(scipy.fft.rfft(both.volts[:1])[:, lines], order, f) / law.gain(law.level)
    moved = channels.velocity(scipy.fft.rfft(both.velocity)[:, lines], f)
    left = _rough(moved - linear * factor * np.interp(f, above.frequencies, above.velocity))
    # As in `distortion`. What is not in phase is noise, and as much of it is in phase.
    products = left[0] * left[1].conj() * (2 * np.pi * f) ** 2 * np.where(lines % 2, -1.0, 1.0)
    number = third_octave(f)
    silent = f > f[QUICK.excited()[-1] - lines[0]]
    found = []
    for band in np.unique(number[silent]):
        own = products[silent & (number == band)]
        deviation = np.sqrt(_CORRELATED * (own.imag**2).sum())
        found.append((f[silent & (number == band)][0], own.real.sum(), deviation))
    volts = (np.abs(linear[:, QUICK.excited() - lines[0]]) ** 2).sum() / 2
    return np.asarray(np.reshape(found, (-1, 3)).T / np.array([[1.0], [volts], [volts]]))


def _rough(spectra: ComplexArray) -> ComplexArray:
    """(plays, lines) less the mean of two neighbours of the same order; independent lines keep their power.

    A surface that still rings when the record ends adds to all lines, smoothly.
    """
    rough = np.zeros_like(spectra)
    rough[:, 2:-2] = (spectra[:, 2:-2] - (spectra[:, 4:] + spectra[:, :-4]) / 2) / np.sqrt(1.5)
    return rough
