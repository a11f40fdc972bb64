"""Salvage: read the intact blocks of a recording file. Reading, finishing and verifying all use it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from haploop.acquisition import hdf5
from haploop.acquisition.recording.file_format import (
    BLOCK,
    CODES,
    Codes,
    Contents,
    Header,
    events_in,
    read_header,
    whole,
    write_header,
)
from haploop.acquisition.recording.readings import file_problems
from haploop.instruments import ConfigurationError, DataError, InstrumentError
from haploop.instruments.files import existing, whole_file
from haploop.instruments.safety import is_marked

__all__ = [
    "CHUNK",
    "cut_short",
    "ending_at",
    "finish",
    "later_blocks",
    "opened",
    "read_blocks",
    "read_contents",
    "verify",
    "write_finished",
]

CHUNK = 8192
"""Samples of a chunk of all channels. Within a chunk each channel's samples are contiguous, which halves the
compressed size."""


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """Open a file for reading; raise DataError for the exceptions of h5py on a damaged file."""
    if not path.is_file():
        raise DataError(f"There is no recording {path}: check the name.")
    try:
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, KeyError, ValueError, RuntimeError, UnicodeDecodeError) as error:
        if isinstance(error, PermissionError):
            raise DataError(f"You have no permission to read {path}: ask its owner.") from None
        raise DataError(_damage(path, str(error))) from None


def read_contents(path: Path) -> Contents:
    """Read every valid sample of a recording, finished or not. Raises DataError."""
    with opened(path) as file:
        header, state = read_header(file, path)
        if state == "recording":
            return read_blocks(file, header)
        codes = np.asarray(file["codes"][:], dtype=np.int16)
        stored = str(file.attrs["content_hash"])
        return Contents(codes, file["blocks"][:], file["events"][:], file["presses"][:], stored)


def read_blocks(file: h5py.File, header: Header) -> Contents:
    """Read every valid row of a file in the state "recording"."""
    codes, blocks = _valid(file["blocks"], len(header.channels))
    contents = Contents(codes, blocks, _filled(file["events"]), _filled(file["presses"]))
    return ending_at(contents, codes.shape[1])


def ending_at(contents: Contents, samples: int) -> Contents:
    """Truncate contents to the blocks that end at sample `samples` or earlier."""
    blocks = contents.blocks[contents.blocks["first"] + contents.blocks["count"] <= samples]
    samples = int(blocks["count"].sum())
    return Contents(
        contents.codes[:, :samples],
        blocks,
        contents.events[contents.events["sample"] <= samples],
        contents.presses[contents.presses["end"] <= samples],
    )


def cut_short(told: str, size: int) -> int:
    """Full size (bytes) of a truncated file, from the error that HDF5 `told`; 0 if it is not truncated."""
    # An HDF5 file states its full size at its beginning; the library reports it in the error.
    cut = re.search(r"truncated file: .*stored_eof = (\d+)", told)
    return int(cut[1]) if cut and int(cut[1]) > size else 0


def finish(path: Path, state: str = "finished") -> None:
    """Replace the file of an ended recording by its final form, without the unused space.

    `state` is "interrupted" when the recording ended before every press was recorded. The new file is
    read back before it replaces the old one. On DataError or InstrumentError the unfinished file is
    unchanged.
    """
    with opened(path) as file:
        header, _ = read_header(file, path)
    contents = read_contents(path)
    write_finished(path, header, contents, state, in_place=True)


def verify(path: str | Path) -> tuple[str, ...]:
    """Verify a file written by haploop; return one sentence for each problem, none when it is intact.

    Checks the content hash, and the schema and continuity of a recording. Raises DataError for a file that
    cannot be read; only a recording can be damaged and still be read.
    """
    path = Path(path)
    if hdf5.is_stored(path):
        hdf5.read(path, hdf5.kind_of(path))
        return ()
    with opened(path) as file:
        header, state = read_header(file, path)
        later = later_blocks(file["blocks"]) if state == "recording" else 0
    contents = read_contents(path)
    problems = []
    if state == "recording" and is_marked(path):
        problems.append(f"{path} is being recorded now: verify it when the session has ended.")
    elif state == "recording":
        problems.append(f"{path} was interrupted: `haploop recover` salvages it into a finished file.")
    elif contents.stored_hash != contents.hash(header):
        problems.append(f"{path} was changed after it was recorded: its content hash does not match.")
    if later:
        problems.append(f"{path} has {later} blocks after a damaged block.")
    if contents.codes.shape[0] != len(header.channels):
        problems.append(f"{path} has {contents.codes.shape[0]} rows for {len(header.channels)} channels.")
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
        with whole_file(path, replace=in_place) as temporary:
            with h5py.File(temporary, "w") as file:
                write_header(file, header, state)
                file.attrs["content_hash"] = content_hash
                # The samples come last and in time order, so that a truncated file loses only its end.
                file.create_dataset("blocks", data=contents.blocks)
                file.create_dataset("events", data=contents.events)
                file.create_dataset("presses", data=contents.presses)
                channels, samples = contents.codes.shape
                packed: dict[str, Any] = {
                    "chunks": (channels, min(samples, CHUNK)),
                    "compression": "gzip",
                    "compression_opts": 4,
                    "shuffle": True,
                    "fletcher32": True,
                }
                # HDF5 has no empty chunks: a recording without a block is stored contiguously.
                codes = file.create_dataset("codes", data=contents.codes, **(packed if samples else {}))
                codes.attrs["volts_per_code"] = header.full_scale / CODES
            if read_contents(temporary).hash(header) != content_hash:
                raise DataError(f"{path} read back with other content than was written: check the disk.")
    except FileExistsError:
        raise ConfigurationError(existing(path)) from None
    except OSError as error:
        raise InstrumentError(
            f"{path} could not be written ({error.strerror or error}); the recorded samples are safe."
        ) from None


def _valid(blocks: h5py.Dataset, channels: int) -> tuple[Codes, NDArray[np.void]]:
    """Read the samples of the records before the first damaged one.

    Records after a gap are left out, because a channel must not have gaps.
    """
    parts: list[Codes] = []
    rows: list[tuple[Any, ...]] = []
    samples = 0
    for record in _records(blocks):
        if not _written(record) or record["first"] != samples:
            break
        count = int(record["count"])
        parts.append(record["samples"][:, :count].copy())
        rows.append(tuple(record[name] for name in BLOCK.names or ()))
        samples += count
    codes = np.concatenate(parts, axis=1) if parts else np.zeros((channels, 0), dtype=np.int16)
    return codes.astype(np.int16, copy=False), np.array(rows, dtype=BLOCK)


def _filled(rows: h5py.Dataset) -> NDArray[np.void]:
    """Read the rows that were written completely."""
    return np.array([row for row in rows[:] if whole(row)], dtype=rows.dtype)


def later_blocks(blocks: h5py.Dataset) -> int:
    """Number of intact records after the first damaged one."""
    found = [_written(record) for record in _records(blocks)]
    return sum(found) - next((i for i, ok in enumerate(found) if not ok), len(found))


def _records(blocks: h5py.Dataset) -> Iterator[np.void]:
    """Read the records in steps, because a file preallocated for an hour may not fit into memory."""
    step = max(1, (1 << 22) // blocks.dtype.itemsize)
    for start in range(0, len(blocks), step):
        yield from blocks[start : start + step]


def _written(record: np.void) -> bool:
    """True when a block was written. An empty record has a count of 0, which is fast to test."""
    return int(record["count"]) > 0 and whole(record)


def _damage(path: Path, told: str) -> str:
    """Explain in one sentence an HDF5 error on reading a file."""
    size = path.stat().st_size if path.is_file() else 0
    if length := cut_short(told, size):
        return (
            f"{path} is truncated: it has {size} of {length} bytes. Copy it again from its source, "
            "or salvage the intact part with `haploop recover`."
        )
    if size == 0:
        return f"{path} is truncated: it is empty. Copy it again from its source."
    return f"{path} is damaged, or not a recording. Copy it again from its source."
