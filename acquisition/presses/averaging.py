"""The average curve of many: two methods, and the choice between them.

The dynamic time warping barycentre (Petitjean et al., Pattern Recognition 44(3), 2011), per participant
and then over participants, is the paper's. It finds which sample of one press belongs to which of
another, however they are stretched; but it puts the template at the wrong time (its mean warp is not
zero) and copies noise into steps. The registration (`registration.py`) begins with its paths and fits
smooth warps. It is better wherever presses differ by their tempo, or by the moment of snaps that are
apart; where snaps that overlap come each on its own, it may be the other way round.

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
"""A press is another one altogether if its DTW distance from its participant's barycentre is more than this
many times the median one, and than this share of the barycentre's own size. Measured on presses that differ
by warps, jitter and a tenth in loudness: 2.2 and 0.19 at most; on a press of another button: 3.4 and 0.45."""
_TRUSTED = 0.5
"""A participant who weighs less in the registration is left out of the barycentre, which has no weights."""


@dataclass(frozen=True, eq=False)
class Average:
    """One curve for all presses, by the better method."""

    method: str
    template: FloatArray
    """(channels, samples)."""
    aligned: FloatArray
    """(presses, samples): the first channel of each, participant by participant, at the template's time."""
    leads: dict[str, FloatArray]
    """(samples,): the template's first channel as each method finds it."""
    kept: tuple[BoolArray, ...]
    """(presses,) of each participant: whether the press is like the others, and was used."""
    scores: dict[str, float]
    """See `average`. Of a single press, which has nothing to be held against, there are none."""


def average(groups: Sequence[FloatArray], rate_hz: float, model: WarpModel | None = None) -> Average:
    """The average of all presses, at two levels: `groups` holds (presses, channels, samples) a participant.

    The first channel decides, the others go along. Each method is scored without knowing the truth:
    it makes a template of half of the participants (of the presses, where there is one participant) and
    this is held against the presses of the other half, and the reverse. Pieces of 20 ms of a press are
    looked for in the template, and pieces of the template in the press, each wherever it fits best
    within `WarpModel.reach`; the score is the root of what is left of all pieces, relative to the
    presses. It punishes what is blurred, missing, made up, or noise, and knows nothing of when a snap
    comes, nor of either method's warps: a piece is moved, but never stretched. Since a barycentre puts
    snaps at a wrong time, which this does not see, it is chosen only where its score is lower by a tenth.

    Of four presses or more of a participant, one that is unlike the others is left out by both methods.
    """
    m = model or WarpModel()
    # On a busy machine, threads for products as small as these cost more than they bring.
    with threadpool_limits(1):
        kept = [_alike(group[:, 0], m.window(rate_hz)) for group in groups]
        groups = [group[alike] for group, (alike, _) in zip(groups, kept, strict=True)]
        own = [_Middle.of(g, rate_hz, m, centre) for g, (_, centre) in zip(groups, kept, strict=True)]
        whole = _over(own, rate_hz, m)
        scores = _scores(groups, own, rate_hz, m)
        clearly = scores and scores[BARYCENTRE] < 0.9 * scores[REGISTRATION]
        method = BARYCENTRE if clearly else REGISTRATION
        if method == REGISTRATION:
            # Each press's own warp, and on top of it its participant's.
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
    """(samples,): the DTW barycentre of (curves, samples), begun at the curve nearest to their mean."""
    near = int(np.argmin(np.sum((curves - curves.mean(axis=0)) ** 2, axis=1)))
    rows = [np.ascontiguousarray(curve) for curve in curves]
    return np.asarray(
        dtw_barycenter.dba_loop(
            rows, c=rows[near].copy(), max_it=_ITERATIONS, thr=1e-4, window=window, use_c=True
        )
    )


def _alike(curves: FloatArray, window: int) -> tuple[BoolArray, FloatArray]:
    """(curves,) whether a curve (curves, samples) is like the others; and the barycentre of those."""
    centre = barycentre(curves, window)
    far = np.array([dtw.distance(centre, curve, window=window, use_c=True) for curve in curves])
    least = max(_ALIKE * float(np.median(far)), _SHARE * float(np.linalg.norm(centre)))
    alike = np.asarray((far <= least) | (len(curves) < 4))
    return alike, centre if alike.all() else barycentre(curves[alike], window)


@dataclass(frozen=True, eq=False)
class _Middle:
    """The middle of one participant's presses, or of the participants', by either method."""

    registration: Registration
    centre: FloatArray
    """(samples,): the barycentre."""

    @classmethod
    def of(cls, curves: FloatArray, rate_hz: float, m: WarpModel, centre: FloatArray) -> _Middle:
        """Of (curves, channels, samples) and their barycentre."""
        return cls(register(curves, rate_hz, m, centre), centre)

    @property
    def leads(self) -> dict[str, FloatArray]:
        return {REGISTRATION: self.registration.template[0], BARYCENTRE: self.centre}


def _over(own: Sequence[_Middle], rate_hz: float, m: WarpModel) -> _Middle:
    """The middle over participants."""
    window = m.window(rate_hz)
    means = np.stack([one.registration.template for one in own])
    registration = register(means, rate_hz, m, barycentre(means[:, 0], window))
    trusted = registration.weights >= _TRUSTED
    return _Middle(registration, barycentre(np.stack([one.centre for one in own])[trusted], window))


def _scores(
    groups: Sequence[FloatArray], own: Sequence[_Middle], rate_hz: float, m: WarpModel
) -> dict[str, float]:
    """See `average`."""
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
    """(curves, channels, samples): what each curve is, on the mean, where its first channel's DTW path
    meets each sample of a template.
    """
    result = np.empty_like(curves)
    for curve, found in zip(curves, result, strict=True):
        path = np.asarray(dtw.warping_path(template, curve[0], window=window, use_c=True)).T
        met = np.bincount(path[0], minlength=len(template))
        found[:] = [np.bincount(path[0], row[path[1]], len(template)) / met for row in curve]
    return result


def _misfit(template: FloatArray, presses: FloatArray, reach: int) -> float:
    """What is left (power, relative) of the pieces of presses (presses, samples), found in a template, and
    of the template's pieces, found in the presses.
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
    """(pairs,): the least tapered sum of squares between a piece and any stretch of its place. There is one
    of the two for all of the other.
    """
    there = signal.correlate(places**2, taper[None], "valid", "fft")
    both = signal.fftconvolve(places, (pieces * taper)[:, ::-1], "valid", axes=1)
    return np.asarray(np.min((pieces**2 @ taper)[:, None] - 2 * both + there, axis=1))
