"""Arrays that wait on the disk for their turn."""

import tempfile

import numpy as np
import pytest

from haploop.acquisition.presses import spool
from haploop.acquisition.presses.averaging import average
from haploop.acquisition.presses.spool import Spool
from haploop.base.errors import DataError
from tests.acquisition.presses.test_representative import RATE, TEMPO


def test_arrays_come_back_as_they_were_from_memory_and_from_the_disk(monkeypatch):
    rng = np.random.default_rng(5)
    arrays = [rng.standard_normal(shape) for shape in ((3, 2, 50), (1, 2, 50), (4, 7))]
    for room in (10**9, 100):
        monkeypatch.setattr(spool, "_IN_MEMORY", room)
        kept = Spool()
        for array in arrays:
            kept.append(array)
        assert len(kept) == 3
        for found, array in zip(reversed(kept), reversed(arrays), strict=True):
            np.testing.assert_array_equal(found, array)
        np.testing.assert_array_equal(kept[0:2][1], arrays[1])


def test_an_average_from_the_disk_has_the_same_bits(monkeypatch):
    groups = list(TEMPO.jittered(31_415, 2, 3).curves[:, :, None])
    in_memory = average(groups, RATE)
    monkeypatch.setattr(spool, "_IN_MEMORY", 100)
    kept = Spool()
    for group in groups:
        kept.append(group)
    from_disk = average(kept, RATE)
    assert in_memory.scores == from_disk.scores
    np.testing.assert_array_equal(in_memory.template, from_disk.template)
    np.testing.assert_array_equal(in_memory.spread, from_disk.spread)


def test_a_full_disk_is_said_in_a_sentence(monkeypatch):
    class Full:
        def seek(self, place: int) -> None: ...
        def close(self) -> None: ...
        def write(self, data: object) -> int:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(tempfile, "SpooledTemporaryFile", lambda most: Full())
    with pytest.raises(DataError, match=r"No space left on device\): free some gigabytes .* TMPDIR"):
        Spool().append(np.zeros(3))
