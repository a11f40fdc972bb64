"""Arrays that are kept on the disk when they would fill the memory."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Sequence
from typing import overload

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import DataError

_IN_MEMORY = 8_000_000
"""Bytes up to which arrays stay in memory."""


class Spool(Sequence[FloatArray]):
    """Arrays of float64, one after the other. Each is read from the (temporary) file when it is asked for."""

    def __init__(self) -> None:
        self._file = tempfile.SpooledTemporaryFile(_IN_MEMORY)  # noqa: SIM115  (closed with the spool)
        weakref.finalize(self, self._file.close)
        self._arrays: list[tuple[int, tuple[int, ...]]] = []
        self._end = 0

    def append(self, array: FloatArray) -> None:
        """Add an array. Raises DataError when the disk is full."""
        whole = np.ascontiguousarray(array, dtype=np.float64)
        self._file.seek(self._end)
        try:
            self._file.write(whole.data.cast("B"))
        except OSError as error:
            raise DataError(
                f"The presses do not fit into the folder for temporary files, {tempfile.gettempdir()} "
                f"({error.strerror}): free some gigabytes there, or name another folder in TMPDIR."
            ) from None
        self._arrays.append((self._end, whole.shape))
        self._end += whole.nbytes

    def __len__(self) -> int:
        return len(self._arrays)

    @overload
    def __getitem__(self, index: int) -> FloatArray: ...
    @overload
    def __getitem__(self, index: slice) -> list[FloatArray]: ...
    def __getitem__(self, index: int | slice) -> FloatArray | list[FloatArray]:
        if isinstance(index, slice):
            return [self[one] for one in range(*index.indices(len(self)))]
        start, shape = self._arrays[index]
        array = np.empty(shape)
        self._file.seek(start)
        self._file.readinto(array.data.cast("B"))
        return array
