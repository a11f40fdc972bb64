"""Rows of samples as cubic splines, read at every sample plus a shift."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy

from ...base.arrays import FloatArray, IntArray

_TOGETHER = 64
"""Rows that are evaluated at once: these fit into a processor's cache."""


class SplineRows:
    """Cubic splines of (rows, samples), constant beyond both ends.

    `places` are the sample numbers at which they are evaluated: all, or every n-th.
    """

    def __init__(self, pieces: FloatArray, every: int = 1) -> None:
        self.samples = pieces.shape[1] + 1
        self.places = np.arange(0, self.samples, every)
        self._pieces = pieces.reshape(-1, 4)

    def at(self, shifts: FloatArray, which: IntArray | None = None) -> FloatArray:
        """Values (rows, places) of all rows, or of the rows `which`, at `places` plus shifts."""
        values = np.empty(shifts.shape)
        for some, pieces, f in self._find(shifts, which):
            c3, c2, c1, c0 = pieces
            values[some] = ((c3 * f + c2) * f + c1) * f + c0
        return values

    def with_slopes(self, shifts: FloatArray, which: IntArray) -> tuple[FloatArray, FloatArray]:
        """Values and derivatives per sample, both (rows, places)."""
        values, slopes = np.empty((2, *shifts.shape))
        for some, pieces, f in self._find(shifts, which):
            c3, c2, c1, c0 = pieces
            values[some] = ((c3 * f + c2) * f + c1) * f + c0
            slopes[some] = (3 * c3 * f + 2 * c2) * f + c1
        return values, slopes

    def _find(
        self, shifts: FloatArray, which: IntArray | None
    ) -> Iterator[tuple[slice, FloatArray, FloatArray]]:
        """Some rows at a time: the coefficients (4, rows, places) there, and the place within the piece."""
        rows = np.arange(len(shifts)) if which is None else which
        for start in range(0, len(shifts), _TOGETHER):
            some = slice(start, start + _TOGETHER)
            at = np.clip(self.places + shifts[some], 0, self.samples - 1)
            low = np.minimum(at.astype(np.int64), self.samples - 2)
            pieces = self._pieces.take(low + rows[some, None] * (self.samples - 1), axis=0)
            yield some, np.moveaxis(pieces, -1, 0), at - low


def splines(values: FloatArray) -> FloatArray:
    """Coefficients (rows, samples - 1, 4) of the splines of (rows, samples)."""
    # With knots at the integers a piece is found without a search, and its four coefficients are
    # adjacent in memory: three times as fast as calling the spline.
    spline = scipy.interpolate.CubicSpline(np.arange(values.shape[1]), values, axis=-1)
    return np.ascontiguousarray(spline.c.transpose(2, 1, 0))


def moved(rows: FloatArray, shifts: FloatArray) -> FloatArray:
    """Read (rows, samples) at every sample plus its shift, in samples."""
    # The coefficients of a spline take four times the memory of its row.
    some = range(0, len(rows), _TOGETHER)
    return np.concatenate(
        [SplineRows(splines(rows[at : at + _TOGETHER])).at(shifts[at : at + _TOGETHER]) for at in some]
    )
