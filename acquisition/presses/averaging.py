"""Average many curves at two levels, participant and all, by a named method or by the better of two.

"barycentre" is the paper's: the dynamic time warping barycentre (Petitjean et al., Pattern Recognition
44(3), 2011) per participant, and of these. It matches the samples of two presses under any local stretch,
but its mean warp is not zero, which shifts events in time. "registration" (`registration.py`) starts from
the DTW paths and fits smooth warps: better when presses differ in tempo. "mean" averages as the presses
come. "automatic" compares the registration with a barycentre that has been brought to the presses' mean
time, which is better where events that overlap jitter independently.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Literal, get_args

import numpy as np
import scipy
from threadpoolctl import threadpool_limits

from ...base.arrays import BoolArray, FloatArray, IntArray
from ...base.errors import ConfigurationError
from ...base.filters import fast_length
from ...base.progress import Progress, silent
from .barycentre import WarpingPath, alike, along, barycentre, centred, lags_along, read_at
from .registration import WarpModel, leads, register
from .spline_rows import moved
from .spool import Spool

AverageMethod = Literal["automatic", "barycentre", "registration", "mean"]
BARYCENTRE, REGISTRATION, MEAN = "two-level barycentre", "two-level registration", "two-level mean"
CENTRED = "two-level barycentre, centred in time"
_DOING = "Average the presses"
_LATE = 0.1
"""Weight of the error that is due to an event's time. Lags of short segments are uncertain, so that at full
weight they would decide between methods whose times are both right. Of 0 to 1, this had the least regret on
64 sets of presses of `unseen` in `benchmarks/representative.py`."""


@dataclass(frozen=True, eq=False)
class Average:
    """Average curve of all presses."""

    method: str
    reason: str
    """Reason for the method, as a clause."""
    template: FloatArray
    """(channels, samples)."""
    members: int
    """Presses that were used."""
    spread: FloatArray
    """(samples,): standard deviation of the first channel of the presses, warped to the template's time."""
    kept: tuple[BoolArray, ...]
    """(presses,) for each participant: True when the press resembles the others and was used. A participant
    who is unlike the others has no True."""
    scores: Mapping[str, float]
    """Score of each method that was compared, see `average`."""
    leads: Mapping[str, FloatArray]
    """(samples,): first channel of the template of each method that was computed."""


def average(
    groups: Sequence[FloatArray],
    rate_hz: float,
    model: WarpModel | None = None,
    method: AverageMethod = "automatic",
    progress: Progress = silent,
) -> Average:
    """Average all presses at two levels; `groups` holds (presses, channels, samples) for each participant.

    Alignment uses the first channel; the other channels get the same warps. A participant with four or
    more presses has those left out that are unlike the others, and so are participants, of four or more,
    whose barycentre is unlike the others', were all as loud. One participant's presses are in memory at a
    time, and of each participant a template. `progress` is called as participants are aligned, and as
    templates are made. Raises ConfigurationError for an unknown method, DataError when
    the disk for temporary files is full.

    "automatic" scores each template on held-out presses: each press is compared with the template computed
    without that press, its alignment kept. Segments of two thirds of `WarpModel.reach` of
    a press are matched to the template, and segments of the template to the press, each at its best lag
    within `reach`; the score is the root of the residual power of all segments, relative to the presses. It
    penalises blur, missing or spurious events, and copied noise; and, at a tenth of its weight, the error of
    a template whose segments come early or late on the mean of the presses. It favours neither method's
    warps: segments are shifted, and never stretched. Of two presses it registers: without one of them the
    other is the template.
    """
    if method not in get_args(AverageMethod):
        names = ", ".join(get_args(AverageMethod))
        raise ConfigurationError(f"There is no method {method!r} for a representative press: use {names}.")
    m = model or WarpModel()
    window = m.window(rate_hz)
    # The paper compares every sample.
    every = 1 if method == "barycentre" else m.every(rate_hz)
    registering = method in ("automatic", "registration")
    steps = len(groups) + 3
    # Threads cost more than they gain on matrices this small when the machine is busy.
    with threadpool_limits(1):
        masks, centres, means, each = [], Spool(), Spool(), Spool()
        warped = _Warped(Spool(), Spool(), Spool())
        for number, group in enumerate(groups):
            progress(_DOING, number, steps, "")
            mask, centre, paths = alike(group[:, 0], window, every)
            masks.append(mask)
            centres.append(centre[None])
            if method in ("automatic", "barycentre"):
                warped.append(group[mask], paths)
            if registering:
                one = register(group[mask], rate_hz, m, (centre, paths))
                means.append(one.template)
                each.append(np.concatenate(one.aligned))
        progress(_DOING, len(groups), steps, "")
        trusted, centre, paths = alike(leads(centres), window, every)
        masks = [mask & like for mask, like in zip(masks, trusted, strict=True)]
        means, each = _those(means, trusted), _those(each, trusted)
        warped = _Warped(*(_those(one, trusted) for one in (warped.means, warped.each, warped.lags)))
        own = _Kept(groups, masks)
        single = own.members == 1
        made: dict[str, _Template] = {}
        if method == "mean" or single:
            made[MEAN] = _mean(own)
        if method == "barycentre" and not single:
            made[BARYCENTRE] = _barycentre(warped, centre, paths, rate_hz, in_time=False)
        if registering and not single:
            made[REGISTRATION] = _registration(means, each, rate_hz, m)
        progress(_DOING, len(groups) + 1, steps, "")
        if method == "automatic" and own.members > 2:
            made[CENTRED] = _barycentre(warped, centre, paths, rate_hz, in_time=True)
        progress(_DOING, len(groups) + 2, steps, "")
        scores = {name: _score(one, own, window) for name, one in made.items() if len(made) > 1}
    progress(_DOING, steps, steps, "")
    name = min(scores, key=scores.__getitem__) if scores else next(iter(made))
    template, aligned = made[name].curves, made[name].aligned
    first = {each: one.curves[0] for each, one in made.items()}
    return Average(
        name,
        _reason(method, own.members, scores),
        template,
        own.members,
        _deviation(aligned),
        tuple(own.masks),
        scores,
        first,
    )


def _reason(method: AverageMethod, members: int, scores: Mapping[str, float]) -> str:
    if scores:
        return "its error on held-out presses is smaller"
    if members == 1:
        return "a single press stands for itself"
    return "two presses cannot tell which method is better" if method == "automatic" else "asked for by name"


@dataclass(frozen=True, eq=False)
class _Kept:
    """The presses of each participant that are used (presses, channels, samples), read when needed."""

    groups: Sequence[FloatArray]
    masks: Sequence[BoolArray]

    def __iter__(self) -> Iterator[FloatArray]:
        return (group[mask] for group, mask in zip(self.groups, self.masks, strict=True) if mask.any())

    @property
    def participants(self) -> int:
        return sum(bool(mask.any()) for mask in self.masks)

    @property
    def members(self) -> int:
        return sum(int(np.sum(mask)) for mask in self.masks)


@dataclass(frozen=True, eq=False)
class _Template:
    """Template (channels, samples), and each participant's presses in its time: their first channel, each
    (presses, samples).
    """

    curves: FloatArray
    aligned: Sequence[FloatArray]


def _mean(own: _Kept) -> _Template:
    means, aligned = [], Spool()
    for curves in own:
        means.append(curves.mean(axis=0))
        aligned.append(curves[:, 0])
    return _Template(np.mean(means, axis=0), aligned)


def _those(spool: Spool, which: BoolArray) -> Spool:
    """The arrays of a spool that are meant by (arrays,)."""
    if which.all() or not len(spool):
        return spool
    some = Spool()
    for number in np.flatnonzero(which):
        some.append(spool[int(number)])
    return some


def _registration(
    means: Sequence[FloatArray], each: Iterable[FloatArray], rate_hz: float, m: WarpModel
) -> _Template:
    """Register the participants' templates (channels, samples), and with them their presses."""
    whole = register(means, rate_hz, m, barycentre(leads(means), m.window(rate_hz), m.every(rate_hz)))
    aligned = Spool()
    # The participant's warp is applied after each press's own warp.
    for rows, shift in zip(each, chain.from_iterable(whole.shifts), strict=True):
        aligned.append(moved(rows, np.tile(shift, (len(rows), 1))))
    return _Template(whole.template, aligned)


@dataclass(frozen=True, eq=False)
class _Warped:
    """Presses of participants, each along its DTW path to the barycentre of its participant."""

    means: Spool
    """Each (channels, samples)."""
    each: Spool
    """Each (presses, samples): their first channel."""
    lags: Spool
    """Each (samples,), in samples: how late the presses are, in sum."""

    def append(self, curves: FloatArray, paths: Sequence[WarpingPath]) -> None:
        warped = along(curves, paths)
        self.means.append(warped.mean(axis=0))
        self.each.append(warped[:, 0])
        self.lags.append(np.sum([lags_along(path, curves.shape[-1]) for path in paths], axis=0))


def _barycentre(
    warped: _Warped, centre: FloatArray, paths: Sequence[WarpingPath], rate_hz: float, *, in_time: bool
) -> _Template:
    """The paper's average, of which the first channel is the `centre`: a participant's path to it is followed
    after each press's own.

    `in_time` brings it to the mean time of the presses.
    """
    template, lag, members, aligned = np.zeros_like(warped.means[0]), np.zeros(len(centre)), 0, Spool()
    for mean, rows, lags, path in zip(warped.means, warped.each, warped.lags, paths, strict=True):
        template += along(mean[None], [path])[0] / len(paths)
        aligned.append(along(rows[None], [path])[0])
        lag += along(lags[None, None], [path])[0, 0] + len(rows) * lags_along(path, len(centre))
        members += len(rows)
    template[0] = centre
    if not in_time:
        return _Template(template, aligned)
    places, timed = centred(centre, lag / members, rate_hz), Spool()
    for rows in aligned:
        timed.append(read_at(rows, places))
    return _Template(read_at(template, places), timed)


def _deviation(aligned: Sequence[FloatArray]) -> FloatArray:
    """Standard deviation (samples,) of all rows of these arrays, 0 of one."""
    count = sum(len(rows) for rows in aligned)
    mean = sum(rows.sum(axis=0) for rows in aligned) / count
    squares = sum(np.sum((rows - mean) ** 2, axis=0) for rows in aligned)
    return np.asarray(np.sqrt(squares / max(count - 1, 1)))


def _score(template: _Template, own: _Kept, reach: int) -> float:
    """Score a template on held-out presses, see `average`."""
    count, lead = own.members, template.curves[0]
    length = max(4, 2 * reach // 3)
    taper = np.hanning(length + 2)[1:-1] ** 2
    starts = np.arange(0, len(lead) - length + 1, length // 2)
    trusts, lags = np.zeros((2, len(starts)))
    left = power = 0.0
    for curves, aligned in zip(own, template.aligned, strict=True):
        # A press's share: participants count alike, however many presses they have.
        shares = own.participants * len(curves)
        presses, without = curves[:, 0], (shares * lead - aligned) / (shares - 1)
        unlike = _misfits(presses, without, starts, taper, reach)
        missing = _misfits(without, presses, starts, taper, reach)
        least = missing.min(axis=2)
        there = _pieces(without, starts, length) ** 2 @ taper
        # Silence is found everywhere, and says nothing of time.
        trust = np.where(there > 0, np.maximum(1 - least / np.maximum(there, 1e-300), 0.0), 0.0)
        trusts += trust.sum(axis=0)
        lags += np.sum(trust * (np.argmin(missing, axis=2) - reach), axis=0)
        left += float(np.sum(unlike.min(axis=2)) + np.sum(least))
        power += 2 * float(np.sum(_pieces(presses, starts, length) ** 2 @ taper))
    late = lags / np.maximum(trusts, 1e-9)
    here = starts[:, None] + np.arange(length)
    padded = np.pad(lead, reach)
    moves = np.interp(here - late[:, None] + reach, np.arange(len(padded)), padded) - lead[here]
    left += _LATE * 2 * count * float(np.sum(moves**2 @ taper))
    # Differences of large sums: rounding can leave less than nothing of a perfect match.
    return float(np.sqrt(max(left, 0.0) / max(power, 1e-300)))


def _pieces(rows: FloatArray, starts: IntArray, length: int) -> FloatArray:
    """Pieces (rows, starts, length) of rows (rows, samples)."""
    return np.asarray(np.lib.stride_tricks.sliding_window_view(rows, length, axis=-1)[:, starts])


def _misfits(
    rows: FloatArray, others: FloatArray, starts: IntArray, taper: FloatArray, reach: int
) -> FloatArray:
    """Tapered sum of squares (rows, starts, lags) between segments of rows, and others within reach."""
    length = len(taper)
    pieces, around = _pieces(rows, starts, length), np.pad(others, ((0, 0), (reach, reach)))
    # Not by FFT over the whole row: its rounding would exceed what quiet segments hold.
    there = scipy.ndimage.correlate1d(around**2, taper, axis=1)[:, length // 2 :]
    size = fast_length(length + 2 * reach)
    spectra = np.fft.rfft(_pieces(around, starts, length + 2 * reach), size)
    both = np.fft.irfft(spectra * np.conj(np.fft.rfft(pieces * taper, size)), size)[..., : 2 * reach + 1]
    return np.asarray((pieces**2 @ taper)[..., None] - 2 * both + _pieces(there, starts, 2 * reach + 1))
