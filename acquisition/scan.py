"""From the blocks of an unfinished file to samples: finishing and recovering are this one scan."""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from acquisition.layout import CODES, EVENT, Codes, Event, Header, read_header, write_header
from acquisition.store import fresh_file
from instruments import ConfigurationError, DataError, InstrumentError

__all__ = ["Contents", "finish", "opened", "read_contents", "recover", "verify"]

BLOCK_INDEX = np.dtype([("first", "<i8"), ("count", "<u4"), ("overload", "<u4"), ("time", "<f8")])
"""What a finished file keeps of each block: where it began, which channels stood at the end of
their range, and when it arrived (s of the rig's clock)."""


@dataclass(frozen=True, eq=False)
class Contents:
    """All samples of a file, whichever state it is in.

    `codes` is (channels, samples). `stored_hash` is None for a file that was never finished.
    """

    codes: Codes
    blocks: NDArray[np.void]
    events: tuple[Event, ...]
    stored_hash: str | None


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """The file, open for reading, with DataError instead of what h5py raises for damage."""
    if not path.is_file():
        raise DataError(f"There is no recording {path}.")
    try:
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, KeyError, ValueError, RuntimeError, UnicodeDecodeError) as error:
        if isinstance(error, PermissionError):
            raise DataError(f"{path} may not be read by you: ask for its permissions.") from None
        raise DataError(_damage(path, str(error))) from None


def read_contents(path: Path) -> Contents:
    """Every valid sample of a recording, finished or not. Raises DataError."""
    with opened(path) as file:
        header, state = read_header(file, path)
        events = tuple(
            Event(int(e["sample"]), e["kind"].decode(), e["text"].decode(errors="replace"))
            for e in file["events"][:]
            if e["kind"]
        )
        if state != "recording":
            codes = np.asarray(file["codes"][:], dtype=np.int16)
            return Contents(codes, file["blocks"][:], events, str(file.attrs["content_hash"]))
        return Contents(*_valid(file["blocks"], len(header.channels)), events, None)


def finish(path: Path, state: str = "finished") -> None:
    """Turn a recording that has ended into its final form, in its own place, without the room left over.

    `state` is "interrupted" when it ended before all that was asked for. The new file is read back
    before it takes the old one's name. Raises DataError or InstrumentError; the unfinished file is
    then as it was.
    """
    with opened(path) as file:
        header, _ = read_header(file, path)
    contents = read_contents(path)
    _write_finished(path, header, contents, state, contents.events, replace=True)


def recover(path: str | Path) -> Path:
    """Make an interrupted recording whole, in a new file `<name>.recovered.h5`; `path` is not touched.

    What was saved and what was not stands in its last event. Raises ConfigurationError when there
    is nothing to recover or the new file exists, DataError when the file is damaged.
    """
    path = Path(path)
    with opened(path) as file:
        header, state = read_header(file, path)
        later = _later_blocks(file["blocks"]) if state == "recording" else 0
    if state != "recording":
        raise ConfigurationError(f"{path} holds all that was recorded; there is nothing to recover.")
    contents = read_contents(path)
    samples = contents.codes.shape[1]
    told = sum(event.kind == "pressed" for event in contents.events)
    text = f"Recovered {samples / header.rate_hz:.2f} s with {told} of {header.presses} presses" + (
        f"; {later} blocks behind a damaged one were left out." if later else "."
    )
    target = path.with_name(f"{path.stem}.recovered.h5")
    if target.exists():
        raise ConfigurationError(f"{target} exists and is never overwritten: move it away.")
    events = (*contents.events, Event(samples, "recovered", text))
    _write_finished(target, header, contents, "recovered", events, replace=False)
    return target


def verify(path: str | Path) -> tuple[str, ...]:
    """What is wrong with a recording, one sentence each; nothing when its samples are what was recorded.

    Checks the schema, the continuity and the content hash. Raises DataError for what cannot be read.
    """
    path = Path(path)
    with opened(path) as file:
        header, state = read_header(file, path)
        later = _later_blocks(file["blocks"]) if state == "recording" else 0
    contents = read_contents(path)
    problems = []
    if state == "recording":
        problems.append(f"{path} was interrupted; recover it.")
    elif contents.stored_hash != header.content_hash(contents.codes):
        problems.append(f"{path} was changed after it was recorded: its content hash does not match.")
    if later:
        problems.append(f"{path} has {later} blocks behind a damaged one.")
    if contents.codes.shape[0] != len(header.channels):
        problems.append(f"{path} has {contents.codes.shape[0]} rows for {len(header.channels)} channels.")
    ends = contents.blocks["first"] + contents.blocks["count"]
    starts = np.append(contents.blocks["first"], contents.codes.shape[1])
    if np.any(starts != np.insert(ends, 0, 0)):
        problems.append(f"{path} has a gap between two blocks.")
    return tuple(problems)


def _write_finished(
    path: Path, header: Header, contents: Contents, state: str, events: Sequence[Event], replace: bool
) -> None:
    content_hash = header.content_hash(contents.codes)
    try:
        with fresh_file(path, replace) as temporary:
            with h5py.File(temporary, "w") as file:
                write_header(file, header, state)
                file.attrs["content_hash"] = content_hash
                packed: dict[str, Any] = {
                    # A channel's samples resemble each other: row by row compresses twice as well.
                    "chunks": (1, min(contents.codes.shape[1], 1 << 16)),
                    "compression": "gzip",
                    "compression_opts": 4,
                    "shuffle": True,
                    "fletcher32": True,
                }
                # HDF5 has no chunks of nothing: what ended before its first block is stored plainly.
                codes = file.create_dataset(
                    "codes", data=contents.codes, **(packed if contents.codes.size else {})
                )
                codes.attrs["volts_per_code"] = header.full_scale / CODES
                file.create_dataset("blocks", data=contents.blocks)
                rows = [(e.sample, e.kind.encode()[:16], e.text.encode()[:232]) for e in events]
                file.create_dataset("events", data=np.array(rows, dtype=EVENT))
            if header.content_hash(read_contents(temporary).codes) != content_hash:
                raise DataError(f"{path} did not read back as it was written: check the disk.")
    except OSError as error:
        raise InstrumentError(
            f"The disk refused to write {path} ({error.strerror or error}); what was recorded is safe."
        ) from None


def _valid(blocks: h5py.Dataset, channels: int) -> tuple[Codes, NDArray[np.void]]:
    """The samples of the records from the first one on, up to the first that is not whole.

    Records behind a hole are left out: their time would be right, but a row may not have holes.
    """
    parts: list[Codes] = []
    rows: list[tuple[Any, ...]] = []
    samples = 0
    for record in _records(blocks):
        if not _whole(record) or record["first"] != samples:
            break
        count = int(record["count"])
        parts.append(record["samples"][:, :count].copy())
        rows.append(tuple(record[name] for name in BLOCK_INDEX.names or ()))
        samples += count
    codes = np.concatenate(parts, axis=1) if parts else np.zeros((channels, 0), dtype=np.int16)
    return codes.astype(np.int16, copy=False), np.array(rows, dtype=BLOCK_INDEX)


def _later_blocks(blocks: h5py.Dataset) -> int:
    """How many whole records stand behind the first one that is not."""
    whole = [_whole(record) for record in _records(blocks)]
    return sum(whole) - next((i for i, ok in enumerate(whole) if not ok), len(whole))


def _records(blocks: h5py.Dataset) -> Iterator[np.void]:
    """Records one after the other; a file that was laid out for an hour need not fit into memory."""
    step = max(1, (1 << 22) // blocks.dtype.itemsize)
    for start in range(0, len(blocks), step):
        yield from blocks[start : start + step]


def _whole(record: np.void) -> bool:
    return int(record["count"]) > 0 and zlib.crc32(record.tobytes()[:-4]) == int(record["crc"])


def _damage(path: Path, told: str) -> str:
    """One sentence for what HDF5 said of a file that it could not read."""
    size = path.stat().st_size if path.is_file() else 0
    # HDF5 finds in the file's beginning how long it should be, and says so among its own terms.
    cut = re.search(r"truncated file: .*stored_eof = (\d+)", told)
    if cut and int(cut[1]) > size:
        return f"{path} is cut short: {size} of {cut[1]} bytes are there. Copy it again from where it came."
    if size == 0:
        return f"{path} is cut short: it is empty. Copy it again from where it came."
    return f"{path} is damaged, or not a recording. Copy it again from where it came."
