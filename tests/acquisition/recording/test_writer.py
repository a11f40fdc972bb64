"""The writer's room, to the byte and to the row; and what is set aside, or recovered, and what is not."""

import errno
import os
import shutil
import subprocess
import sys
import threading
import time
from collections import namedtuple
from dataclasses import replace

import h5py
import numpy as np
import pytest

from haploop.acquisition import Recording, recover
from haploop.acquisition.recording import set_aside
from haploop.acquisition.recording.file_format import from_codes
from haploop.acquisition.recording.recovery import recover_damaged
from haploop.acquisition.recording.rows import block_dtype
from haploop.acquisition.recording.salvage import finish
from haploop.acquisition.recording.writer import Writer
from haploop.base.errors import ConfigurationError, DataError, InstrumentError
from haploop.base.files import allocate
from haploop.base.marks import marked
from haploop.instruments import Block
from tests.acquisition.recording.pattern import (
    CHANNELS,
    FULL_SCALE,
    PRESS,
    block_of,
    codes_of,
    header,
    written,
)
from tests.raising import raises, raising

Usage = namedtuple("Usage", "total used free")


def test_a_recording_needs_twice_its_size(tmp_path, monkeypatch):
    needed = 2 * 2000 * block_dtype(CHANNELS, 250).itemsize + (1 << 20)
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: Usage(0, 0, needed - 1))
    with pytest.raises(ConfigurationError, match=f"but this recording needs {needed / 1e6:.0f} MB: free"):
        Writer(tmp_path / "P01-push.h5", header(), 250, 2000)
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: Usage(0, 0, needed))
    Writer(tmp_path / "P01-push.h5", header(), 250, 2000).close()


def test_events_and_verdicts_have_room_for_so_many_and_the_last_event_says_so(tmp_path):
    presses = header().presses
    path = tmp_path / "P01-push.h5"
    with Writer(path, header(), 250, 4, along=3) as writer:
        writer.write(block_of(0), 0.0)
        for number in range(16 * presses + 256 + 3 + 5):
            writer.note(number, "note", str(number))
        for attempt in range(1, 8 * presses + 64 + 1):
            writer.write_verdict(PRESS._replace(attempt=attempt))
        with pytest.raises(InstrumentError, match="no space for further attempts"):
            writer.write_verdict(PRESS._replace(attempt=1))
        with pytest.raises(DataError, match="ends at sample 251, but only 250 are written"):
            writer.write_verdict(PRESS._replace(end=251))
        for block in (0, 1, 2, 3):
            writer.write(block_of(250 * block), 0.0)
        raises(InstrumentError, "is full after 1000 samples", writer.write, block_of(1000), 0.0)
        raises(InstrumentError, "begins at sample 1250, but 1000 is next", writer.write, block_of(1250), 0.0)
    recording = Recording.open(path)
    assert len(recording.events) == 16 * presses + 259
    assert [event.kind for event in recording.events[-2:]] == ["note", "events-full"]
    assert len(recording.verdicts) == 8 * presses + 64


@pytest.mark.parametrize("length", [1, 1 << 20, (5 << 19) + 3])
def test_room_is_taken_in_zeros(length, tmp_path, monkeypatch):
    monkeypatch.delattr(os, "posix_fallocate", raising=False)
    path = tmp_path / "room"
    path.write_bytes(b"x" * 100)
    with path.open("r+b") as file:
        allocate(file.fileno(), 90, length)
    assert path.read_bytes() == b"x" * 90 + bytes(length) + b"x" * max(0, 10 - length)


def test_a_disk_that_takes_nothing_is_full(tmp_path, monkeypatch):
    if not hasattr(os, "pwrite"):
        pytest.skip("a disk's refusal is simulated at this call")
    writer = Writer(tmp_path / "P01-push.h5", header(), 250, 4)
    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", lambda *_: 0)
        raises(InstrumentError, os.strerror(errno.ENOSPC), writer.write, block_of(0), 0.0)
    raises(InstrumentError, "", writer.close)
    writer.close()


def test_eight_megabytes_are_synced_at_once(tmp_path, monkeypatch):
    monkeypatch.setattr("haploop.acquisition.recording.writer._COMMIT_PERIOD", 1000.0)
    blocks = -(-(8 << 20) // block_dtype(CHANNELS, 250).itemsize)
    with Writer(tmp_path / "P01-push.h5", header(), 250, blocks) as writer:
        for number in range(blocks):
            assert not writer.committed
            writer.write(block_of(250 * number), 0.0)
        for _ in range(1000):
            if writer.committed:
                break
            time.sleep(0.01)
        assert writer.committed


def test_what_comes_during_a_sync_is_not_safe(tmp_path, monkeypatch):
    monkeypatch.setattr("haploop.acquisition.recording.writer._COMMIT_PERIOD", 0.01)
    syncing, go_on = threading.Event(), threading.Event()

    def slowly(_file: int) -> None:
        syncing.set()
        assert go_on.wait(10)

    monkeypatch.setattr(os, "fdatasync", slowly, raising=False)
    with Writer(tmp_path / "P01-push.h5", header(), 250, 4) as writer:
        writer.write(block_of(0), 0.0)
        assert syncing.wait(10)
        writer.write(block_of(250), 0.0)
        monkeypatch.setattr(os, "fdatasync", lambda _file: time.sleep(1.0), raising=False)
        go_on.set()
        for samples in (250, 500):  # by the next sync
            until = time.monotonic() + 10
            while writer.committed < samples and time.monotonic() < until:
                time.sleep(0.001)
            assert writer.committed == samples


def test_behind_a_short_block_stand_no_samples_of_the_one_before(tmp_path):
    path = tmp_path / "P01-push.h5"
    with Writer(path, header(), 250, 4) as writer:
        writer.write(block_of(0), 0.0)
        writer.write(block_of(0), 0.0)  # once more: it takes its own place
        writer.write(block_of(250, 100), 0.0)
        assert writer.written == 350
    assert writer.committed == 350
    np.testing.assert_array_equal(Recording.open(path).volts, from_codes(codes_of(0, 350), FULL_SCALE))
    with h5py.File(path) as file:
        rows = file["blocks"][:2]
    assert np.any(rows["samples"][0][:, 100:]) and np.any(rows["samples"][1][:, :100])
    assert not np.any(rows["samples"][1][:, 100:])


@pytest.mark.parametrize(("first", "count"), [(251, 250), (250, 251)])
def test_a_gap_of_one_sample_and_a_long_block_are_refused(tmp_path, first, count):
    with Writer(tmp_path / "P01-push.h5", header(), 250, 4) as writer:
        writer.write(block_of(0), 0.0)
        with pytest.raises(InstrumentError, match=f"of {count} samples begins at sample {first}, but 250 is"):
            writer.write(block_of(first, count), 0.0)
        assert writer.written == 250


def test_a_file_of_somebody_else_is_not_removed(tmp_path, monkeypatch):
    """One that took the name between the file's own naming and its opening."""
    path, real = tmp_path / "P01-push.h5", os.open

    def refused(name: object, *more: int) -> int:
        if name == path:
            if theirs:
                (tmp_path / "theirs").write_text("theirs")
                (tmp_path / "theirs").replace(path)
            raise OSError(errno.EIO, "Input/output error")
        return real(name, *more)

    for theirs in (True, False):
        with monkeypatch.context() as patch:
            patch.setattr(os, "open", refused)
            with pytest.raises(ConfigurationError, match=r"cannot be preallocated \(Input/output error\)"):
                Writer(path, header(), 250, 4)
        assert [file.read_text() for file in tmp_path.iterdir()] == ["theirs"] * theirs
        path.unlink(missing_ok=True)


def test_what_holds_no_press_is_set_aside_and_nothing_else(tmp_path):
    path = tmp_path / "P01-push.h5"

    def recorded(kind: str = "", verdict: bool = False) -> None:
        path.unlink(missing_ok=True)
        with Writer(path, header(), 250, 4) as writer:
            writer.write(block_of(0), 0.0)
            if kind:
                writer.note(0, kind, "Something.")
            if verdict:
                writer.write_verdict(PRESS)

    for number in (1, 2, 3):
        recorded("prompt")
        assert set_aside(path) == tmp_path / f"P01-push.empty-{number}.h5" and not path.exists()
    for kind, verdict in (("pressed", False), ("", True)):
        recorded(kind, verdict)
        assert set_aside(path) is None and path.exists()
    path.write_bytes(b"no recording")
    assert set_aside(path) is None and path.exists()
    recorded()
    finish(path)  # a study of no presses, or another program's
    assert set_aside(path) is None and path.exists()


def test_what_cannot_be_renamed_or_is_recorded(tmp_path, monkeypatch):
    raises(DataError, "There is no file", recover, tmp_path / "none.h5")
    path = written(tmp_path / "P01-push.h5")
    with marked(path), pytest.raises(ConfigurationError, match="is being recorded now"):
        recover(path)
    monkeypatch.setattr("haploop.acquisition.recording.recovery.publish", raising(OSError(errno.EROFS, "")))
    raises(ConfigurationError, r"cannot be renamed \(Read-only file system\)", set_aside, path)


LIMITED = """
import resource, sys
from haploop.acquisition.recording import recovery
def held():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[0]) * resource.getpagesize()
def told(_path, _destination, allow):
    for count in (0, 1 << 30):
        before = held()
        allow(count)
        sys.stderr.write(f"{resource.getrlimit(resource.RLIMIT_AS)[0] - before} ")
real = recovery.allow_memory
recovery.allow_memory = lambda count: (sys.stderr.write(f"{count} "), real(count))
recovery.recover_damaged = lambda path, destination, allow: told(path, destination, real)
recovery._in_child()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited on Linux only")
def test_a_damaged_file_is_recovered_in_a_process_with_limited_memory(tmp_path):
    child = subprocess.run(
        [sys.executable, "-c", LIMITED, "a", "b"], capture_output=True, text=True, check=True
    )
    first, own, more = map(int, child.stderr.split())
    assert first == 0  # before anything is read
    assert np.isclose(own, 200 << 20, atol=1 << 19)
    assert np.isclose(more, (200 << 20) + (1 << 30), atol=1 << 19)
    assert child.stdout == '{"error": "", "text": ""}'


def test_a_recovery_has_time_by_its_size(tmp_path, monkeypatch):
    path, waited = tmp_path / "P01-push.h5", []

    def run(*_: object, timeout: float, **_more: object) -> None:
        waited.append(timeout)
        raise subprocess.TimeoutExpired("", timeout)

    monkeypatch.setattr(subprocess, "run", run)
    for size in (1 << 20, 1 << 30):
        with path.open("wb") as file:
            file.truncate(size)  # which takes no room on the disk
        raises(DataError, "is damaged in its metadata", recover, path)
    assert waited == [pytest.approx(60 * (1 + 1 / 256)), 60 * 5]


def test_a_recovered_file_replaces_none_that_came_meanwhile(tmp_path):
    path, theirs = tmp_path / "P01-push.h5", tmp_path / "P01-push.recovered.h5"
    with Writer(path, header(), 250, 4) as writer:
        assert (writer.written, writer.committed) == (0, 0)
        most = 16 * header().presses + 256
        kinds = [writer.note(0, "note", "").kind for _ in range(most)]
        assert kinds == ["note"] * (most - 1) + ["events-full"]
        writer.write(block_of(0), 0.0)
    theirs.write_text("theirs")
    raises(ConfigurationError, "already exists and is not overwritten", recover_damaged, path, theirs)
    assert theirs.read_text() == "theirs"


def test_an_overload_is_a_bit_of_its_channel_and_the_last_bit_is_of_all_others(tmp_path):
    head = replace(header(), channels=tuple(f"c{n}" for n in range(40)), full_scale=np.full(40, 10.0),
                   delays=np.zeros(40))  # fmt: skip
    flags = np.zeros((5, 40), bool)
    for number, channels in enumerate(((), (0,), (0, 3), (30,), (31, 39))):
        flags[number, list(channels)] = True
    path = tmp_path / "P01-push.h5"
    with Writer(path, head, 250, 8) as writer:
        for number, flagged in enumerate(flags):
            writer.write(Block(250 * number, np.zeros((40, 250)), flagged), 0.0)
        beyond = np.zeros((40, 250))
        beyond[5, 7] = 10.1  # clipped, and not said by the card
        writer.write(Block(1250, beyond, flags[1]), 0.0)
    found = Recording.open(path).blocks
    assert found["overload"].tolist() == [0, 1, 9, 1 << 30, 1 << 31, 1 + (1 << 5)]
    assert found["first"].tolist() == [0, 250, 500, 750, 1000, 1250]
