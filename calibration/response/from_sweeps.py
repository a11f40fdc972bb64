"""Estimate of a response from sweeps, the paper's method."""

from __future__ import annotations

import numpy as np
from scipy.fft import fft, ifft, next_fast_len, rfft
from scipy.ndimage import uniform_filter1d

from haploop.calibration.response.channels import Channels
from haploop.calibration.response.estimate import FrfEstimate
from haploop.calibration.response.excitation import LinearSweep
from haploop.calibration.spectra import fade
from haploop.instruments.arrays import ComplexArray, FloatArray

__all__ = ["from_sweeps"]

_LOWEST = 20.0
"""Lowest frequency (Hz): below it the sweep fades in."""
_END = 5.0
"""Margin below the sweep's end (Hz), for its fade."""
_MORE = (8.0, 3.0)
"""Extra band below and above (Hz), for operations that need neighbouring lines."""
_PART = 75.0
"""Width (Hz) of the overlapping parts in which harmonics are separated from the response."""
_POOL = 41
"""Neighbouring lines (5 Hz) whose noise is averaged: it is smooth over frequency, so a few repeats give
its level within 10 %."""


def from_sweeps(
    sweep: LinearSweep, commanded: FloatArray, drives: FloatArray, velocities: FloatArray, channels: Channels
) -> FrfEstimate:
    """Estimate the response by dividing spectra of whole records, ringing included: without leakage.

    `commanded` is (samples,) V, one sweep at the full level; `drives` (plays, samples) V and
    `velocities` (plays, samples) m/s are as sampled: `sweep.repeats` plays at that level, then one
    at each of `sweep.shares`.
    """
    rate_hz, repeats = channels.rate_hz, sweep.repeats
    samples = drives.shape[1]
    length = next_fast_len(samples, real=True)
    low, high = _LOWEST, sweep.stop_hz - _END
    first, last = (edge * length / rate_hz for edge in (low - _MORE[0], high + _MORE[1]))
    lines = slice(int(np.ceil(first)), int(np.floor(last)) + 1)
    f = np.arange(lines.start, lines.stop) * rate_hz / length
    order = rfft(commanded, length)[lines]
    # Without the mean, zero padding makes no step.
    X, Y = (
        rfft(signals - signals.mean(axis=1, keepdims=True), length)[:, lines]
        for signals in (drives, velocities)
    )
    X, Y = X * channels.drive(X[:repeats], order, f), channels.velocity(Y, f)
    x, y = X[:repeats], Y[:repeats]

    power = (np.abs(x) ** 2).sum(axis=0)
    H = (np.conj(x) * y).sum(axis=0) / power
    # The drive is far above its noise, so the part that does not repeat is the velocity's noise.
    residual = (np.abs(y - H * x) ** 2).sum(axis=0) / (repeats - 1)
    residual = uniform_filter1d(residual, _POOL, mode="nearest")
    speed = sweep.stop_hz / sweep.seconds
    H = _without_harmonics(H, f, speed)
    signal = np.maximum((np.abs(H) ** 2 * power - residual) / repeats, 0.0)
    smaller = [_without_harmonics(b / a, f, speed) for a, b in zip(X[repeats:], Y[repeats:], strict=True)]
    kept = (f >= low) & (f <= high)
    level_gain = [np.vdot(H[kept], h[kept]) / np.linalg.norm(H[kept]) ** 2 for h in smaller]
    return FrfEstimate(
        frequencies=f[kept],
        velocity=H[kept],
        deviation=np.sqrt(residual / power)[kept],
        coherence=(signal / (signal + residual))[kept],
        path=(x.mean(axis=0) / order)[kept],
        noise=np.sqrt(2 * residual / (samples * rate_hz))[kept],
        distortion=np.zeros((0, 0)),
        level_gain=np.array(level_gain, dtype=np.complex128),
    )


def _without_harmonics(H: ComplexArray, frequencies: FloatArray, speed: float) -> ComplexArray:
    """Remove the harmonics that the patch's hysteresis adds to a sweep's response.

    The sweep passes frequency f at the time f / speed (Hz, Hz/s). The n-th harmonic at f was excited at
    1/n of that time, so in the impulse response it lies before time zero, at (1/n - 1) f / speed, where
    a causal system has no response (Farina, AES 108th Convention, 2000, for a logarithmic sweep; with a
    linear one the position depends on f). The impulse response is gated in overlapping parts of the
    band; each gate begins half way to the second harmonic and ends where the last harmonic wraps.
    """
    # Beyond its ends the band is extended point-symmetrically and faded, because an edge would ring.
    step = float(frequencies[1] - frequencies[0])
    more = round(_PART / 2 / step)
    f = frequencies[0] + step * np.arange(-more, len(H) + more)
    longer = np.pad(H, more, mode="reflect", reflect_type="odd") * fade(len(f), more, more)
    time = np.arange(len(f)) / (len(f) * step)
    gated = np.zeros(len(f), dtype=np.complex128)
    for centre in np.arange(f[0], f[-1] + _PART, _PART):
        weight = np.clip(1 - np.abs(f - centre) / _PART, 0, 1)
        begin = 1 / step - max((centre - _PART) / speed / 4, 0.1)
        end = 1 / step - (centre + _PART) / speed
        gate = np.interp(time, [end - 0.1, end, begin, begin + 0.05], [1, 0, 0, 1])
        gated += fft(gate * ifft(longer * weight))
    return gated[more : more + len(H)]
