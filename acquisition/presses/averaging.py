"""Average many curves at two levels, participant and all, by a named method or by the better of two.

"barycentre" is the paper's: the dynamic time warping barycentre (Petitjean et al., Pattern Recognition
44(3), 2011) per participant, and of these. It matches the samples of two presses under any local stretch,
but its mean warp is not zero, which shifts events in time. "registration" (`registration.py`) starts from
the DTW paths and fits smooth warps: better when presses differ in tempo. "mean" averages as the presses
come. "automatic" compares the registration with a barycentre that has been brought to the presses' mean
time, which is better where events that overlap jitter independently.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import scipy
from threadpoolctl import threadpool_limits

from haploop.acquisition.presses.barycentre import alike, along, barycentre, centred, paths_to, read_at
from haploop.acquisition.presses.registration import Rows, WarpModel, register
from haploop.instruments import ConfigurationError
from haploop.instruments.arrays import BoolArray, FloatArray

__all__ = ["BARYCENTRE", "CENTRED", "MEAN", "REGISTRATION", "Average", "AverageMethod", "average"]

AverageMethod = Literal["automatic", "barycentre", "registration", "mean"]
BARYCENTRE, REGISTRATION, MEAN = "two-level barycentre", "two-level registration", "two-level mean"
CENTRED = "two-level barycentre, centred in time"
_LATE = 0.1
"""Weight of the error that is due to an event's time. Lags of short segments are uncertain, so that at full
weight they would decide between methods whose times are both right. Of 0 to 1, this had the least regret on
the 64 sets of presses of `benchmarks/README.md`."""


@dataclass(frozen=True, eq=False)
class Average:
    """Average curve of all presses."""

    method: str
    reason: str
    """Reason for the method, as a clause."""
    template: FloatArray
    """(channels, samples)."""
    aligned: FloatArray
    """(presses, samples): first channel of each press, by participant, warped to the template's time."""
    kept: tuple[BoolArray, ...]
    """(presses,) for each participant: True when the press resembles the others and was used."""
    scores: Mapping[str, float]
    """Score of each method that was compared, see `average`."""
    leads: Mapping[str, FloatArray]
    """(samples,): first channel of the template of each method that was computed."""


def average(
    groups: Sequence[FloatArray],
    rate_hz: float,
    model: WarpModel | None = None,
    method: AverageMethod = "automatic",
) -> Average:
    """Average all presses at two levels; `groups` holds (presses, channels, samples) for each participant.

    Alignment uses the first channel; the other channels get the same warps. A participant with four or
    more presses has those left out that are unlike the others. Raises ConfigurationError for an unknown
    method.

    "automatic" scores each template on presses that it does not hold: each press is compared with the
    template less that press's own share, its alignment kept. Segments of 20 ms of a press are matched to
    the template, and segments of the template to the press, each at its best lag within
    `WarpModel.reach`; the score is the root of the residual power of all segments, relative to the
    presses. It penalises blur, missing or spurious events, and copied noise; and, at a tenth of its weight,
    the error of a template whose segments come early or late on the mean of the presses. It favours neither
    method's warps: segments are shifted, and never stretched.
    """
    if method not in get_args(AverageMethod):
        names = ", ".join(get_args(AverageMethod))
        raise ConfigurationError(f"There is no method {method!r} for a representative press: use {names}.")
    m = model or WarpModel()
    window = m.window(rate_hz)
    # Threads cost more than they gain on matrices this small when the machine is busy.
    with threadpool_limits(1):
        found = [alike(group[:, 0], window) for group in groups]
        kept = tuple(mask for mask, _ in found)
        own = [_Participant(group[mask], centre) for group, (mask, centre) in zip(groups, found, strict=True)]
        single = sum(len(one.curves) for one in own) == 1
        made: dict[str, _Template] = {}
        if method == "mean" or single:
            made[MEAN] = _mean(own)
        if method == "barycentre" and not single:
            made[BARYCENTRE] = _barycentre(own, rate_hz, window, in_time=False)
        if method in ("automatic", "registration") and not single:
            made[REGISTRATION] = _registration(own, rate_hz, m)
        if method == "automatic" and not single:
            made[CENTRED] = _barycentre(own, rate_hz, window, in_time=True)
        presses = np.concatenate([one.curves[:, 0] for one in own])
        scores = {name: _score(one, presses, window) for name, one in made.items() if len(made) > 1}
    name = min(scores, key=scores.__getitem__) if scores else next(iter(made))
    reason = (
        "it leaves less of presses that it does not hold"
        if scores
        else "a single press stands for itself"
        if single
        else "asked for by name"
    )
    leads = {each: one.curves[0] for each, one in made.items()}
    return Average(name, reason, made[name].curves, made[name].aligned, kept, scores, leads)


@dataclass(frozen=True, eq=False)
class _Participant:
    """Presses (presses, channels, samples) of one participant, and their barycentre (samples,)."""

    curves: FloatArray
    centre: FloatArray


@dataclass(frozen=True, eq=False)
class _Template:
    """Template (channels, samples), and the first channel of each press in its time (presses, samples)."""

    curves: FloatArray
    aligned: FloatArray


def _mean(own: Sequence[_Participant]) -> _Template:
    every = np.concatenate([one.curves[:, 0] for one in own])
    return _Template(np.mean([one.curves.mean(axis=0) for one in own], axis=0), every)


def _registration(own: Sequence[_Participant], rate_hz: float, m: WarpModel) -> _Template:
    each = [register(one.curves, rate_hz, m, one.centre) for one in own]
    means = np.stack([one.template for one in each])
    whole = register(means, rate_hz, m, barycentre(means[:, 0], m.window(rate_hz)))
    # The participant's warp is applied after each press's own warp.
    aligned = [
        Rows(one.aligned[:, 0]).at(np.tile(shift, (len(one.aligned), 1)))
        for one, shift in zip(each, whole.shifts, strict=True)
    ]
    return _Template(whole.template, np.concatenate(aligned))


def _barycentre(own: Sequence[_Participant], rate_hz: float, window: int, in_time: bool) -> _Template:
    """The paper's average; `in_time`, brought to the mean time of the presses."""
    centres = np.stack([one.centre for one in own])
    trusted, centre = alike(centres, window) if len(own) > 1 else (np.array([True]), centres[0])
    paths = [paths_to(centre, one.curves[:, 0], window) for one in own]
    warped = [along(one.curves, path) for one, path in zip(own, paths, strict=True)]
    template = np.stack([curves.mean(axis=0) for curves in warped])[trusted].mean(axis=0)
    template[0] = centre
    aligned = np.concatenate([curves[:, 0] for curves in warped])
    if in_time:
        places = centred(centre, [path for some in paths for path in some], rate_hz)
        template, aligned = read_at(template, places), read_at(aligned, places)
    return _Template(template, aligned)


def _score(template: _Template, presses: FloatArray, reach: int) -> float:
    """Score a template on presses (presses, samples) that it does not hold, see `average`."""
    count, samples = presses.shape
    lead = template.curves[0]
    without = (count * lead - template.aligned) / (count - 1)
    length = max(4, 2 * reach // 3)
    taper = np.hanning(length + 2)[1:-1] ** 2
    sides = ((0, 0), (reach, reach))
    held, made, lead = np.pad(presses, sides), np.pad(without, sides), np.pad(lead, reach)
    left = power = 0.0
    for start in range(0, samples - length + 1, length // 2):
        piece = slice(start, start + length)
        near = slice(start, start + length + 2 * reach)
        unlike = _misfits(presses[:, piece], made[:, near], taper)
        missing = _misfits(without[:, piece], held[:, near], taper)
        found = 1 - missing.min(axis=1) / np.maximum(without[:, piece] ** 2 @ taper, 1e-300)
        trust = np.maximum(found, 0.0)
        late = float(trust @ (np.argmin(missing, axis=1) - reach)) / max(float(trust.sum()), 1e-9)
        here = np.arange(start, start + length) + reach
        moved = np.interp(here - late, np.arange(len(lead)), lead) - lead[here]
        left += float(np.sum(unlike.min(axis=1)) + np.sum(missing.min(axis=1)))
        left += _LATE * 2 * count * float(moved**2 @ taper)
        power += 2 * float(np.sum(presses[:, piece] ** 2 @ taper))
    # Differences of large sums: rounding can leave less than nothing of a perfect match.
    return float(np.sqrt(max(left, 0.0) / max(power, 1e-300)))


def _misfits(pieces: FloatArray, places: FloatArray, taper: FloatArray) -> FloatArray:
    """Tapered sum of squares (pairs, lags) between each segment and each lag within its place."""
    there = scipy.signal.correlate(places**2, taper[None], "valid", "fft")
    both = scipy.signal.fftconvolve(places, (pieces * taper)[:, ::-1], "valid", axes=1)
    return np.asarray((pieces**2 @ taper)[:, None] - 2 * both + there)
