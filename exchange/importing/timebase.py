"""From stamps to samples at one rate: what the stamps say, and values on an even grid.

Model: sample k was taken at t0 + k / rate; a stamp shows that instant rounded to the stamps' digits, or late
by a jitter, and where a logger lost samples a step is a whole number of steps long. The rate is the slope of
a straight line through stamps over k. Rounded stamps are no jitter: values stay as they are. Jittered stamps
are believed: values are interpolated at even instants by a cubic spline, across a gap by a straight line, and
each gap is listed. Stamps that only a computer's clock gave, of samples that a card took evenly, are the case
where this is wrong: then the rate is told, and the stamps are not looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from ...base.arrays import FloatArray
from ...base.errors import DataError

_EVEN = 0.01
"""Largest deviation of a stamp, in steps, that is none."""
_ROUNDED = 1.05
"""Range of the deviations of rounded stamps, in units of their last digit."""
_USUAL = 0.9
"""Share of equal steps beyond which another one is no rounding."""
_UNEVEN = 0.35
"""Rms jitter, in steps, beyond which there is no rate."""
_CERTAIN = 2e-3
"""Largest relative uncertainty of a rate from rounded stamps."""

_SPIKE = 5.0
"""Range of all other samples by which a spike stands out."""


@dataclass(frozen=True)
class Hole:
    """Samples on the even grid that were not measured, and are filled by a straight line."""

    first: int
    end: int
    what: str
    """The signal, or "all signals"."""


@dataclass(frozen=True, eq=False)
class TimeBase:
    """When samples were taken."""

    rate_hz: float
    said: tuple[str, ...]
    """Sentences with figures."""
    stamps: FloatArray | None = None
    """(samples,) s from the first; None where samples are even already."""
    index: FloatArray | None = None
    """(samples,) number of each sample, lost ones counted; None without a gap."""


def time_base(path: Path, stamps: FloatArray, unit: float, rate_hz: float | None = None) -> TimeBase:
    """The time base of a column of stamps in units of `unit` s; `rate_hz` is the rate that a file states.

    Raises DataError for stamps from which no rate follows.
    """
    if len(stamps) < 3:
        raise DataError(f"{path} has {len(stamps)} samples, which are no press.")
    if not np.all(np.isfinite(stamps)):
        row = int(np.argmin(np.isfinite(stamps))) + 1
        raise DataError(f"{path} has no time in sample {row}: repair it, or state the rate (--rate).")
    steps = np.diff(stamps)
    if steps.min() < 0:
        raise DataError(
            f"{path} goes back in time after sample {int(np.argmin(steps)) + 1}: import its parts one by "
            "one, or state the rate (--rate)."
        )
    digit = _last_digit(stamps)
    count = np.arange(len(stamps), dtype=np.float64)
    slope, start = _line(count, stamps)
    if not slope > 0 or not np.ptp(stamps):
        raise DataError(f"{path} has the same time in all samples: state the rate (--rate).")
    late = stamps - start - slope * count
    deviation = float(np.abs(late).max())
    if rate_hz is not None and _rounds(unit * (stamps - stamps[0]), steps.max() * unit, rate_hz):
        # Stamps of some digits, whatever their size: 4.99E-03, 5.00E-03, 5.01E-03.
        return TimeBase(rate_hz, (f"{rate_hz:g} samples/s, as stated; stamps are rounded",))
    rounded = float(np.ptp(late)) <= _ROUNDED * digit and not _lacks(steps, digit)
    if deviation <= _EVEN * slope or rounded:
        digit = digit if deviation > _EVEN * slope else 0.0
        return _even(path, stamps, slope, digit, unit, rate_hz)
    return _uneven(path, stamps, steps, unit)


def _line(count: FloatArray, stamps: FloatArray) -> tuple[float, float]:
    """Slope and start of a straight line; the fit squares stamps, and an epoch in ns has 19 digits."""
    slope, start = np.polyfit(count, stamps - stamps[0], 1)
    return float(slope), float(start + stamps[0])


def _rounds(seconds: FloatArray, longest: float, rate_hz: float) -> bool:
    """True for stamps (s, from the first) that round those of a rate, so coarsely that many are equal."""
    coarse = longest * rate_hz > 1.5 and np.count_nonzero(np.diff(seconds) == 0) > 0.1 * len(seconds)
    off = np.abs(seconds - np.arange(len(seconds)) / rate_hz).max()
    return bool(coarse and off <= 0.51 * longest < 0.01 * seconds[-1])


def _lacks(steps: FloatArray, digit: float) -> bool:
    """True for steps of which single ones are longer than nearly all others: a sample was lost there.

    A clock that is a little slower than its digits makes such steps, too, but at equal distances.
    """
    whole = np.rint(steps / digit).astype(np.int64)
    usual = int(np.median(whole))
    longer = np.flatnonzero(whole > usual)
    if usual < 1 or not len(longer) or np.mean(whole == usual) < _USUAL:
        return False
    return len(longer) < 3 or int(np.ptp(np.diff(longer))) > 2


def _even(
    path: Path, stamps: FloatArray, slope: float, digit: float, unit: float, rate_hz: float | None
) -> TimeBase:
    """Of stamps on a straight line; `digit` is what they are rounded to, 0 for what does not show."""
    uncertain = digit / (stamps[-1] - stamps[0])
    found = 1 / (slope * unit)
    if not digit:
        # A time with few digits gives a rate that is off in the last of them.
        return TimeBase(float(f"{found:.6g}"), (f"{float(f'{found:.6g}'):g} samples/s, evenly",))
    if rate_hz is not None and abs(found / rate_hz - 1) <= max(uncertain, 1e-6):
        return TimeBase(
            rate_hz, (f"{rate_hz:g} samples/s, as stated; stamps are rounded to {_s(digit * unit)}",)
        )
    if uncertain > _CERTAIN:
        raise DataError(
            f"{path} has stamps rounded to {_s(digit * unit)} over {_s((stamps[-1] - stamps[0]) * unit)}: "
            f"they tell the rate to {uncertain:.1%} only: state it (--rate)."
        )
    nearest = float(f"{found:.3g}")
    rate = nearest if abs(found / nearest - 1) < uncertain / 4 else float(f"{found:.6g}")
    return TimeBase(
        rate, (f"{rate:g} samples/s to {uncertain:.2%}, evenly: stamps are rounded to {_s(digit * unit)}",)
    )


def _uneven(path: Path, stamps: FloatArray, steps: FloatArray, unit: float) -> TimeBase:
    """Of stamps that jitter, or lack samples."""
    step = float(np.median(steps))
    if not step > 0:
        raise DataError(f"{path} has stamps too coarse or too uneven to tell a rate: state it (--rate).")
    if not steps.min() > 0:
        row = int(np.argmin(steps)) + 1
        raise DataError(
            f"{path} has the same time in samples {row} and {row + 1}: leave out what is in it twice, or "
            "state the rate (--rate)."
        )
    whole = np.maximum(np.rint(steps / step), 1.0)
    index = np.concatenate([[0.0], np.cumsum(whole)])
    if index[-1] > 10 * len(stamps):
        raise DataError(
            f"{path} lacks more samples than it has, in steps of up to {_s(steps.max() * unit)}: import its "
            "parts one by one, or state the rate (--rate)."
        )
    slope, start = _line(index, stamps)
    late = stamps - start - slope * index
    rms, most = float(np.std(late)) / slope, float(np.abs(late).max()) / slope
    gaps = np.flatnonzero(whole > 1)
    # Of a clock that drifts, neighbours are even, however far both are from a straight line.
    local = float(np.std(steps - whole * step)) / step
    if min(rms, local) > _UNEVEN or len(gaps) > 0.02 * len(stamps):
        raise DataError(
            f"{path} is not sampled at a constant rate (steps of {_s(steps.min() * unit)} to "
            f"{_s(steps.max() * unit)}): resample it first, or state the rate (--rate)."
        )
    rate = float(f"{1 / (slope * unit):.6g}")
    said = []
    if rms > _UNEVEN:
        said.append(
            f"{rate:g} samples/s on the whole, from which its clock strays by {most:.1f}; resampled evenly"
        )
    elif most > _EVEN:
        said.append(
            f"{rate:g} samples/s with a jitter of {_s(rms * slope * unit)} rms, {_s(most * slope * unit)} at "
            f"most ({rms:.1%} and {most:.0%} of a step); resampled evenly"
        )
    if len(gaps):
        lost = int(np.sum(whole[gaps] - 1))
        places = ", ".join(f"{unit * (stamps[g] - stamps[0]):.4g} s" for g in gaps[:3])
        more = f" and {len(gaps) - 3} more" if len(gaps) > 3 else ""
        said.append(
            f"{len(gaps)} gap{'s' * (len(gaps) > 1)} of {lost} samples ({_s(lost / rate)}), at {places}"
            f"{more}, filled by a straight line"
        )
    seconds = unit * (stamps - stamps[0]) if most > _EVEN else None
    return TimeBase(rate, tuple(said), seconds, index if len(gaps) else None)


def on_grid(base: TimeBase, values: FloatArray) -> FloatArray:
    """(samples,) on the even grid, of values at the base's stamps."""
    if base.stamps is None and base.index is None:
        return values
    at = _places(base, len(values))
    grid = np.arange(int(np.floor(at[-1])) + 1, dtype=np.float64)
    straight = np.interp(grid, at, values)
    if base.stamps is None or len(np.unique(values)) <= 2:
        return straight
    found = np.asarray(scipy.interpolate.CubicSpline(at, values)(grid))
    for hole in holes_of(base):
        found[max(0, hole.first - 1) : hole.end + 1] = straight[max(0, hole.first - 1) : hole.end + 1]
    return found


def holes_of(base: TimeBase) -> list[Hole]:
    """The gaps between stamps."""
    if base.index is None:
        return []
    before = np.flatnonzero(np.diff(base.index) > 1)
    at = np.rint(_places(base, len(base.index))).astype(np.int64)
    return [Hole(int(at[b]) + 1, int(at[b + 1]), "all signals") for b in before]


def _places(base: TimeBase, count: int) -> FloatArray:
    """(samples,) where each of `count` samples stands on the even grid."""
    if base.stamps is not None:
        return base.stamps * base.rate_hz
    return np.arange(count, dtype=np.float64) if base.index is None else base.index


def lost(base: TimeBase, damaged: Sequence[int]) -> list[Hole]:
    """The places of rows that were left out as damaged, where stamps show no gap."""
    index = np.arange(damaged[-1] + 1) if base.index is None and damaged else base.index
    places = [int(index[row - n - 1]) + 1 for n, row in enumerate(damaged) if index is not None and row > n]
    shown = holes_of(base)
    return [Hole(place, place + 1, "all signals") for place in sorted(set(places))
            if not any(hole.first - 1 <= place <= hole.end for hole in shown)]  # fmt: skip


def spikes(values: FloatArray, rate_hz: float | None, unit: str) -> str:
    """A sentence on samples that stand alone far above all others; "" without any.

    Rows of a curve have no rate.
    """
    calm = scipy.ndimage.median_filter(values, 5)
    apart = np.abs(values - calm)
    found = np.flatnonzero(apart > _SPIKE * max(float(np.ptp(calm)), 1e-12))
    if not len(found) or len(found) > 0.01 * len(values):
        return ""
    most = found[np.argmax(apart[found])]
    where = f"in row {most + 1}" if rate_hz is None else f"at {most / rate_hz:.4g} s"
    return (
        f"{len(found)} sample{'s' * (len(found) > 1)} of up to {values[most]:.4g} {unit} ({where}) "
        f"stand{'s' * (len(found) == 1)} alone, over {_SPIKE:g} times the range of all others: a spike?"
    )


def filled(values: FloatArray, what: str) -> tuple[FloatArray, list[Hole]]:
    """Values with missing ones on straight lines, and where they were missing; all of one column."""
    missing = ~np.isfinite(values)
    if not missing.any():
        return values, []
    places = np.arange(len(values))
    whole = np.interp(places, places[~missing], values[~missing])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(np.int8)))
    return whole, [Hole(int(a), int(b), what) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _last_digit(stamps: FloatArray) -> float:
    """The unit of the last decimal digit that stamps have, at most nine behind the point."""
    # Neighbours too: at equal distances a clock of few digits shows fewer still.
    some = np.concatenate([stamps[:2000], stamps[:: max(1, len(stamps) // 2000)]])
    for digits in range(-3, 10):
        scaled = some * 10.0**digits
        if np.all(np.abs(scaled - np.rint(scaled)) < 1e-6 + 1e-14 * np.abs(scaled)):
            return float(10.0**-digits)
    return 0.0


def _s(seconds: float) -> str:
    """A duration, for people."""
    for unit, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds >= factor * (1 - 1e-9):
            return f"{seconds / factor:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"
