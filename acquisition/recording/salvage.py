"""Salvage: read the intact blocks of a recording file. Reading, finishing and verifying all use it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from ...base import hdf5
from ...base.checksum import add_checksum, bounded, created, opened, unreadable
from ...base.errors import ConfigurationError, DataError, InstrumentError
from ...base.files import WRITE_ERRORS, existing, os_error_text, private_files, stamp, whole_file
from ...base.hdf5 import read_packed, write_packed
from ...base.json_files import is_json, json_hash
from ...base.line_files import check_marked, is_marks, line_problems
from ...base.marks import is_marked
from ...base.parts import Parted
from ...instruments.safety import log_problems
from .file_format import CODES, Contents, Header, read_header, write_header
from .rows import BLOCK, EVENT, VERDICT, Codes, block_dtype, events_in, finished_row, samples_crc, whole
from .streams import file_problems

Again = Callable[[], AbstractContextManager[h5py.File]]
"""Opens a recording once more, for a part of its samples."""
_KEPT = 32 << 20
"""Bytes of samples that stay in memory: every signal is made of them."""
CHUNK = 8192
"""Samples of a chunk of all channels. Within a chunk each channel's samples are contiguous, which halves the
compressed size."""


def read_contents(path: Path) -> Contents:
    """Every valid sample of a recording, finished or not, read as it is asked for. Raises DataError."""
    mark = stamp(path)
    with opened(path) as file:
        header, state = read_header(file, path)
        return _contents(file, header, state, partial(reopened, path, header, mark))


@contextmanager
def reopened(path: Path, header: Header, mark: tuple[int, ...]) -> Iterator[h5py.File]:
    """Open a recording again that was verified when its `stamp` was `mark`, and since then if it has changed.

    A recording that is going on grows, and is replaced by its finished form. Raises DataError.
    """
    if mark and stamp(path) == mark:
        # Comparing the checksum of the whole file for each part would take most of the time.
        with (
            unreadable(path, f"{path} cannot be read: copy it again from its source."),
            h5py.File(path, "r", locking=False) as file,
        ):
            yield file
        return
    with opened(path) as file:
        if read_header(file, path)[0].identity != header.identity:
            raise DataError(f"{path} is another recording now: open it again.")
        yield file


def _contents(file: h5py.File, header: Header, state: str, again: Again | None = None) -> Contents:
    if state == "recording":
        return read_blocks(file, header, again)
    blocks, events, presses = (_rows(file, name, kind) for name, kind in _TABLES)
    codes = _parted(file, header, _codes(file, header, blocks).shape[1], again)
    return Contents(codes, blocks, events, presses, str(file.attrs["content_hash"]))


def read_blocks(file: h5py.File, header: Header, again: Again | None = None) -> Contents:
    """Read every valid row of a file in the state "recording".

    Its samples are read from `again` as they are asked for, or from `file`, which is open until then.
    """
    blocks = _valid(file, len(header.channels))
    events, presses = tables(file)
    samples = int(blocks["count"].sum())
    return ending_at(Contents(_parted(file, header, samples, again), blocks, events, presses), samples)


def _parted(file: h5py.File, header: Header, samples: int, again: Again | None) -> Parted:
    """The first samples of a file: (channels, samples) of int16."""

    def read(part: slice) -> Codes:
        with nullcontext(file) if again is None else again() as source:
            return codes_between(source, header, part.start, part.stop)

    return Parted((len(header.channels), samples), np.int16, read, _KEPT)


def records_after(file: h5py.File, block: int, sample: int) -> Iterator[np.void]:
    """The intact records of a file in the state "recording" from `block` on, which begins at `sample`."""
    for record in _records(file["blocks"], block):
        if not _written(record) or record["first"] != sample:
            return
        sample += int(record["count"])
        yield record


def codes_between(file: h5py.File, header: Header, first: int, end: int) -> Codes:
    """Codes of samples `first` to `end` - 1 of a file in any state: (channels, samples)."""
    if "codes" in file:
        return read_packed(file["codes"], first, end)
    blocks = file["blocks"]
    size = blocks.dtype["samples"].shape[1]
    found = np.empty((len(header.channels), end - first), np.int16)
    at, reached = first // size, first  # blocks that are not full come later
    while reached < end:
        records = _step(blocks, at)
        at += len(records)
        if np.all(records["count"] == size):
            codes = records["samples"].transpose(1, 0, 2).reshape(len(found), -1)
        else:
            codes = np.concatenate([one["samples"][:, : one["count"]] for one in records], axis=1)
        begin = int(records["first"][0])
        low, reached = max(first, begin), min(end, begin + codes.shape[1])
        found[:, low - first : max(low, reached) - first] = codes[:, low - begin : max(low, reached) - begin]
    return found


def tables(file: h5py.File) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """The rows of events and of verdicts that were written completely."""
    events, presses = (_filled(_rows(file, name, kind)) for name, kind in _TABLES[1:])
    return events, presses


def intact_part(file: h5py.File, header: Header) -> Contents:
    """Read the intact blocks of a damaged file that was finished: those before the first other one."""
    rows, events, presses = (_filled(_rows(file, name, kind)) for name, kind in _TABLES)
    stored = _codes(file, header, rows, damaged=True)
    chunk, began, samples, kept = np.zeros((len(header.channels), 0), np.int16), 0, 0, 0
    for row in rows:
        end = samples + int(row["count"])
        try:
            while began + chunk.shape[1] < end:
                more = stored[:, began + chunk.shape[1] : began + chunk.shape[1] + CHUNK]
                if not more.shape[1]:
                    break
                chunk = np.concatenate([chunk[:, samples - began :], more], axis=1)
                began = samples
        except (OSError, RuntimeError, ValueError):
            break
        part = chunk[:, samples - began : end - began]
        if int(row["first"]) != samples or samples_crc(part) != int(row["samples_crc"]):
            break
        kept, samples = kept + 1, end
    return ending_at(Contents(_parted(file, header, samples, None), rows[:kept], events, presses), samples)


def ending_at(contents: Contents, samples: int) -> Contents:
    """Truncate contents to the blocks that end at sample `samples` or earlier."""
    blocks = contents.blocks[contents.blocks["first"] + contents.blocks["count"] <= samples]
    samples = int(blocks["count"].sum())
    return Contents(
        contents.codes.until(samples),
        blocks,
        contents.events[contents.events["sample"] <= samples],
        contents.presses[contents.presses["end"] <= samples],
    )


def finish(path: Path, state: str = "finished") -> None:
    """Replace the file of an ended recording by its final form, without the unused space.

    `state` is "interrupted" when the recording ended before every press was recorded. The new file is
    read back before it replaces the old one. On DataError or InstrumentError the unfinished file is
    unchanged.
    """
    mark = stamp(path)
    with opened(path) as file:
        header, before = read_header(file, path)
        again = partial(reopened, path, header, mark)
        contents = _contents(file, header, before, again)
    write_finished(path, header, contents, state, in_place=True)


def content_hash(path: str | Path) -> str:
    """Content hash stated in a file of any kind that haploop writes; of a log, that of all its bytes.

    A recording that is going on, or was interrupted, states none: then it is that of what it holds now.

    Raises DataError.
    """
    if Path(path).suffix == ".jsonl" and Path(path).is_file():
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    if is_json(Path(path)):
        return json_hash(Path(path))
    with opened(path) as file:
        if "content_hash" in file.attrs:
            return str(file.attrs["content_hash"])
        header, _ = read_header(file, Path(path))
        return read_blocks(file, header).hash(header)


def verify(path: str | Path) -> tuple[str, ...]:
    """Verify a file written by haploop; return one sentence for each problem, none when it is intact.

    Compares the checksum and the content hash, and the continuity of a recording. Raises DataError for a
    file that is damaged, was changed or lost its end; an unfinished recording can have damaged rows and still
    be read, and an audit log damaged lines. The log of a session that is not complete is such a problem.

    For example:

        >>> haploop.verify("data/P01-latch.h5")
        ()
    """
    path = Path(path)
    if path.match("log-*.jsonl") and path.is_file():
        return log_problems(path)
    if path.suffix == ".jsonl" and path.is_file():
        return line_problems(path)
    if is_json(path):
        json_hash(path)
        if is_marks(path):
            check_marked(path)
        return ()
    if (kind := hdf5.kind_of(path)) != "recording":
        hdf5.read(path, kind)
        return ()
    with opened(path) as file:
        header, state = read_header(file, path)
        later = later_rows(file) if state == "recording" else {}
        contents = _contents(file, header, state)
        intact = state == "recording" or contents.stored_hash == contents.hash(header)
    problems = []
    if state == "recording" and is_marked(path):
        problems.append(f"{path} is being recorded now: verify it when the session has ended.")
    elif state == "recording":
        problems.append(f"{path} was interrupted: `haploop recover` salvages it into a finished file.")
        problems += [f"{path} has {number} {name} after damaged ones." for name, number in later.items()]
    elif not intact:
        raise DataError(f"{path} was changed after it was recorded: its content hash does not match.")
    ends = contents.blocks["first"] + contents.blocks["count"]
    starts = np.append(contents.blocks["first"], contents.codes.shape[1])
    if np.any(starts != np.insert(ends, 0, 0)):
        problems.append(f"{path} has a gap between two blocks.")
    if np.any(contents.presses["end"] > contents.codes.shape[1]):
        problems.append(f"{path} has a press that ends after its last sample.")
    problems += file_problems(events_in(contents.events), path.parent)
    return tuple(problems)


def write_finished(path: Path, header: Header, contents: Contents, state: str, in_place: bool) -> None:
    """Write a recording in its final form, and read it back before it takes the name `path`.

    Raises InstrumentError when the disk refuses, DataError when the content read back differs,
    ConfigurationError when `path` exists and not `in_place`.
    """
    content_hash = contents.hash(header)
    try:
        with private_files(), whole_file(path, replace=in_place) as temporary:
            with created(temporary) as file:
                write_header(file, header, state)
                file.attrs["content_hash"] = content_hash
                # The samples come last and in time order, so that a truncated file loses only its end.
                file.create_dataset("blocks", data=contents.blocks)
                file.create_dataset("events", data=contents.events)
                file.create_dataset("presses", data=contents.presses)
                channels, samples = contents.codes.shape
                scale = {"volts_per_code": header.full_scale / CODES}
                if samples:
                    chunks = channels, min(samples, CHUNK)
                    write_packed(file, "codes", contents.codes, chunks, fletcher32=True, attributes=scale)
                else:  # HDF5 has no empty chunks
                    file.create_dataset("codes", data=contents.codes).attrs.update(scale)
            add_checksum(temporary, "recording")
            if not _same(read_contents(temporary), contents):
                raise DataError(f"{path} read back with other content than was written: check the disk.")
    except FileExistsError:
        raise ConfigurationError(existing(path)) from None
    except WRITE_ERRORS as error:
        raise InstrumentError(
            f"{path} could not be written ({os_error_text(error)}); the recorded samples are safe."
        ) from None


def _same(some: Contents, others: Contents) -> bool:
    """Whether two files hold the same samples, blocks, events and verdicts."""
    return (
        some.codes.shape == others.codes.shape
        and all(getattr(some, name).tobytes() == getattr(others, name).tobytes() for name, _ in _TABLES)
        and all(np.array_equal(some.codes[:, part], others.codes[:, part]) for part in some.codes.parts())
    )


def later_rows(file: h5py.File) -> dict[str, int]:
    """Number of intact blocks, events and presses after the first damaged one, by name where any."""
    written = {"blocks": map(_written, _records(file["blocks"]))}
    written |= {name: map(whole, _rows(file, name, kind)) for name, kind in _TABLES[1:]}
    # `all` stops at the first that is not.
    later = {name: 0 if all(rows) else sum(rows) for name, rows in written.items()}
    return {name: number for name, number in later.items() if number}


_TABLES = (("blocks", BLOCK), ("events", EVENT), ("presses", VERDICT))


def _rows(file: h5py.File, name: str, kind: np.dtype[np.void]) -> NDArray[np.void]:
    """Read a table. Raises ValueError for another type, or more rows than the file can hold."""
    rows = bounded(file[name], file.id.get_filesize())
    if rows.dtype != kind or rows.ndim != 1:
        raise ValueError(name)
    return np.asarray(rows[:])


def _codes(file: h5py.File, header: Header, blocks: NDArray[np.void], damaged: bool = False) -> h5py.Dataset:
    """The samples of a finished file. Raises ValueError for more than its blocks and chunks hold."""
    codes, shape = file["codes"], (len(header.channels), int(blocks["count"].sum()))
    if damaged:
        shape = (shape[0], codes.shape[1])
    width = min(shape[1], CHUNK)
    if (
        codes.shape != shape
        or codes.dtype != np.int16
        or codes.chunks != ((shape[0], width) if width else None)
    ):
        raise ValueError("codes")
    if width and not damaged and codes.id.get_num_chunks() * width < shape[1]:
        raise ValueError("codes")
    return codes


def _valid(file: h5py.File, channels: int) -> NDArray[np.void]:
    """The rows of `BLOCK` of the records before the first damaged one.

    Records after a gap are left out, because a channel must not have gaps.
    """
    stored = bounded(file["blocks"], file.id.get_filesize())
    if stored.dtype != block_dtype(channels, stored.dtype["samples"].shape[1]):
        raise ValueError("blocks")
    rows = bytearray()
    for record in records_after(file, 0, 0):
        rows += finished_row(record).tobytes()
    return np.frombuffer(rows, BLOCK)


def _filled(rows: NDArray[np.void]) -> NDArray[np.void]:
    """The rows that were written completely."""
    return np.array([row for row in rows if whole(row)], dtype=rows.dtype)


def _records(blocks: h5py.Dataset, first: int = 0) -> Iterator[np.void]:
    """Read the records in steps, because a file preallocated for an hour may not fit into memory."""
    while len(records := _step(blocks, first)):
        first += len(records)
        yield from records


def _step(blocks: h5py.Dataset, first: int) -> NDArray[np.void]:
    """A megabyte of records."""
    return np.asarray(blocks[first : first + max(1, (1 << 20) // blocks.dtype.itemsize)])


def _written(record: np.void) -> bool:
    """True when a block was written. An empty record has a count of 0, which is fast to test."""
    return int(record["count"]) > 0 and whole(record)
