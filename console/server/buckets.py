"""Minimum and maximum of each bucket of samples, for a scope that shows every click.

Bucket k holds the samples k * size to (k + 1) * size - 1 of the run, whenever the blocks arrive: every n-th
sample would hide a click of 2 ms, and buckets that move with the picture shimmer.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import FloatArray


class Buckets:
    """The newest `kept` buckets of `size` samples of several rows."""

    def __init__(self, rows: int, size: int, kept: int) -> None:
        self.size, self._kept = size, kept
        self._part: FloatArray = np.empty((rows, 0))
        self._extremes: NDArray[np.float32] = np.empty((2, rows, 0), np.float32)
        self._next = 0
        """Sample that should come next."""
        self.end = 0
        """Index behind the last complete bucket."""
        self.missed = 0
        """Samples that did not arrive."""

    def add(self, first: int, values: FloatArray) -> None:
        """Add (rows, samples) from sample `first` on. Buckets with a missing sample are NaN."""
        if first > self._next or self.end == 0 == self._part.shape[1]:
            self._skip_to(first)
        values = values[:, max(0, self._next - first) :]
        self._next += values.shape[1]
        part = np.concatenate([self._part, values], axis=1)
        count = part.shape[1] // self.size
        whole = part[:, : count * self.size].reshape(len(part), count, self.size)
        self._part = part[:, count * self.size :]
        if count:
            self._append(np.stack([whole.min(axis=2), whole.max(axis=2)]).astype(np.float32))

    def since(self, bucket: int) -> tuple[int, NDArray[np.float32]]:
        """Return the first bucket given, from `bucket` on, and (2, rows, buckets) minima and maxima."""
        have = self._extremes.shape[2]
        first = max(bucket, self.end - have)
        return first, self._extremes[:, :, have - max(0, self.end - first) :]

    def _skip_to(self, first: int) -> None:
        """Begin again at sample `first`; the buckets up to the one that holds it are missing."""
        began = self.end > 0 or self._part.shape[1] > 0
        if began:
            self.missed += first - self._next
        whole = -(-first // self.size)
        rows = len(self._part)
        if began and whole - self.end > 0:
            missing = min(whole - self.end, self._kept)
            self.end = whole - missing
            self._append(np.full((2, rows, missing), np.nan, np.float32))
        else:
            self.end = whole
        # The samples of an incomplete bucket are left out, so that each bucket holds all of its samples.
        self._part = np.empty((rows, 0))
        self._next = whole * self.size

    def _append(self, extremes: NDArray[np.float32]) -> None:
        self._extremes = np.concatenate([self._extremes, extremes], axis=2)[:, :, -self._kept :]
        self.end += extremes.shape[2]
