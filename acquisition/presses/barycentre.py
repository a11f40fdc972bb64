"""Dynamic time warping (DTW) barycentre of curves.

Distances and paths are dtaidistance's, with its convention: the distance is the root of the sum of the
squared differences along the path; the steps (1, 1), (1, 0) and (0, 1) weigh the same and cost nothing
more; sample i is compared with sample j where |i - j| < window (for curves of one length).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np
import scipy
from numpy.typing import NDArray

from ...base.arrays import BoolArray, FloatArray

WarpingPath = NDArray[np.int32]
"""(2, steps): samples of a template, and those of a curve that they are compared with."""
_ROUNDS, _SETTLED = 5, 0.97
"""Most rounds of a barycentre, and the squared length of new paths, over that of the old ones, from which no
other round follows: hardly different from always three, or five, on 200 sets of `unseen` in
`benchmarks/representative.py`."""
_ALIKE, _SHARE = 2.0, 0.25
"""A press is unlike the others when its DTW distance from the barycentre of all exceeds both this multiple of
the median distance and this fraction of the barycentre's norm, were all as loud. Chosen by raw distances of
presses that differ by warps, jitter and 10 % in amplitude: 2.2 and 0.19 at most; of another button: 3.4 and
0.45."""
_SUSPECT, _ALONE, _APART = 1.3, 3.0, 0.55
"""One of few presses draws the barycentre towards itself. So the farthest is unlike the others also when it
exceeds this multiple, and `_SHARE`, and from the barycentre of the others the other multiple and fraction. In
451 of 496 sets of four, six or ten presses the one of another button alone was left out so, in 284 by the
first rule with raw distances; any of right presses in 8, and in 7."""
_STIFF, _SMOOTH = 0.004, 0.002
"""s: length over which `centred` keeps neighbouring lags equal within an event, and the smoothing of the
energy that tells an event from silence."""


def barycentre(curves: FloatArray, window: int, every: int = 1) -> tuple[FloatArray, list[WarpingPath]]:
    """Compute the DTW barycentre (samples,) of (curves, samples), starting at the curve nearest the mean.

    Returns with it the path of each curve, see `paths_to`, along which it is the mean of their samples. Paths
    are those of the means of `every` so many neighbouring samples.
    """
    if len(curves) == 1:
        return curves[0], [_diagonal(curves.shape[1])]
    coarse = _means(curves, every)
    centre = coarse[_first(coarse)]
    paths = [_diagonal(len(centre))] * len(coarse)
    for number in range(_ROUNDS):
        known, paths = paths, list(paths_to(centre, coarse, _within(window, every), paths))
        if number and _far(centre, coarse, paths) > _SETTLED * _far(centre, coarse, known):
            break
        centre = _mean(coarse, paths)
    fine = [_finer(path, every, curves.shape[1]) for path in paths]
    return _mean(curves, fine), fine


def _mean(curves: FloatArray, paths: Sequence[WarpingPath]) -> FloatArray:
    """Mean (samples,) of (curves, samples) along their paths to a template."""
    total, met = np.zeros((2, curves.shape[1]))
    for curve, (to, at) in zip(curves, paths, strict=True):
        total += np.bincount(to, curve[at], len(total))
        met += np.bincount(to, minlength=len(total))
    return np.asarray(total / met)


def _first(curves: FloatArray) -> int:
    """Number of the curve nearest the mean; of equally near ones, as any two are, that of the loudest."""
    far = np.sum((curves - curves.mean(axis=0)) ** 2, axis=1)
    near = np.flatnonzero(far <= (1 + 1e-9) * far.min())
    return int(near[np.argmax(np.sum(curves[near] ** 2, axis=1))])


def _far(template: FloatArray, curves: FloatArray, paths: Sequence[WarpingPath]) -> float:
    """Sum of the squared lengths of paths of (curves, samples) to a template."""
    return sum(
        float(np.sum((template[to] - curve[at]) ** 2)) for curve, (to, at) in zip(curves, paths, strict=True)
    )


def alike(curves: FloatArray, window: int, every: int = 1) -> tuple[BoolArray, FloatArray, list[WarpingPath]]:
    """Find the curves (curves, samples) that resemble each other: half of them at least, of four or more.

    Returns which they are (curves,), their barycentre, see there, and their paths to it.
    """
    mask = np.ones(len(curves), dtype=bool)
    centre, paths = barycentre(curves, window, every)
    while np.sum(mask) > max(3, (len(curves) + 1) // 2):
        like = np.flatnonzero(mask)
        far = _unlike(centre, curves[like], paths)
        worst = int(np.argmax(far))
        if not _beyond(far[worst], far, centre, _SUSPECT, _SHARE):
            break
        others, one = np.delete(like, worst), curves[like[worst : worst + 1]]
        without, known = barycentre(curves[others], window, every)
        if not _beyond(far[worst], far, centre, _ALIKE, _SHARE):
            alone = _unlike(without, one, list(paths_to(without, one, window)))[0]
            if not _beyond(alone, _unlike(without, curves[others], known), without, _ALONE, _APART):
                break
        mask[like[worst]] = False
        centre, paths = without, known
    return mask, centre, paths


def _unlike(template: FloatArray, curves: FloatArray, paths: Sequence[WarpingPath]) -> FloatArray:
    """Length of the path of each curve, (curves,), were all as loud as the template."""
    far = []
    for curve, (to, at) in zip(curves, paths, strict=True):
        own, met = curve[at], template[to]
        power = float(met @ met)
        loud = float(own @ met) / power if power else 1.0
        far.append(float(np.linalg.norm(own / loud - met)) if loud > 0 else np.inf)
    return np.array(far)


def _beyond(one: float, far: FloatArray, template: FloatArray, multiple: float, share: float) -> bool:
    """Whether a distance exceeds a multiple of the median of others and a share of the template's norm."""
    return bool(one > max(multiple * np.median(far), share * np.linalg.norm(template)))


def paths_to(
    template: FloatArray, curves: FloatArray, window: int, known: Sequence[WarpingPath] | None = None
) -> Iterator[WarpingPath]:
    """Find the DTW path of each of (curves, samples) to a template.

    `known` are paths of the curves to a template that may be another: none that is longer is followed.
    """
    from dtaidistance import dtw  # noqa: PLC0415  what looks at presses does not average them

    template = np.ascontiguousarray(template)
    for curve, (to, at) in zip(curves, known or [_diagonal(len(template))] * len(curves), strict=True):
        # Rounding must not exclude the known path itself, as it can by `use_pruning`, which then loses the
        # best path.
        longest = (1 + 1e-9) * float(np.linalg.norm(template[to] - curve[at]))
        row = np.ascontiguousarray(curve)
        path = dtw.warping_path(template, row, window=window, max_dist=longest, use_c=True)
        yield np.fromiter(chain.from_iterable(path), np.int32, 2 * len(path)).reshape(-1, 2).T


def coarse_paths(template: FloatArray, curves: FloatArray, window: int, every: int) -> Iterator[WarpingPath]:
    """As `paths_to`, of the means of `every` so many neighbouring samples: these squared times as fast."""
    means = _means(np.concatenate([template[None], curves]), every)
    for path in paths_to(means[0], means[1:], _within(window, every)):
        yield _finer(path, every, len(template))


def _means(curves: FloatArray, every: int) -> FloatArray:
    """Means (curves, samples / every) of neighbouring samples; the last sample fills up the last mean."""
    padded = np.pad(curves, ((0, 0), (0, -curves.shape[1] % every)), mode="edge")
    return np.ascontiguousarray(padded.reshape(len(curves), -1, every).mean(axis=2))


def _within(window: int, every: int) -> int:
    """The window of means of `every` so many samples, whose paths are within `window` samples."""
    return (window - 1) // every + 1


def _finer(path: WarpingPath, every: int, samples: int) -> WarpingPath:
    """The path of `samples` for one of means of `every` so many: each of its steps that often."""
    steps = np.repeat(np.diff(path, prepend=path[:, :1]), every, axis=1)
    steps[:, 1:every] = 1
    return np.asarray(np.minimum(np.cumsum(steps, axis=1, dtype=np.int32), samples - 1))


def _diagonal(samples: int) -> WarpingPath:
    return np.tile(np.arange(samples, dtype=np.int32), (2, 1))


def along(curves: FloatArray, paths: Sequence[WarpingPath]) -> FloatArray:
    """Warp (curves, channels, samples) along their paths to a template.

    Samples that map to the same sample of the template are averaged.
    """
    result = np.empty_like(curves)
    for curve, path, found in zip(curves, paths, result, strict=True):
        met = np.bincount(path[0], minlength=curve.shape[-1])
        found[:] = [np.bincount(path[0], row[path[1]], len(met)) / met for row in curve]
    return result


def lags_along(path: WarpingPath, samples: int) -> FloatArray:
    """Mean lag (samples,) of a curve behind each sample of a template of so many, along their path."""
    return np.asarray(
        np.bincount(path[0], path[1] - path[0], samples) / np.bincount(path[0], minlength=samples)
    )


def centred(template: FloatArray, lag: FloatArray, rate_hz: float) -> FloatArray:
    """Compute when each sample of a template (samples,) comes on the mean of the curves that it stands for.

    Their mean lag (samples,) along the DTW paths is followed where the template changes, and bridges silence,
    where paths are random. Returns the place in the template (samples,) of each sample of the centred one:
    time is stretched between events rather than within, so that events keep their frequencies.
    """
    samples = len(template)
    steep = np.gradient(template) ** 2
    steep /= max(float(steep.max()), 1e-300)
    # The smallest stiffness is far below any event's, and keeps silence from breaking the chain.
    smooth = scipy.ndimage.gaussian_filter1d(steep, _SMOOTH * rate_hz)
    stiff = ((smooth + 1e-6) * (_STIFF * rate_hz) ** 2)[:-1]
    bands = np.zeros((2, samples))
    bands[0, 1:] = -stiff
    bands[1] = steep + 1e-9
    bands[1, :-1] += stiff
    bands[1, 1:] += stiff
    places = np.arange(samples)
    came = places + scipy.linalg.solveh_banded(bands, steep * lag)
    return np.interp(places, np.maximum.accumulate(came + 1e-6 * places), places)


def read_at(rows: FloatArray, places: FloatArray) -> FloatArray:
    """Interpolate (..., samples) at places (samples)."""
    return np.asarray(scipy.interpolate.CubicSpline(np.arange(rows.shape[-1]), rows, axis=-1)(places))
