"""Average many curves by the better of two methods.

The paper uses the dynamic time warping (DTW) barycentre (Petitjean et al., Pattern Recognition 44(3),
2011), per participant and then over participants. It matches the samples of two presses under any local
stretch, but its mean warp is not zero, which shifts the template in time, and it copies noise into
steps. The registration (`registration.py`) starts from the DTW paths and fits smooth warps. It is better
when presses differ in tempo, or in the time between separate snaps; the barycentre can be better when
overlapping snaps shift independently.

Distances and paths are dtaidistance's, with its convention: the distance is the root of the sum of the
squared differences along the path; the steps (1, 1), (1, 0) and (0, 1) weigh the same and cost nothing
more; sample i is compared with sample j where |i - j| < window (for curves of one length).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from dtaidistance import dtw, dtw_barycenter
from scipy import signal
from threadpoolctl import threadpool_limits

from haploop.acquisition.presses.registration import Registration, Rows, WarpModel, register
from haploop.instruments.arrays import BoolArray, FloatArray

__all__ = ["BARYCENTRE", "REGISTRATION", "Average", "average", "barycentre"]

BARYCENTRE = "two-level barycentre"
REGISTRATION = "two-level registration"
_ITERATIONS = 5
_ALIKE, _SHARE = 2.0, 0.25
"""A press is unlike the others when its DTW distance from its participant's barycentre exceeds both this
multiple of the median distance and this fraction of the barycentre's norm. Measured on presses that differ
by warps, jitter and 10 % in amplitude: 2.2 and 0.19 at most; on a press of another button: 3.4 and 0.45."""
_TRUSTED = 0.5
"""Smallest registration weight of a participant in the barycentre, which has no weights of its own."""


@dataclass(frozen=True, eq=False)
class Average:
    """Average curve of all presses, by the better method."""

    method: str
    template: FloatArray
    """(channels, samples)."""
    aligned: FloatArray
    """(presses, samples): first channel of each press, by participant, warped to the template's time."""
    leads: dict[str, FloatArray]
    """(samples,): first channel of each method's template."""
    kept: tuple[BoolArray, ...]
    """(presses,) for each participant: True when the press resembles the others and was used."""
    scores: dict[str, float]
    """Score of each method, see `average`; empty for a single press, which cannot be held out."""


def average(groups: Sequence[FloatArray], rate_hz: float, model: WarpModel | None = None) -> Average:
    """Average all presses at two levels; `groups` holds (presses, channels, samples) for each participant.

    Alignment uses the first channel; the other channels get the same warps. Each method is scored on
    held-out presses: a template of half of the participants (or half of the presses of a single
    participant) is compared with the presses of the other half, and the reverse. Segments of 20 ms of a
    press are matched to the template, and segments of the template to the press, each at its best lag
    within `WarpModel.reach`; the score is the root of the residual power of all segments, relative to the
    presses. It penalises blur, missing or spurious events, and noise. It is blind to the time of a snap
    and to either method's warps, because segments are shifted but never stretched. A barycentre shifts
    snaps in time, which the score cannot see, so it is chosen only when its score is 10 % lower.

    With four or more presses of a participant, both methods leave out a press unlike the others.
    """
    m = model or WarpModel()
    # Threads cost more than they gain on matrices this small when the machine is busy.
    with threadpool_limits(1):
        kept = [_alike(group[:, 0], m.window(rate_hz)) for group in groups]
        groups = [group[alike] for group, (alike, _) in zip(groups, kept, strict=True)]
        own = [_Middle.of(g, rate_hz, m, centre) for g, (_, centre) in zip(groups, kept, strict=True)]
        whole = _over(own, rate_hz, m)
        scores = _scores(groups, own, rate_hz, m)
        clearly = scores and scores[BARYCENTRE] < 0.9 * scores[REGISTRATION]
        method = BARYCENTRE if clearly else REGISTRATION
        if method == REGISTRATION:
            # The participant's warp is applied after each press's own warp.
            presses = [o.registration.aligned[:, 0] for o in own]
            shifts = whole.registration.shifts
            aligned = [Rows(p).at(np.tile(s, (len(p), 1))) for p, s in zip(presses, shifts, strict=True)]
            template = whole.registration.template
        else:
            window = m.window(rate_hz)
            own_means = [_along(g, o.centre, window).mean(axis=0) for g, o in zip(groups, own, strict=True)]
            trusted = whole.registration.weights >= _TRUSTED
            template = _along(np.stack(own_means), whole.centre, window)[trusted].mean(axis=0)
            template[0] = whole.centre
            aligned = [_along(g[:, :1], whole.centre, window)[:, 0] for g in groups]
    alike = tuple(which for which, _ in kept)
    return Average(method, template, np.concatenate(aligned), whole.leads, alike, scores)


def barycentre(curves: FloatArray, window: int) -> FloatArray:
    """Compute the DTW barycentre (samples,) of (curves, samples), starting at the curve nearest the mean."""
    near = int(np.argmin(np.sum((curves - curves.mean(axis=0)) ** 2, axis=1)))
    rows = [np.ascontiguousarray(curve) for curve in curves]
    return np.asarray(
        dtw_barycenter.dba_loop(
            rows, c=rows[near].copy(), max_it=_ITERATIONS, thr=1e-4, window=window, use_c=True
        )
    )


def _alike(curves: FloatArray, window: int) -> tuple[BoolArray, FloatArray]:
    """Find the curves (curves, samples) that resemble each other: mask (curves,), and their barycentre."""
    centre = barycentre(curves, window)
    far = np.array([dtw.distance(centre, curve, window=window, use_c=True) for curve in curves])
    least = max(_ALIKE * float(np.median(far)), _SHARE * float(np.linalg.norm(centre)))
    alike = np.asarray((far <= least) | (len(curves) < 4))
    return alike, centre if alike.all() else barycentre(curves[alike], window)


@dataclass(frozen=True, eq=False)
class _Middle:
    """Average of one participant's presses, or over participants, by each method."""

    registration: Registration
    centre: FloatArray
    """(samples,): the barycentre."""

    @classmethod
    def of(cls, curves: FloatArray, rate_hz: float, m: WarpModel, centre: FloatArray) -> _Middle:
        """Average (curves, channels, samples), given their barycentre."""
        return cls(register(curves, rate_hz, m, centre), centre)

    @property
    def leads(self) -> dict[str, FloatArray]:
        return {REGISTRATION: self.registration.template[0], BARYCENTRE: self.centre}


def _over(own: Sequence[_Middle], rate_hz: float, m: WarpModel) -> _Middle:
    """Average over participants."""
    window = m.window(rate_hz)
    means = np.stack([one.registration.template for one in own])
    registration = register(means, rate_hz, m, barycentre(means[:, 0], window))
    trusted = registration.weights >= _TRUSTED
    return _Middle(registration, barycentre(np.stack([one.centre for one in own])[trusted], window))


def _scores(
    groups: Sequence[FloatArray], own: Sequence[_Middle], rate_hz: float, m: WarpModel
) -> dict[str, float]:
    """Score each method on held-out presses, see `average`."""
    presses = [group[:, 0] for group in groups]
    halves: list[tuple[_Middle, FloatArray]] = []
    for half in (0, 1):
        if len(groups) > 1:
            halves.append((_over(own[half::2], rate_hz, m), np.concatenate(presses[1 - half :: 2])))
        elif len(presses[0]) > 1:
            some = groups[0][half::2]
            made = _Middle.of(some, rate_hz, m, barycentre(some[:, 0], m.window(rate_hz)))
            halves.append((made, presses[0][1 - half :: 2]))
    reach = m.window(rate_hz)
    return {
        method: float(np.sqrt(np.mean([_misfit(made.leads[method], held, reach) for made, held in halves])))
        for method in (REGISTRATION, BARYCENTRE)
        if halves
    }


def _along(curves: FloatArray, template: FloatArray, window: int) -> FloatArray:
    """Warp (curves, channels, samples) to a template along the DTW path of the first channel.

    Samples that map to the same sample of the template are averaged.
    """
    result = np.empty_like(curves)
    for curve, found in zip(curves, result, strict=True):
        path = np.asarray(dtw.warping_path(template, curve[0], window=window, use_c=True)).T
        met = np.bincount(path[0], minlength=len(template))
        found[:] = [np.bincount(path[0], row[path[1]], len(template)) / met for row in curve]
    return result


def _misfit(template: FloatArray, presses: FloatArray, reach: int) -> float:
    """Relative residual power of segments of presses (presses, samples) matched to a template, and of
    segments of the template matched to the presses.
    """
    length = max(4, 2 * reach // 3)
    taper = np.hanning(length + 2)[1:-1] ** 2
    one, many = np.pad(template, reach)[None], np.pad(presses, ((0, 0), (reach, reach)))
    left = power = 0.0
    for start in range(0, len(template) - length + 1, length // 2):
        piece = slice(start, start + length)
        near = slice(start, start + length + 2 * reach)
        left += np.sum(_best_fits(presses[:, piece], one[:, near], taper))
        left += np.sum(_best_fits(template[None, piece], many[:, near], taper))
        power += 2 * float(np.sum(presses[:, piece] ** 2 @ taper))
    return float(left / max(power, 1e-300))


def _best_fits(pieces: FloatArray, places: FloatArray, taper: FloatArray) -> FloatArray:
    """Smallest tapered sum of squares (pairs,) between each segment and any lag within its place.

    Either array may have a single row, which is then paired with every row of the other.
    """
    there = signal.correlate(places**2, taper[None], "valid", "fft")
    both = signal.fftconvolve(places, (pieces * taper)[:, ::-1], "valid", axes=1)
    return np.asarray(np.min((pieces**2 @ taper)[:, None] - 2 * both + there, axis=1))
