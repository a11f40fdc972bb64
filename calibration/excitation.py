"""Waveforms that are played into a patch to measure what it does."""

from __future__ import annotations

import numpy as np

from instruments import ConfigurationError
from instruments.arrays import FloatArray

__all__ = ["linear_sweep"]

_FADE_IN, _FADE_OUT = 0.1, 0.03
"""Seconds. A sweep ends at full voltage, and a step there would ring every mode; at the paper's
89 Hz/s this fade takes the last 2.7 Hz. It begins slowly anyway."""


def linear_sweep(rate_hz: float, duration: float, stop_hz: float, peak: float) -> FloatArray:
    """The paper's excitation: a sine whose frequency rises linearly from 0 to `stop_hz`.

    Returns (samples,) V of `duration` seconds at `rate_hz`, with zero ends, zero mean and the
    given peak. Raises ConfigurationError when that cannot be sampled.
    """
    if not 0 < stop_hz < rate_hz / 2 or duration < 2 * (_FADE_IN + _FADE_OUT):
        raise ConfigurationError(
            f"A sweep to {stop_hz:g} Hz in {duration:g} s cannot be played at {rate_hz:g} samples/s: "
            "it must end below half the sample rate and last longer than its fades."
        )
    samples = round(duration * rate_hz)
    t = np.arange(samples) / rate_hz
    window = np.ones(samples)
    for seconds, part in ((_FADE_IN, slice(None)), (_FADE_OUT, slice(None, None, -1))):
        n = round(seconds * rate_hz)
        window[part][:n] = 0.5 - 0.5 * np.cos(np.pi * np.arange(n) / n)
    sweep = window * np.sin(np.pi * stop_hz / duration * t**2)
    sweep -= window * (sweep.sum() / window.sum())
    return np.asarray(sweep * (peak / np.abs(sweep).max()))
