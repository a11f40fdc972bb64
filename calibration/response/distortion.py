"""Distortion that a patch's law leaves: motion on lines that were not played, without the noise there.

A multisine on odd lines makes an odd distortion on the odd lines that it leaves out, and an even one on even
lines. Its negative turns the odd one around and leaves the even one as it is, so that the product of both
plays' motion holds the distortion, and nothing of noise that differs between them. After Pintelon and
Schoukens, System Identification, 2012, chapter 4.
"""

from __future__ import annotations

import numpy as np
import scipy

from ...base.arrays import FloatArray, IntArray
from .from_multisine import looked_at, smoothed
from .hysteresis import Hysteresis
from .local_rational import local_rational
from .measuring import QUICK, BothSigns


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
