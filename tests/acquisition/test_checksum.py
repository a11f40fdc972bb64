"""What stands between HDF5's library and a disk, by hand."""

from __future__ import annotations

import errno
import itertools
import os
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from haploop.acquisition import checksum
from haploop.acquisition.checksum import bounded, create, unreadable
from haploop.instruments import DataError

LONG = np.arange(200_000.0)
"""More than the library keeps in memory."""


def empty(folder: Path) -> Path:
    path = folder / "file.h5"
    path.touch()
    return path


def test_what_was_written_is_read_back_before_the_file_is_closed(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        written = file.create_dataset("x", data=LONG)
        file.flush()
        np.testing.assert_array_equal(written[:], LONG)

    create(empty(tmp_path), fill)


def test_what_was_not_written_is_zeros(tmp_path: Path) -> None:
    found = np.full(LONG.shape, 7.0)

    def fill(file: h5py.File) -> None:
        plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plan.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        plan.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        space = h5py.h5s.create_simple(LONG.shape)
        made = h5py.Dataset(h5py.h5d.create(file.id, b"x", h5py.h5t.NATIVE_DOUBLE, space, plan))
        made.read_direct(found)

    create(empty(tmp_path), fill)
    assert not found.any()


def test_an_error_that_is_not_the_disks_is_raised(tmp_path: Path) -> None:
    def fill(_: h5py.File) -> None:
        raise ValueError("ours")

    with pytest.raises(ValueError, match="ours"):
        create(empty(tmp_path), fill)


@pytest.mark.parametrize("moment", range(1, 9))
def test_a_ctrl_c_does_not_reach_into_the_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: int
) -> None:
    write, calls = checksum._Disk.write, itertools.count(1)

    def interrupted(disk: checksum._Disk, data: object) -> int:
        if next(calls) == moment:
            signal.raise_signal(signal.SIGINT)
        return write(disk, data)

    monkeypatch.setattr(checksum._Disk, "write", interrupted)
    before, path = h5py.h5f.get_obj_count(), empty(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        create(path, lambda file: file.create_dataset("x", data=LONG, chunks=(50_000,)).flush())
    assert h5py.h5f.get_obj_count() == before, "the library has closed the file, and all that is in it"
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file["x"], LONG)


AT_THE_END = """
import atexit, sys
from pathlib import Path
from haploop.acquisition.checksum import create

def write(path):
    path.touch()
    create(path, lambda file: file.create_dataset("x", data=[1.0, 2.0]).flush())

class Late:
    def __del__(self, write=write, path=Path(sys.argv[1], "late")):
        write(path)

late = Late()
atexit.register(write, Path(sys.argv[1], "last"))
"""


def test_a_file_is_written_when_a_program_ends(tmp_path: Path) -> None:
    """No thread is waited for that cannot start any more."""
    subprocess.run([sys.executable, "-c", AT_THE_END, tmp_path], check=True, timeout=60)
    with h5py.File(tmp_path / "last") as file:
        np.testing.assert_array_equal(file["x"], [1, 2])


def test_a_permission_is_named_and_not_the_content() -> None:
    with pytest.raises(DataError, match=r"no permission to read a\.h5"), unreadable("a.h5", "damaged"):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    with pytest.raises(DataError, match=r"^damaged$"), unreadable("a.h5", "damaged"):
        raise ValueError


def test_a_dataset_is_in_its_file_and_not_larger(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "file.h5", "w") as file:
        whole = file.create_dataset("whole", data=np.zeros(100))
        assert bounded(whole, 800) is whole
        with pytest.raises(ValueError, match="larger than its file"):
            bounded(whole, 799)
        nothing = file.create_dataset("nothing", data=np.zeros(0))
        assert bounded(nothing, 0) is nothing
        packed = file.create_dataset("packed", data=np.zeros(100), chunks=(10,))
        elsewhere = file.create_dataset("elsewhere", (100,), "f8", external=[(tmp_path / "raw", 0, 800)])
        for one in (packed, elsewhere):
            with pytest.raises(ValueError, match="not contiguous"):
                bounded(one, 10_000)
