"""Write a recording file that is readable at every moment. Its speed: benchmarks/README.md, "Recording".

Preallocate: a complete HDF5 file with all metadata and space for every block is created, allocated and synced
before the first sample; a disk that is too small is detected here. Record: each block is one positioned
write, with its CRC, into the bytes of the dataset, without a call of HDF5. Commit: a separate thread syncs
the written data while the next blocks are converted, so that a busy disk never delays a block. Reasons:
docs/explanation/durability.md. A recording whose samples are all there already, of another program, is
written in one go (`write_recording`).
"""

from __future__ import annotations

import errno
import os
import shutil
import struct
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from ...base.arrays import FloatArray
from ...base.checksum import add_checksum, created
from ...base.errors import ConfigurationError, DataError, InstrumentError
from ...base.files import (
    WRITE_ERRORS,
    allocate,
    check_destination,
    existing,
    os_error_text,
    private_files,
    whole_file,
)
from ...base.marks import marked
from ...base.threads import Closing, Flag
from ...instruments import Block
from .file_format import Header, codes_per_volt, convert, write_header
from .recording import Recording
from .rows import EVENT, VERDICT, Event, PressVerdict, block_dtype, crc32, event_row, verdict_row
from .salvage import finish

_COMMIT_PERIOD = 0.05
"""Seconds between two syncs (measured: 50 to 100 ms costs nothing)."""
_COMMIT_BYTES = 8 << 20
"""Bytes after which a sync comes earlier, so that a fast card's samples do not pile up before the disk."""
_MARGIN = 1 << 20
"""Bytes left free beside the file itself and its finished copy."""


_HEAD = struct.Struct("<qIId")
"""What stands before the samples in a record of `block_dtype`."""
_CRC = struct.Struct("<I")


class Writer(Closing):
    """A recording file that is being filled; a context manager that closes it.

    `capacity` is the space in blocks of `block` samples, `along` the space for events of instruments
    recorded along. Raises ConfigurationError when the file exists or the disk is too small.
    """

    def __init__(self, path: Path, header: Header, block: int, capacity: int, along: int = 0) -> None:
        self.path = path
        self.header = header
        self._dtype = block_dtype(len(header.channels), block)
        # One record is filled again and again, through views of it that are made once.
        record = np.zeros(1, dtype=self._dtype)
        self._codes = record["samples"][0]
        self._row = record.view(np.uint8).data
        self._checked = self._row[: -_CRC.size]
        self._scratch = np.empty((len(header.channels), block), dtype=np.float32)
        self._per_volt = codes_per_volt(header.full_scale)
        self._capacity = capacity
        # Each of several attempts at a press has events, and so have errors.
        self._events_left = 16 * header.presses + 256 + along
        self._presses_left = 8 * header.presses + 64
        self._slot = 0
        self._written = 0
        self._committed = 0
        self._unsynced = 0
        self._failure: OSError | None = None
        self._closing = False
        self._due = Flag()
        self._file = self._arm()
        self._thread = threading.Thread(target=self._commit, name="haploop-committer", daemon=True)
        self._thread.start()

    @property
    def written(self) -> int:
        """Samples passed to the operating system, which a kill does not lose."""
        return self._written

    @property
    def committed(self) -> int:
        """Samples synced to the disk, which a power cut does not lose."""
        return self._committed

    def write(self, block: Block, time: float) -> None:
        """Append a block that arrived at `time` (s of the rig's clock); a block already written is ignored.

        Raises InstrumentError when the disk refuses, when the file is full, or after a gap.
        """
        if block.first < self._written:
            return
        count, space = block.volts.shape[1], self._codes.shape[1]
        if block.first > self._written or count > space:
            raise InstrumentError(
                f"A block of {count} samples begins at sample {block.first}, but {self._written} is next."
            )
        if self._slot >= self._capacity:
            raise InstrumentError(f"{self.path} is full after {self._written} samples: record fewer presses.")
        codes, scratch = self._codes, self._scratch
        if count < space:
            codes[:, count:] = 0
            codes, scratch = codes[:, :count], scratch[:, :count]
        beyond = convert(block.volts, self._per_volt, codes, scratch)
        _HEAD.pack_into(self._row, 0, block.first, count, _mask(block.overload | beyond), time)
        _CRC.pack_into(self._row, len(self._checked), crc32(self._checked))
        self._put(self._row, self._blocks_at + self._slot * len(self._row))
        self._slot += 1
        self._written = block.first + count
        self._unsynced += len(self._row)
        if self._unsynced >= _COMMIT_BYTES:
            self._unsynced = 0
            self._due.set()

    def note(self, index: int, kind: str, text: str) -> Event:
        """Append an event; when the space for events is full, the last event says so."""
        event = Event(index, kind, text)
        if self._events_left == 1:
            event = Event(index, "events-full", "There was no space for further events.")
        if self._events_left:
            self._put(event_row(event), self._events_at)
            self._events_at += EVENT.itemsize
            self._events_left -= 1
        return event

    def write_verdict(self, press: PressVerdict) -> None:
        """Append the verdict on a press; the last verdict on a number and attempt counts.

        Raises DataError for an unknown flag and for samples that are not written, InstrumentError
        when there is no space or the disk refuses.
        """
        row = verdict_row(press)
        if press.end > self._written:
            raise DataError(
                f"Press {press.number} ends at sample {press.end}, but only {self._written} are written."
            )
        if not self._presses_left:
            raise InstrumentError(f"{self.path} has no space for further attempts: record fewer presses.")
        self._put(row, self._presses_at)
        self._presses_at += VERDICT.itemsize
        self._presses_left -= 1

    def close(self) -> None:
        """Sync and close the file, which stays a readable recording.

        May be called again. Raises InstrumentError when the disk refuses.
        """
        if self._file < 0:
            return
        self._closing = True
        self._due.set()
        self._thread.join()
        file, self._file = self._file, -1
        try:
            try:
                os.fsync(file)
                self._committed = self._written
            finally:
                os.close(file)
        except OSError as error:
            self._failure = error
        self._check()

    def _arm(self) -> int:
        """Create the file and open it. Raises ConfigurationError, and leaves no file."""
        size = self._capacity * self._dtype.itemsize
        made: os.stat_result | None = None
        try:
            # Entering removes what a killed program left, before the free space is asked for.
            with private_files(), whole_file(self.path) as temporary:
                free = shutil.disk_usage(self.path.parent).free
                # Twice the size: the finished copy is written beside this file before it replaces it.
                needed = 2 * size + _MARGIN
                if free < needed:
                    raise ConfigurationError(
                        f"The disk of {self.path.parent} has {free / 1e6:.0f} MB free, but this recording "
                        f"needs {needed / 1e6:.0f} MB: free some space, or record fewer presses."
                    )
                self._preallocate(temporary)
                made = temporary.stat()
            return os.open(self.path, os.O_RDWR | getattr(os, "O_BINARY", 0))
        except FileExistsError:
            raise ConfigurationError(existing(self.path)) from None
        except WRITE_ERRORS as error:
            with suppress(OSError):  # it may have its name already, and holds nothing
                if made and os.path.samestat(made, self.path.lstat()):
                    self.path.unlink()
            raise ConfigurationError(
                f"{self.path} cannot be preallocated ({os_error_text(error)}): "
                f"it needs {size / 1e6:.0f} MB in a writable folder."
            ) from None

    def _preallocate(self, temporary: Path) -> None:
        with created(temporary) as file:
            write_header(file, self.header, "recording")
            places = []
            for name, dtype, length in (
                ("events", EVENT, self._events_left),
                ("presses", VERDICT, self._presses_left),
                ("blocks", self._dtype, self._capacity),
            ):
                rows = file.create_dataset(name, shape=(length,), dtype=dtype, fill_time="never")
                # A first row gives it its place: on creation, HDF5 may put a part of the header behind it.
                rows[:1] = np.zeros(1, dtype)
                places.append((rows.id.get_offset(), length * dtype.itemsize))
        (self._events_at, _), (self._presses_at, _), (self._blocks_at, _) = places
        with temporary.open("r+b") as raw:
            for place, length in places:
                allocate(raw.fileno(), place, length)
        # Rows have a CRC each; the checksum is that of all that does not change while recording.
        add_checksum(temporary, "recording", without=places)

    def _put(self, data: bytes | memoryview, place: int) -> None:
        self._check()
        try:
            left = memoryview(data)
            while left:
                if hasattr(os, "pwrite"):
                    done = os.pwrite(self._file, left, place)
                else:
                    os.lseek(self._file, place, os.SEEK_SET)
                    done = os.write(self._file, left)
                if not done:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                # A disk that takes a part says why with the next part.
                left, place = left[done:], place + done
        except OSError as error:
            self._failure = error
            self._check()

    def _commit(self) -> None:
        kept = 0
        while True:
            self._due.wait(_COMMIT_PERIOD)
            self._due.clear()
            if self._closing:
                return
            reached = self._written
            if reached == kept:
                continue
            try:
                getattr(os, "fdatasync", os.fsync)(self._file)
            except OSError as error:
                self._failure = error
                return
            self._committed = kept = reached

    def _check(self) -> None:
        if self._failure is not None:
            raise InstrumentError(
                f"{self.path} could not be written ({os_error_text(self._failure)}); "
                f"its first {self._committed} samples are safe."
            ) from self._failure


def _mask(flags: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> int:
    """Pack flags into bits, the first channel lowest; channels from the 32nd on share the last bit."""
    return sum(1 << bit for bit in {min(i, 31) for i, flag in enumerate(flags.tolist()) if flag})


_BLOCK = 0.05
"""s of a block, as when presses are recorded."""


def write_recording(
    path: Path,
    header: Header,
    volts: FloatArray,
    events: Sequence[Event],
    judge: Callable[[Recording], Sequence[PressVerdict]],
) -> Recording:
    """Write (channels, samples) V, with events, and with the verdicts that `judge` gives of what is written.

    Raises ConfigurationError for an existing file or a bad folder or disk, InstrumentError when it fails.
    """
    block = max(1, round(_BLOCK * header.rate_hz))
    samples = volts.shape[1]
    with private_files():
        check_destination(path)
    none = np.zeros(len(volts), dtype=np.bool_)
    created = False
    with marked(path):
        try:
            with Writer(path, header, block, -(-samples // block) + 1, len(events)) as writer:
                created = True
                for first in range(0, samples, block):
                    writer.write(Block(first, volts[:, first : first + block], none), first / header.rate_hz)
                for event in events:
                    writer.note(*event)
                for verdict in judge(Recording.open(path)):
                    writer.write_verdict(verdict)
        except BaseException:
            if created:  # or the file is somebody else's, who was quicker
                with suppress(OSError):
                    path.unlink(missing_ok=True)
            raise
        finish(path)
    return Recording.open(path)
