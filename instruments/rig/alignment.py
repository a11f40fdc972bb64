"""Align a recording to the clock of the drive that a free-running player played during it.

Where player and DAQ share no clock, the measured drive shows when the play began and how fast the
player's clock runs. Both are fitted to the commanded drive, together with two parameters that may
bias them: the gain and the corner of the player's AC coupling. Every channel is then evaluated at
the drive's own sample times by a Fourier series, so that a shift by a fraction of a sample is exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import InstrumentError
from ...base.filters import correlate_within, fast_length
from ..daq import Capture

_LEAST = 0.5
"""Correlation of measured and commanded drive below which the drive counts as not found."""
_MOST_DRIFT = 500e-6
"""Crystals differ by 10 to 100 ppm (estimate; docs/hardware.md, "Sound card"): more is a wrong rate."""
_GOOD = 0.3
"""Misfit below which the drive counts as found: no other clock drift is tried."""
_DRIFT = 1e-4
_CORNER = 5.0
"""Prior widths of the drift and of the coupling's corner (Hz): with a drive of one tone neither can be told
from a delay."""
_MODEL = 1e-3
"""Fraction of the drive by which the measured one may differ for causes outside the model."""
_STEPS = 3


@dataclass(frozen=True)
class Timing:
    """Timing of a played drive on the DAQ's clock."""

    begin: float
    """Seconds from the DAQ's first sample to the drive's first at the patch."""
    drift: float
    """Relative excess of the player's clock rate over the DAQ's."""
    gain: float
    """Measured volts per commanded volt."""
    misfit: float
    """Rms of the fit's residual over the rms of the measured drive."""


@dataclass(frozen=True, eq=False)
class Aligned(Capture):
    """A capture on the drive's clock: sample 0 is the drive's first, as with a DAQ's own output."""

    timing: Timing


def align(capture: Capture, timing: Timing, samples: int) -> Aligned:
    """Resample the first `samples` of every channel to the drive's clock; channel delays do not change."""
    start, step = timing.begin * capture.rate_hz, 1 / (1 + timing.drift)
    volts = np.array([_at(row, start, step, samples) for row in capture.volts])
    return Aligned(capture.channels, capture.rate_hz, volts, capture.delays, capture.overload, timing)


def find(
    measured: FloatArray,
    drive: FloatArray,
    rate_hz: float,
    delay: float,
    response: Callable[[FloatArray], ComplexArray],
) -> Timing:
    """Estimate when and how fast `drive` was played from its measurement, both (samples,) V.

    `delay` is the monitor channel's (see `Stream.delays`), `response` the player's frequency response
    (at frequencies in Hz), as far as it is known. Raises InstrumentError when the drive is not found,
    is inverted, or the clocks differ by more than crystals do.
    """
    length = fast_length(len(measured) + len(drive))
    measured = measured - measured.mean()
    D = np.fft.rfft(drive, length) * response(np.asarray(np.fft.rfftfreq(length, 1 / rate_hz)))
    expected = np.asarray(np.fft.irfft(D, length)[: len(drive)])

    # Fit only the drive's band, with as few samples as represent it.
    power = np.cumsum(np.abs(D) ** 2)
    band = int(np.searchsorted(power, 0.9999 * power[-1]))
    short = min(fast_length(max(4 * band, 256)), length)
    rate = short / length * rate_hz
    f = np.arange(short // 2 + 1) * rate_hz / length
    t = np.arange(int(len(drive) / rate_hz * rate)) / rate

    def cropped(spectrum: ComplexArray) -> FloatArray:
        return np.asarray(np.fft.irfft(spectrum[: len(f)], short) * (short / length))

    heard = cropped(np.asarray(np.fft.rfft(measured, length)))
    d, slope, sag = (
        cropped(D[: len(f)] * factor)[: len(t)] for factor in (1.0, 2j * np.pi * f, -1 / (1j * f + _CORNER))
    )
    # To first order: gain x (drive - late x slope + fast x t x slope + corner x sag).
    basis = np.stack([d, slope, t * slope, sag], axis=1)
    prior = _MODEL * float(np.linalg.norm(d)) / np.array([_DRIFT, _CORNER])
    rows = np.vstack([basis, [[0.0, 0.0, prior[0], 0.0], [0.0, 0.0, 0.0, prior[1]]]])

    def fitted(begin: float, drift: float) -> Timing:
        gain = 0.0
        for _ in range(_STEPS):
            seen = _at(heard, begin * rate, 1 / (1 + drift), len(t))
            gain = gain or float(np.dot(d, seen) / np.dot(d, d))
            found = np.linalg.lstsq(rows, np.append(seen, [-prior[0] * gain * drift, 0.0]), rcond=None)[0]
            gain = float(found[0])
            begin -= float(found[1]) / gain if gain else 0.0
            drift += float(found[2]) / gain if gain else 0.0
        size = float(np.linalg.norm(seen))
        misfit = float(np.linalg.norm(seen - basis @ found)) / size if size else 1.0
        return Timing(begin + delay, drift, gain, misfit)

    # A large drift smears the correlation that locates the begin. Other drifts are then tried, in steps of
    # half a period of the drive's highest frequency at its end.
    finest = length / (2 * band * len(drive))
    fits = []
    for number in range(2 * int(_MOST_DRIFT / finest) + 3):
        drift = finest * ((number + 1) // 2) * (-1) ** number
        moved = measured if not number else _at(measured, 0.0, 1 / (1 + drift), len(measured))
        fits.append(fitted(_place(moved, expected) / rate_hz / (1 + drift), drift))
        if fits[-1].misfit < _GOOD:
            break
    best = min(fits, key=lambda timing: timing.misfit)
    _refuse(best)
    return best


def _refuse(timing: Timing) -> None:
    correlation = float(np.sqrt(max(0.0, 1 - timing.misfit**2)))
    if not correlation >= _LEAST:
        raise InstrumentError(
            f"The drive monitor does not show the drive that was played (correlation {correlation:.2f}): "
            "check the player's cable and volume, the amplifier, the relay, the monitor, and 'max_latency' "
            "in [player]."
        )
    if timing.gain < 0:
        raise InstrumentError(
            "The drive monitor shows the drive upside down: swap the wires at the player's output, or of the "
            "monitor's divider."
        )
    if not abs(timing.drift) <= _MOST_DRIFT:
        raise InstrumentError(
            f"The player's clock differs from the DAQ's by {timing.drift * 1e6:.0f} ppm, and crystals differ "
            "by 100 at most: is its rate resampled by the operating system? Set 'rate_hz' to what it runs at."
        )


def _place(measured: FloatArray, expected: FloatArray) -> float:
    """Most likely first sample of the drive or of its inverse, with a resolution below one sample."""
    found = np.abs(correlate_within(measured, expected))
    before, peak, after = found[:-2], found[1:-1], found[2:]
    tops = np.flatnonzero((peak >= before) & (peak > after) & (peak > 0.9 * found.max(initial=0.0)))
    if not len(tops):
        return float(found.argmax())
    # The peaks of a tone's correlation are nearly equal: compare them interpolated between samples.
    slope, bend = (after - before)[tops] / 2, (after - 2 * peak + before)[tops]
    best = int((peak[tops] - slope**2 / (2 * bend)).argmax())
    return float(tops[best] + 1 - slope[best] / bend[best])


def _at(signal: FloatArray, start: float, step: float, count: int) -> FloatArray:
    """Evaluate a periodic band-limited signal at `start + k * step` (samples), k < count.

    Its Fourier series is summed by Bluestein's convolution (IEEE Trans. Audio Electroacoust. 18,
    1970, p. 451), with n k = (n^2 + k^2 - (k - n)^2) / 2.
    """
    samples = len(signal)
    lines = samples // 2 + 1
    X = np.fft.rfft(signal) * np.exp(2j * np.pi * start / samples * np.arange(lines))
    X[1 : (samples + 1) // 2] *= 2
    turn = np.pi * step / samples
    n = np.arange(max(lines, count), dtype=np.float64)
    chirp = np.exp(1j * np.remainder(turn * n**2, 2 * np.pi))
    length = fast_length(lines + count - 1)
    kernel = np.zeros(length, dtype=np.complex128)
    kernel[:count] = np.conj(chirp[:count])
    kernel[length - lines + 1 :] = np.conj(chirp[1:lines][::-1])
    summed = np.fft.ifft(np.fft.fft(X * chirp[:lines], length) * np.fft.fft(kernel))[:count]
    return np.asarray((chirp[:count] * summed).real / samples)
