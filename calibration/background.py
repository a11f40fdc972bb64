"""Steady tones of the background, such as mains hum and a fan: found while a surface rests, and taken out.

A record has rests, in which nothing is driven; between them a tone keeps its amplitude and phase. Frequencies
are found in the rests of all records together; amplitude and phase are each record's own, so that what is
left of a tone (an error of its fit, or a tone that is not steady) differs from record to record as other
noise does. That needs rests of unequal lengths: between evenly spaced plays a tone advances by the same phase
each time, and products of different plays then keep part of its power.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from ..base.arrays import BoolArray, ComplexArray, FloatArray
from ..base.errors import DataError
from ..base.filters import fast_length, resample_poly

_SHORTEST, LONGEST_REST = 0.25, 0.5
"""Length of a rest (s). The shortest tells 50 from 60 Hz; between both, a tone of 20 Hz turns five times."""
_CHANCE, _ROOM = 1e-9, 1.5
"""Probability that a line of white noise counts as a tone, and room for noise that is not white."""
_AROUND_HZ = 60.0
"""Width (Hz) over whose lines the surroundings' median power is taken."""
_LOWEST_HZ, _HIGHEST = 15.0, 0.4
"""Lowest frequency (Hz) of a tone, and the highest over the sample rate."""
_PADDED = 8
"""Lines of the spectrum for each that a rest resolves."""
_APART = 1.5
"""Smallest distance of two tones, in lines that a rest resolves."""
_MOST = 24
"""Largest number of tones."""
_ROUNDS, _SIDE_LOBES = 4, 3e-3
"""Rounds of a search, and the power of a Hann window's side lobes, over a tone's, with room."""
_STEPS = 4
"""Refinements of the frequencies."""
_ENOUGH_HZ = 2500.0
"""Sample rate (Hz) at which the tones of a long record are looked for."""
_STEADY = 0.3
"""Power by which a tone in one rest may differ from that in all rests of a record, over its power."""


def rests(plays: int, rate_hz: float, multiple: int, names: Sequence[str]) -> list[int]:
    """Samples of rest before each play, a multiple of `multiple`: at random, for no tone to be in step with.

    The same `names` give the same rests. A seed made of what is played would change with the last bit of a
    Fourier transform, and so would every number of a simulated run.
    """
    seed = [zlib.crc32("\n".join(names).encode()), plays]
    drawn = np.random.default_rng(seed).uniform(_SHORTEST, LONGEST_REST, plays)
    return [multiple * round(seconds * rate_hz / multiple) for seconds in drawn]


@dataclass(frozen=True, eq=False)
class Record:
    """A signal (samples,), and its parts in which nothing was driven."""

    signal: FloatArray
    rests: tuple[slice, ...]


def tones_in(records: Sequence[Record], rate_hz: float) -> FloatArray:
    """Frequencies (tones,) Hz, rising, of the steady tones in the rests of records."""
    # Each rest by itself, and then all of a record together: the time between them tells a frequency finely.
    alone = [(_times(rest, rate_hz), record.signal[rest]) for record in records for rest in record.rests]
    if not all(np.all(np.isfinite(values)) for _, values in alone):
        return np.zeros(0)
    width = rate_hz / min(len(values) for _, values in alone)
    tones = np.zeros(0)
    for _ in range(_ROUNDS):
        peaks = _peaks([_left(tones, *rest) for rest in alone], tones, width, rate_hz)[: _MOST - len(tones)]
        if not len(peaks):
            break
        tones = np.sort(np.concatenate([tones, peaks]))
        for _ in range(_STEPS):
            tones = tones + np.clip(_refined(tones, alone), -width / 4, width / 4)
    if len(tones) and len(records[0].rests) > 1:
        together = [_joined(record, rate_hz) for record in records]
        for _ in range(_STEPS):
            tones = tones + np.clip(_refined(tones, together), -width / 4, width / 4)
    return tones


def _peaks(rests: Sequence[FloatArray], known: FloatArray, width: float, rate_hz: float) -> FloatArray:
    """Frequencies (Hz) at which the power of rests stands out, the strongest first, away from `known` ones.

    Weaker ones by more than a window's side lobes are left for when the strong ones are taken out.
    """
    lines = fast_length(_PADDED * max(map(len, rests)))
    power = np.mean([np.abs(_spectrum(rest, lines)) ** 2 / len(rest) for rest in rests], axis=0)
    f = np.fft.rfftfreq(lines, 1 / rate_hz)
    floor = scipy.ndimage.median_filter(power, max(3, round(_AROUND_HZ / f[1])), mode="nearest")
    heard = (f >= _LOWEST_HZ) & (f < _HIGHEST * rate_hz)
    heard &= np.all(np.abs(f - known[:, None]) > _APART * width, axis=0)
    clear = np.where(heard, power / np.maximum(floor, 1e-300), 0.0)
    # The mean power of some rests of noise has a gamma distribution.
    chance, median = scipy.special.gammaincinv(len(rests), [1 - _CHANCE, 0.5])
    least = _ROOM * chance / median
    weakest = _SIDE_LOBES * float(power[clear > least].max(initial=0.0))
    found: list[float] = []
    while clear.max(initial=0.0) > least:
        peak = int(clear.argmax())
        if power[peak] > weakest:
            found.append(float(f[peak]))
        clear[np.abs(f - f[peak]) < 2 * _APART * width] = 0.0
    return np.array(found)


def _left(tones: FloatArray, times: FloatArray, values: FloatArray) -> FloatArray:
    """What tones, fitted to values at `times` (s), leave of them; at least their mean is taken out."""
    basis = _basis(tones, times)
    return np.asarray(values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0])


def steady(records: Sequence[Record], tones: FloatArray, rate_hz: float) -> BoolArray:
    """(tones,) True for those that keep amplitude and phase from one rest of a record to the next."""
    whole = np.array([tones_of(record, tones, rate_hz) for record in records])
    size = (np.abs(whole) ** 2).sum(axis=0)
    kept = np.ones(len(tones), dtype=np.bool_)
    for number in range(len(records[0].rests)):
        alone = [Record(record.signal, (record.rests[number],)) for record in records]
        apart = np.array([tones_of(record, tones, rate_hz) for record in alone]) - whole
        kept &= (np.abs(apart) ** 2).sum(axis=0) < _STEADY * size
    return kept


def tones_of(record: Record, tones: FloatArray, rate_hz: float) -> ComplexArray:
    """(tones,) amplitudes, with the phases at the record's first sample, fitted to the record's rests."""
    times, values = _joined(record, rate_hz)
    parts = np.linalg.lstsq(_basis(tones, times), values, rcond=None)[0]
    return np.asarray(parts[: len(tones)] - 1j * parts[len(tones) : 2 * len(tones)])


def heard(amplitudes: ComplexArray, tones: FloatArray, times: FloatArray) -> FloatArray:
    """(tones, times): each tone at `times` (s) from the record's first sample."""
    return np.asarray((amplitudes[:, None] * np.exp(2j * np.pi * np.outer(tones, times))).real)


@dataclass(frozen=True, eq=False)
class Tones:
    """Tones of a measurement's background: (tones,) Hz, rising, and each one's rms over the motion's."""

    steady: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Those that keep their phase from rest to rest, and were taken out."""
    steady_share: FloatArray = field(default_factory=lambda: np.zeros(0))
    unsteady: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Those that do not: a machine that starts, stops or wanders, or what still rings. They stay in."""
    unsteady_share: FloatArray = field(default_factory=lambda: np.zeros(0))

    def refuse_nonsense(self) -> None:
        """See `hdf5.restore`. Raises DataError for frequencies that are no row of finite values."""
        for hz, share in ((self.steady, self.steady_share), (self.unsteady, self.unsteady_share)):
            if hz.ndim != 1 or hz.shape != share.shape or not np.all(np.isfinite([hz, share])):
                raise DataError("the tones of the background are not rows of finite values.")


def without_tones(records: Sequence[Record], rate_hz: float) -> tuple[list[FloatArray], Tones]:
    """Each record's signal (samples,), all of equal length, without tones that are steady from rest to rest.

    The records' own signals where there is no such tone: they are tens of megabytes.
    """
    signals = [record.signal for record in records]
    factor = max(1, int(rate_hz // _ENOUGH_HZ))
    slow = [
        Record(
            resample_poly(record.signal, 1, factor),
            tuple(slice(-(-rest.start // factor), rest.stop // factor) for rest in record.rests),
        )
        for record in records
    ]
    tones = tones_in(slow, rate_hz / factor)
    if not len(tones):
        return signals, Tones()
    kept = steady(slow, tones, rate_hz / factor)
    amplitudes = np.array([tones_of(record, tones, rate_hz / factor) for record in slow])
    times = np.arange(len(signals[0])) / rate_hz
    for number, own in enumerate(amplitudes):
        for tone, amplitude in zip(tones[kept], own[kept], strict=True):
            signals[number] = signals[number] - (amplitude * np.exp(2j * np.pi * tone * times)).real
    share = np.sqrt((np.abs(amplitudes) ** 2).mean(axis=0) / 2 / max(float(signals[0].var()), 1e-300))
    return signals, Tones(tones[kept], share[kept], tones[~kept], share[~kept])


def _joined(record: Record, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Times (s) and values of all rests of a record."""
    times = np.concatenate([_times(rest, rate_hz) for rest in record.rests])
    return times, np.concatenate([record.signal[rest] for rest in record.rests])


def _basis(tones: FloatArray, times: FloatArray) -> FloatArray:
    """(times, 2 tones + 1): cosines, sines, and a constant."""
    turns = 2 * np.pi * np.outer(times, tones)
    return np.concatenate([np.cos(turns), np.sin(turns), np.ones((len(times), 1))], axis=1)


def _refined(tones: FloatArray, rests: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Change (tones,) of the frequencies that lessens what is left of all rests: a Gauss-Newton step."""
    count = len(tones)
    normal, slope = np.zeros((count, count)), np.zeros(count)
    for times, values in rests:
        since = times - times.mean()
        basis = _basis(tones, since)
        q, upper = np.linalg.qr(basis)
        parts = scipy.linalg.solve_triangular(upper, q.T @ values)
        left = values - q @ (q.T @ values)
        cosine, sine = basis[:, :count], basis[:, count : 2 * count]
        moved = 2 * np.pi * since[:, None] * (cosine * parts[count : 2 * count] - sine * parts[:count])
        moved -= q @ (q.T @ moved)
        normal += moved.T @ moved
        slope += moved.T @ left
    ridge = 1e-9 * max(float(np.trace(normal)) / count, 1e-300)
    return np.asarray(np.linalg.solve(normal + ridge * np.eye(count), slope))


def _times(rest: slice, rate_hz: float) -> FloatArray:
    return np.asarray(np.arange(rest.start, rest.stop) / rate_hz)


def _spectrum(rest: FloatArray, lines: int) -> ComplexArray:
    return np.asarray(np.fft.rfft(rest * np.hanning(len(rest)), lines))
