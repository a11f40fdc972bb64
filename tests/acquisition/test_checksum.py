"""What stands between HDF5's library and a disk, by hand."""

import errno
import itertools
import os
import signal
from pathlib import Path

import h5py
import numpy as np
import pytest

from haploop.base import checksum
from haploop.base.checksum import bounded, created, unreadable
from haploop.base.errors import DataError
from tests.raising import raises

LONG = np.arange(200_000.0)
"""More than the library keeps in memory."""


def empty(folder: Path) -> Path:
    path = folder / "file.h5"
    path.touch()
    return path


def test_what_was_written_is_read_back_before_the_file_is_closed(tmp_path):
    with created(empty(tmp_path)) as file:
        written = file.create_dataset("x", data=LONG)
        file.flush()
        np.testing.assert_array_equal(written[:], LONG)


def test_what_was_not_written_is_zeros(tmp_path):
    found = np.full(LONG.shape, 7.0)
    with created(empty(tmp_path)) as file:
        plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plan.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        plan.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        space = h5py.h5s.create_simple(LONG.shape)
        made = h5py.Dataset(h5py.h5d.create(file.id, b"x", h5py.h5t.NATIVE_DOUBLE, space, plan))
        made.read_direct(found)
    assert not found.any()


def test_an_error_that_is_not_the_disks_is_raised(tmp_path):
    with pytest.raises(ValueError, match="ours"), created(empty(tmp_path)):
        raise ValueError("ours")


@pytest.mark.parametrize("moment", range(1, 9))
def test_no_ctrl_c_within_the_library(tmp_path, monkeypatch, moment):
    write, calls = checksum._Disk.write, itertools.count(1)

    def interrupted(disk: checksum._Disk, data: object) -> int:
        if next(calls) == moment:
            signal.raise_signal(signal.SIGINT)
        return write(disk, data)

    monkeypatch.setattr(checksum._Disk, "write", interrupted)
    before, path = h5py.h5f.get_obj_count(), empty(tmp_path)
    with pytest.raises(KeyboardInterrupt), created(path) as file:
        file.create_dataset("x", data=LONG, chunks=(50_000,))
    assert h5py.h5f.get_obj_count() == before, "the library has closed the file, and all that is in it"
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file["x"], LONG)


def test_a_permission_is_named_and_not_the_content():
    with pytest.raises(DataError, match=r"no permission to read a\.h5"), unreadable("a.h5", "damaged"):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    with pytest.raises(DataError, match=r"^damaged$"), unreadable("a.h5", "damaged"):
        raise ValueError


def test_a_dataset_is_in_its_file_and_not_larger(tmp_path):
    with h5py.File(tmp_path / "file.h5", "w") as file:
        whole = file.create_dataset("whole", data=np.zeros(100))
        assert bounded(whole, 800) is whole
        raises(ValueError, "larger than its file", bounded, whole, 799)
        nothing = file.create_dataset("nothing", data=np.zeros(0))
        assert bounded(nothing, 0) is nothing
        packed = file.create_dataset("packed", data=np.zeros(100), chunks=(10,))
        elsewhere = file.create_dataset("elsewhere", (100,), "f8", external=[(tmp_path / "raw", 0, 800)])
        for one in (packed, elsewhere):
            raises(ValueError, "not contiguous", bounded, one, 10_000)
