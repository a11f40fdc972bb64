"""Arrays over samples that are made part by part as they are asked for, so that memory does not grow."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import suppress
from copy import deepcopy
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

PART = 1 << 18
"""Samples of a part."""
_KEPT = 4 << 20
"""Bytes of parts of one array that are kept: two parts at least."""


class Parted:
    """An array (..., samples) that `make` makes, one part of `PART` samples after the other.

    `make` is given the slice of samples of a part. Parts that were used lately are kept, `kept` bytes of them
    or two, and so is the whole array once it was asked for. Index it with a slice of samples, after any other
    indices.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        dtype: DTypeLike,
        make: Callable[[slice], NDArray[Any]],
        kept: int = _KEPT,
    ) -> None:
        self.shape, self.dtype = shape, np.dtype(dtype)
        self._make = make
        self._made: OrderedDict[int, NDArray[Any]] = OrderedDict()
        bytes_of_part = max(1, PART * int(np.prod(shape[:-1])) * self.dtype.itemsize)
        self._most = max(2, kept // bytes_of_part)
        self._whole: NDArray[Any] | None = None

    @classmethod
    def of(cls, array: NDArray[Any]) -> Parted:
        """An array that is in memory already."""
        found = cls(array.shape, array.dtype, lambda part: array[..., part])
        found._whole = array
        return found

    def __len__(self) -> int:
        """Samples."""
        return self.shape[-1]

    def __getitem__(self, key: slice | tuple[Any, ...]) -> NDArray[Any]:
        *others, within = key if isinstance(key, tuple) else (key,)
        if self._whole is None and within == slice(None):
            self._whole = self._between(0, len(self))
            self._made.clear()
        if self._whole is not None:
            return np.asarray(self._whole[..., within][tuple(others)])
        begin, end, step = within.indices(len(self))
        assert step == 1
        return np.asarray(self._between(begin, max(begin, end))[tuple(others)])

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(np.array(self[:], dtype, copy=copy))

    def until(self, samples: int) -> Parted:
        """The first `samples` of it."""
        return Parted((*self.shape[:-1], samples), self.dtype, self._make)

    def parts(self) -> Iterator[slice]:
        """The samples of each part, in order."""
        for begin in range(0, len(self), PART):
            yield slice(begin, min(begin + PART, len(self)))

    def _between(self, begin: int, end: int) -> NDArray[Any]:
        first, last = begin // PART, max(begin, end - 1) // PART
        if first == last:
            return self._part(first)[..., begin - first * PART : end - first * PART]
        found = np.empty((*self.shape[:-1], end - begin), self.dtype)
        for number in range(first, last + 1):
            at = number * PART
            low, high = max(begin, at), min(end, at + PART)
            found[..., low - begin : high - begin] = self._part(number)[..., low - at : high - at]
        return found

    def _part(self, number: int) -> NDArray[Any]:
        made = self._made.get(number)
        if made is None:
            made = self._make(slice(number * PART, min((number + 1) * PART, len(self))))
            with suppress(KeyError):  # another thread has made room
                while len(self._made) >= self._most:
                    self._made.popitem(last=False)
            self._made[number] = made
        else:
            with suppress(KeyError):
                self._made.move_to_end(number)
        return made


def carried(signal: Parted, filtered: Callable[[NDArray[Any]], NDArray[Any]]) -> Parted:
    """What a filter with a memory makes of a signal (samples,); `filtered` is called part by part, in order.

    Its state before each part is kept, so that parts can be asked for in any order.
    """
    states, one_at_a_time = [filtered], Lock()

    def make(part: slice) -> NDArray[Any]:
        with one_at_a_time:
            return made(part)

    def made(part: slice) -> NDArray[Any]:
        number = part.start // PART
        for earlier in range(len(states) - 1, number):
            states.append(deepcopy(states[-1]))
            states[-1](signal[earlier * PART : (earlier + 1) * PART])
        state = deepcopy(states[number])
        found = np.asarray(state(signal[part]))
        if len(states) == number + 1:
            states.append(state)
        return found

    return Parted(signal.shape, np.float64, make)
