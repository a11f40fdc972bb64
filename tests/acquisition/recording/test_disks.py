"""Disks that are too small, fill up, fail, are slow or may not be written: told in time, and nothing lost."""

import errno
import os
import shutil
import subprocess
import sys
import threading
from collections import namedtuple
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from haploop.acquisition import Recording, record, recover, verify
from haploop.acquisition.recording.file_format import to_codes
from haploop.acquisition.recording.salvage import finish
from haploop.acquisition.recording.writer import Writer
from haploop.acquisition.session.recorder import OverrunError, StreamReader
from haploop.base.clock import RealClock
from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.instruments import Stream
from tests.acquisition.presses.pressworld import world_rig
from tests.acquisition.recording.pattern import CHANNELS, RATE, block_of, header, kept, written
from tests.raising import raises


@contextmanager
def disk(folder: Path, *options: str):
    """A small disk of its own, where this test may mount one."""
    folder.mkdir(exist_ok=True)
    command = ["mount", "-t", "tmpfs", "-o", ",".join(options), "tmpfs", str(folder)]
    if sys.platform != "linux" or os.getuid() or subprocess.run(command, check=False).returncode:
        pytest.skip("only root of Linux can make a disk for this test")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def test_room_is_taken_without_posix_too(tmp_path, monkeypatch):
    monkeypatch.delattr(os, "posix_fallocate", raising=False)
    monkeypatch.delattr(os, "pwrite", raising=False)
    monkeypatch.delattr(os, "fdatasync", raising=False)
    assert kept(written(tmp_path / "P01-push.h5", 8)) == 8 * 250


@pytest.mark.skipif(not hasattr(os, "pwrite"), reason="a disk's refusal is simulated at this call")
def test_a_disk_that_fails_while_recording_stops_it_and_what_was_written_stays(tmp_path, monkeypatch):
    real = os.pwrite
    calls = []

    def failing(*arguments):
        calls.append(1)
        if len(calls) > 30:
            raise OSError(errno.EIO, "Input/output error")
        return real(*arguments)

    monkeypatch.setattr(os, "pwrite", failing)
    rig = world_rig()
    with pytest.raises(InstrumentError, match=r"could not be written .Input/output error"):
        record(rig, "push", "P01", 3, tmp_path)
    given = np.concatenate(rig.daq.given, axis=1)
    volts = Recording.open(tmp_path / "P01-push.h5").volts
    assert volts.shape[1] >= 25 * 250
    assert np.array_equal(to_codes(volts, rig.daq.streams[0].full_scale)[0], given[:, : volts.shape[1]])
    assert rig.daq.streams[0].closed


def test_a_real_disk_that_is_too_small_is_refused_before_the_first_press(tmp_path):
    rig = world_rig()
    with disk(tmp_path / "small", "size=2m") as small:
        with pytest.raises(
            ConfigurationError, match=r"The disk of .* has 2 MB free, but this recording needs"
        ):
            record(rig, "push", "P01", 10, small)
        assert list(small.iterdir()) == []
    assert rig.operator.requests == []


def test_a_folder_that_may_only_be_read_is_refused_before_the_first_press(tmp_path):
    rig = world_rig()
    with (
        disk(tmp_path / "kept", "ro", "size=1m") as kept,
        pytest.raises(ConfigurationError, match=r"cannot be written .Read-only file system.: choose another"),
    ):
        record(rig, "push", "P01", 10, kept)
    assert rig.operator.requests == []


def test_a_disk_that_promised_room_and_has_none_stops_the_recording_there(tmp_path, monkeypatch):
    monkeypatch.setattr("haploop.acquisition.recording.writer.allocate", lambda *_place: None)
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: usage(10**9, 0, 10**9))
    with disk(tmp_path / "small", "size=1m") as small:
        path = small / "P01-push.h5"
        writer = Writer(path, header(), 250, 1000)
        with pytest.raises(InstrumentError, match=r"P01-push\.h5 could not be written"):
            for i in range(1000):
                writer.write(block_of(250 * i), 0.0)
        reported = writer.written
        raises(InstrumentError, "could not be written", writer.close)
        assert 60 * 250 < reported < 1000 * 250
        assert kept(path) == reported
        for act in (finish, recover):
            raises(InstrumentError, "the recorded samples are safe", act, path)
        assert kept(path) == reported
        assert [file.name for file in small.iterdir()] == [path.name]
        elsewhere = Path(shutil.copy(path, tmp_path))
    assert kept(recover(elsewhere)) == reported


@pytest.mark.skipif(not hasattr(os, "pwrite"), reason="a disk's refusal is simulated at this call")
@pytest.mark.parametrize("taken", [0, 3, 5000])
def test_a_block_that_a_full_disk_took_in_part_is_no_row(tmp_path, monkeypatch, taken):
    path = tmp_path / "P01-push.h5"
    real = os.pwrite
    writer = Writer(path, header(), 250, 50)
    for i in range(10):
        writer.write(block_of(250 * i), 0.0)

    def full(file, data, place):
        if taken == 0 or len(data) < writer._dtype.itemsize:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(file, data[:taken], place)

    monkeypatch.setattr(os, "pwrite", full)
    raises(InstrumentError, "No space left on device", writer.write, block_of(2500), 0.0)
    monkeypatch.undo()
    for act in (lambda: writer.write(block_of(2500), 0.0), writer.close):  # a block that is missing is a gap
        raises(InstrumentError, "", act)
    assert writer.written == 2500
    assert kept(path) == 2500
    assert verify(recover(path)) == ()


class Fast(Stream):
    """A card that does not wait for anybody."""

    channels = tuple(f"c{i}" for i in range(CHANNELS))
    rate_hz = float(RATE)

    def __init__(self):
        self.ended = threading.Event()

    def __iter__(self):
        try:
            for i in range(1000):
                yield block_of(250 * i)
        finally:
            self.ended.set()

    def close(self):
        pass


@pytest.mark.skipif(not hasattr(os, "pwrite"), reason="a disk's slowness is simulated at this call")
def test_a_disk_that_is_too_slow_stops_the_recording_and_what_was_read_is_kept(tmp_path, monkeypatch):
    path, stream, real = tmp_path / "P01-push.h5", Fast(), os.pwrite

    def slow(*arguments):
        assert stream.ended.wait(30)
        return real(*arguments)

    with Writer(path, header(), 250, 1000) as writer, StreamReader(stream, RealClock(), depth=20) as reader:
        monkeypatch.setattr(os, "pwrite", slow)
        with pytest.raises(
            OverrunError, match="fell behind: 20 blocks wait to be written, and reading stopped"
        ):
            for block in reader:
                writer.write(block, 0.0)
    assert kept(path) == 20 * 250
