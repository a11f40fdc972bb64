"""The vertical acceleration of a button's cap from whatever shows its motion.

Model: an accelerometer shows it. A velocity is differentiated once, a displacement twice, in the frequency
domain: multiplied by j w, or (j w)^2, which multiplies noise as well. So only a band is kept: up to the
highest frequency at which the loudest parts of the recording stand above the noise of the rest. Travel is
positive downwards and the acceleration upwards, hence the sign. Assumed: the rest shows the sensor's noise,
presses are louder than that, and the noise does not change. What breaks it: a resonance of the sensor beyond
the band's end, which is not seen; a motor that runs while pressed only.
"""

from __future__ import annotations

import numpy as np
import scipy

from ...base.arrays import FloatArray
from ...base.filters import fast_length

_LEAST_HZ, _SHARE = 100.0, 0.4
"""Lowest upper edge of the band (Hz); highest, over the sample rate."""
_ABOVE = 4.0
"""Power over the rest's from which a frequency is part of the band."""
_SEGMENT = 0.1
"""s: length of the segments whose power is compared."""
_LOUD = 0.1
"""Part of the segments that is taken for presses: the loudest."""
_FADE = 0.2
"""Width of the band's upper edge, over its frequency."""


def differentiated(signal: FloatArray, order: int, rate_hz: float, rest: slice) -> tuple[FloatArray, float]:
    """Acceleration (samples,) of a velocity or an upward displacement, and the band's upper edge (Hz)."""
    edge = _edge(signal, order, rate_hz, rest)
    pad = round(0.25 * rate_hz)
    # A straight line between the ends has no derivative within the band, and leaves no jump.
    padded = np.pad(signal - (signal.mean() if len(signal) else 0.0), pad, mode="reflect", reflect_type="odd")
    length = fast_length(len(padded))
    spectrum = np.fft.rfft(padded, length)
    f = np.asarray(np.fft.rfftfreq(length, 1 / rate_hz))
    spectrum *= (2j * np.pi * f) ** order * _passed(f, edge)
    return np.asarray(np.fft.irfft(spectrum, length)[pad : pad + len(signal)]), edge


def _passed(f: FloatArray, edge: float) -> FloatArray:
    return np.asarray(np.cos(np.pi / 2 * np.clip((f / edge - 1) / _FADE, 0, 1)) ** 2)


def _edge(signal: FloatArray, order: int, rate_hz: float, rest: slice) -> float:
    """Upper edge of the band in which the loudest segments stand above the rest."""
    width, most = round(_SEGMENT * rate_hz), _SHARE * rate_hz
    segments, quiet = _powers(signal, width), _powers(signal[rest], width)
    if not len(segments) or not len(quiet):
        return most
    f = np.asarray(np.fft.rfftfreq(width, 1 / rate_hz))
    # Loudness is that of the acceleration, within what every sensor shows.
    weights = (2 * np.pi * f) ** (2 * order) * ((f > 20) & (f < 4 * _LEAST_HZ))
    loudest = np.argsort(segments @ weights)[-max(1, round(_LOUD * len(segments))) :]
    near = max(3, round(60 / (f[1] or 1.0)))
    loud, still = (
        scipy.ndimage.uniform_filter1d(powers.mean(axis=0), near) for powers in (segments[loudest], quiet)
    )
    within = (loud > _ABOVE * still) | (f < _LEAST_HZ)
    # From the band's lower end up to the first frequency that is lost in the noise.
    lost = np.flatnonzero(~within)
    return float(np.clip(f[lost[0]] if len(lost) else most, _LEAST_HZ, most))


def _powers(signal: FloatArray, width: int) -> FloatArray:
    """Power spectra of the signal's segments (segments, frequencies), each without its straight line."""
    count = len(signal) // width if width > 7 else 0
    segments = signal[: count * width].reshape(count, width)
    line = np.linspace(0, 1, width)
    ends = segments[:, :1] * (1 - line) + segments[:, -1:] * line if count else segments
    return np.asarray(np.abs(np.fft.rfft((segments - ends) * np.hanning(width), axis=1)) ** 2)
