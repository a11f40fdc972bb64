"""Steady tones of the background, such as mains hum and a fan: found while a surface rests, and taken out.

Each record begins with a rest, in which nothing is driven; a tone goes on from there with the same amplitude
and phase. Frequencies are found in the rests of all records together; amplitude and phase are each record's
own, so that what is left of a tone (an error of its fit, or a tone that is not steady) differs from record
to record as other noise does. That needs rests of unequal lengths: between evenly spaced plays a tone
advances by the same phase each time, and products of different plays then keep part of its power.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np
import scipy

from ..instruments.arrays import ComplexArray, FloatArray

__all__ = ["rests", "tones_in", "tones_of"]

_SHORTEST, _LONGEST = 0.25, 0.5
"""Length of a rest (s). The shortest tells 50 from 60 Hz; between both, a tone of 20 Hz turns five times."""
_EDGE = 0.03
"""Time (s) at a rest's beginning that is left out: there the record was faded in."""
_CLEAR = 12.0
"""Power of a tone over that of its surroundings: noise does not reach it in ten thousand checks."""
_AROUND_HZ = 60.0
"""Width (Hz) over whose lines the surroundings' median power is taken."""
_LOWEST_HZ = 15.0
_PADDED = 8
"""Lines of the spectrum for each that a rest resolves."""
_APART = 1.5
"""Smallest distance of two tones, in lines that a rest resolves."""
_MOST = 24
"""Largest number of tones."""
_STEPS = 4
"""Refinements of the frequencies."""


def rests(plays: int, rate_hz: float, multiple: int, seed: bytes) -> list[int]:
    """Samples of rest before each play, a multiple of `multiple`: at random, for no tone to be in step with.

    The same `seed` gives the same rests.
    """
    drawn = np.random.default_rng([zlib.crc32(seed), plays]).uniform(_SHORTEST, _LONGEST, plays)
    return [multiple * round(seconds * rate_hz / multiple) for seconds in drawn]


def tones_in(records: Sequence[FloatArray], rate_hz: float) -> FloatArray:
    """Frequencies (tones,) Hz, rising, of the steady tones in records of rest, each (samples,)."""
    resting = [_still(record[round(_EDGE * rate_hz) :]) for record in records]
    shortest = min(map(len, resting))
    lines = scipy.fft.next_fast_len(_PADDED * max(map(len, resting)), real=True)
    power = np.mean([np.abs(_spectrum(record, lines)) ** 2 / len(record) for record in resting], axis=0)
    f = scipy.fft.rfftfreq(lines, 1 / rate_hz)
    near = round(_AROUND_HZ / f[1])
    floor = scipy.ndimage.median_filter(power, near, mode="nearest") if near > 1 else power
    clear = np.where((f >= _LOWEST_HZ) & (f < 0.45 * rate_hz), power / np.maximum(floor, 1e-300), 0.0)
    reach = round(_APART * rate_hz / shortest / f[1])
    found: list[float] = []
    while len(found) < _MOST and clear.max() > _CLEAR:
        peak = int(clear.argmax())
        found.append(float(f[peak]))
        clear[max(0, peak - 2 * reach) : peak + 2 * reach] = 0.0
    tones = np.sort(np.array(found))
    for _ in range(_STEPS if len(tones) else 0):
        tones = tones + np.clip(_refined(tones, resting, rate_hz), -f[1], f[1])
    return tones


def tones_of(record: FloatArray, rest: int, tones: FloatArray, rate_hz: float) -> FloatArray:
    """(tones, samples): each tone over a record (samples,), fitted to the `rest` that it begins with."""
    first = round(_EDGE * rate_hz)
    basis = _basis(tones, _times(first, rest, rate_hz))
    parts = np.linalg.lstsq(basis, record[first:rest], rcond=None)[0][: 2 * len(tones)]
    whole = _basis(tones, _times(0, len(record), rate_hz))[:, : 2 * len(tones)] * parts
    return np.asarray(whole[:, : len(tones)].T + whole[:, len(tones) :].T)


def _basis(tones: FloatArray, times: FloatArray) -> FloatArray:
    """(times, 2 tones + 1): cosines, sines, and a constant."""
    turns = 2 * np.pi * np.outer(times, tones)
    return np.concatenate([np.cos(turns), np.sin(turns), np.ones((len(times), 1))], axis=1)


def _refined(tones: FloatArray, records: Sequence[FloatArray], rate_hz: float) -> FloatArray:
    """Change (tones,) of the frequencies that lessens what all records leave: a Gauss-Newton step."""
    count = len(tones)
    normal, slope = np.zeros((count, count)), np.zeros(count)
    for record in records:
        times = _times(0, len(record), rate_hz) - len(record) / 2 / rate_hz
        basis = _basis(tones, times)
        q, upper = np.linalg.qr(basis)
        parts = scipy.linalg.solve_triangular(upper, q.T @ record)
        left = record - q @ (q.T @ record)
        cosine, sine = basis[:, :count], basis[:, count : 2 * count]
        moved = 2 * np.pi * times[:, None] * (cosine * parts[count : 2 * count] - sine * parts[:count])
        moved -= q @ (q.T @ moved)
        normal += moved.T @ moved
        slope += moved.T @ left
    ridge = 1e-9 * max(float(np.trace(normal)) / count, 1e-300)
    return np.asarray(np.linalg.solve(normal + ridge * np.eye(count), slope))


def _times(first: int, end: int, rate_hz: float) -> FloatArray:
    return np.asarray(np.arange(first, end) / rate_hz)


def _still(record: FloatArray) -> FloatArray:
    return np.asarray(record - record.mean())


def _spectrum(record: FloatArray, lines: int) -> ComplexArray:
    return np.asarray(scipy.fft.rfft(record * np.hanning(len(record)), lines))
