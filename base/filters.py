"""Convolution, correlation, envelope, resampling, peaks, a recursion, and filters without phase.

scipy.signal has them, too, and loads scipy.stats with all that this needs: 0.5 s in a command of two. These
give the same numbers (`tests/base/test_filters.py` compares them) from what is loaded anyway. What runs for
long, or seldom, takes scipy.signal's.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import gcd

import numpy as np

from .arrays import ComplexArray, FloatArray
from .parts import PART


def fast_length(least: int) -> int:
    """The shortest length from `least` with no prime factor but 2, 3 and 5: quick to transform."""
    shortest = 1 << max(least - 1, 0).bit_length()
    fives = 1
    while fives < shortest:
        odd = fives
        while odd < shortest:
            shortest = min(shortest, odd << max(-(-least // odd) - 1, 0).bit_length())
            odd *= 3
        fives *= 5
    return shortest


def first_order_low_pass(frequencies: FloatArray, corner_hz: float) -> ComplexArray:
    """Response of one real pole at `corner_hz` to `frequencies` (Hz), unity at 0 Hz."""
    return np.asarray(1.0 / (1.0 + 1j * frequencies / corner_hz), dtype=np.complex128)


def first_order_high_pass(frequencies: FloatArray, corner_hz: float) -> ComplexArray:
    """Response of one high-pass at `corner_hz` to `frequencies` (Hz), 0 at 0 Hz."""
    return np.asarray(1.0 - first_order_low_pass(frequencies, corner_hz))


def convolve(signal: FloatArray, kernel: FloatArray) -> FloatArray:
    """Convolution of (samples,) with (taps,): all samples + taps - 1 values."""
    count = len(signal) + len(kernel) - 1
    size = fast_length(count)
    both = np.fft.rfft(signal, size) * np.fft.rfft(kernel, size)
    return np.asarray(np.fft.irfft(both, size)[:count])


def correlate(signal: FloatArray, wanted: FloatArray) -> FloatArray:
    """Correlation of (samples,) with (wanted,): value k is of `wanted` from sample k - len(wanted) + 1 on."""
    return convolve(signal, wanted[::-1])


def correlate_within(signal: FloatArray, wanted: FloatArray) -> FloatArray:
    """Correlation of (samples,) with (wanted,) where it lies within: value k is that from sample k on."""
    return correlate(signal, wanted)[len(wanted) - 1 : len(signal)]


def envelope(signal: FloatArray) -> FloatArray:
    """Envelope (samples,) of a signal: the magnitude of its analytic signal."""
    return np.asarray(np.abs(analytic(signal)))


def analytic(signal: FloatArray) -> ComplexArray:
    """(samples,) of the signal without its negative frequencies, whose real part is the signal."""
    count = len(signal)
    spectrum = np.fft.fft(signal)
    spectrum[1 : (count + 1) // 2] *= 2
    spectrum[count // 2 + 1 :] = 0
    return np.asarray(np.fft.ifft(spectrum))


def resample_poly(signal: FloatArray, up: int, down: int) -> FloatArray:
    """(samples,) at up/down times the rate, behind a low-pass of linear phase without delay.

    The filter is a sinc of 20 periods of the lower rate within a Kaiser window (beta 5). Outside, the signal
    is zero.
    """
    up, down = up // gcd(up, down), down // gcd(up, down)
    if up == down:
        return np.array(signal)
    slower = max(up, down)
    half = 10 * slower
    taps = np.sinc(np.arange(-half, half + 1) / slower) * np.kaiser(2 * half + 1, 5.0)
    taps *= up / taps.sum()
    out = np.empty(-(-len(signal) * up // down))
    # Each phase takes every up-th tap, and every down-th sample.
    longest = -(-len(taps) // up)
    padded = np.pad(np.asarray(signal, np.float64), longest + slower)
    for phase in range(min(up, len(out))):
        middle = phase * down + half  # where the output stands among the taps, on the clock of both rates
        own = taps[middle % up :: up][::-1]
        windows = np.lib.stride_tricks.sliding_window_view(padded, len(own))
        first = middle // up - len(own) + 1 + longest + slower
        count = len(range(phase, len(out), up))
        out[phase::up] = windows[first::down][:count] @ own
    return out


def without_phase(
    signal: FloatArray,
    rate_hz: float,
    gain: Callable[[FloatArray], FloatArray],
    turned: float,
    dies_out: float,
) -> FloatArray:
    """Filter (..., samples) by a real gain over frequencies (Hz) whose response `dies_out` within seconds.

    Both ends are continued for `turned` seconds (for the signal's own length at most), turned about their
    last sample, and then held, so that the filter sees no edge. It is computed in parts, in the memory of two
    signals more.
    """
    samples, margin = signal.shape[-1], int(np.ceil(dies_out * rate_hz))
    around = min(samples - 1, int(np.ceil(turned * rate_hz)))
    beside = [(0, 0)] * (signal.ndim - 1)
    long = np.pad(signal, [*beside, (around, around)], mode="reflect", reflect_type="odd")
    long = np.pad(long, [*beside, (margin, margin)], mode="edge")
    size = fast_length(min(samples, max(PART, margin)) + 2 * margin)
    gains = gain(np.asarray(np.fft.rfftfreq(size, 1 / rate_hz)))
    found = np.empty(signal.shape)
    # Part by part; what lies beyond a margin before and after a part is not seen in it.
    for first in range(0, samples, size - 2 * margin):
        piece = long[..., around + first : around + first + size]
        filtered = np.fft.irfft(np.fft.rfft(piece, size) * gains, size)
        part = found[..., first : first + size - 2 * margin]
        part[...] = filtered[..., margin : margin + part.shape[-1]]
    return found


_BLOCK = 64
"""Samples of a recursion that are computed at once."""


def recursion(values: FloatArray, last: float, before: float, found: FloatArray) -> FloatArray:
    """(samples,) y with y[k] = values[k] - last * y[k-1] - before * y[k-2], from the two of `found` on.

    Within a block it is the impulse response, as a matrix; from block to block go the last two values.
    """
    within, carries = _responses(last, before)
    rows = np.pad(values, (0, -len(values) % _BLOCK)).reshape(-1, _BLOCK)
    made = rows @ within
    two, one = map(float, found)
    (h2, h1), (h3, _) = carries[:, -2:].tolist()
    carried = []  # what the two values before a block do as inputs of its first two samples
    for next_two, next_one in made[:, -2:].tolist():
        first, second = -last * one - before * two, -before * one
        carried.append((first, second))
        two, one = next_two + first * h2 + second * h3, next_one + first * h1 + second * h2
    made += np.array(carried).reshape(-1, 2) @ carries
    return np.asarray(made.ravel()[: len(values)])


@cache
def _responses(last: float, before: float) -> tuple[FloatArray, FloatArray]:
    """(inputs, outputs) of a block, and (2, outputs) of its first two inputs alone."""
    response = [1.0, -last]
    while len(response) < _BLOCK:
        response.append(-last * response[-1] - before * response[-2])
    causal = np.concatenate([np.zeros(_BLOCK - 1), response])
    within = np.lib.stride_tricks.sliding_window_view(causal, _BLOCK)[::-1].copy()
    return within, within[:2]


def peaks(values: FloatArray, prominence: float) -> list[int]:
    """Indices of the maxima of (values,) that stand out by `prominence` at least: see `_saddles`."""
    rising = np.diff(values) > 0
    tops = np.flatnonzero(rising[:-1] & ~rising[1:]) + 1
    return [top for top in tops.tolist() if values[top] - max(_saddles(values, top)) >= prominence]


def half_width(values: FloatArray, top: int) -> float:
    """Width (samples) of a maximum of (values,) half way down to the higher of its saddles."""
    level = (values[top] + max(_saddles(values, top))) / 2
    return sum(_steps_down(side, level) for side in (values[top::-1], values[top:]))


def _saddles(values: FloatArray, top: int) -> tuple[float, float]:
    """The least values on either side of a maximum, up to where the values exceed it."""
    left, right = (_until_above(side) for side in (values[top::-1], values[top:]))
    return float(left.min()), float(right.min())


def _until_above(side: FloatArray) -> FloatArray:
    above = side > side[0]
    return side[: int(above.argmax())] if above.any() else side


def _steps_down(side: FloatArray, level: float) -> float:
    """Steps from the first of (values,) to where they cross a level, interpolated."""
    below = int((side <= level).argmax())
    return below - float((level - side[below]) / (side[below - 1] - side[below]))
