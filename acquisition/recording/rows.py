"""Rows of a recording's file: blocks of samples, events and press verdicts, each with its CRC.

docs/reference/format.md specifies them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import DataError

try:
    # The same CRC-32 as in zlib, with the processor's CRC instructions: eight times as fast.
    from isal.isal_zlib import crc32
except ImportError:  # no wheel for this processor
    from zlib import crc32

__all__ = [
    "BLOCK",
    "EVENT",
    "FLAGS",
    "VERDICT",
    "Codes",
    "Event",
    "PressVerdict",
    "block_dtype",
    "crc32",
    "event_row",
    "events_in",
    "finished_row",
    "samples_crc",
    "sealed",
    "verdict_row",
    "verdicts_in",
    "whole",
]

Codes = NDArray[np.int16]

EVENT = np.dtype([("sample", "<i8"), ("kind", "S16"), ("text", "S228"), ("crc", "<u4")])
"""An event: its sample index, its kind and a sentence; both texts are UTF-8."""

FLAGS = (
    "no-activation",
    "saturated",
    "force-range",
    "double",
    "not-quiet-before",
    "not-quiet-after",
    "rejected",
    "sensor",
)
"""Flags of a press; the position in this list is the bit in the file."""

VERDICT = np.dtype(
    [
        ("number", "<u4"),
        ("attempt", "<u4"),
        ("first", "<i8"),
        ("end", "<i8"),
        ("activation", "<f8"),
        ("force", "<f8"),
        ("flags", "<u4"),
        ("accepted", "<u4"),
        ("reason", "S204"),
        ("crc", "<u4"),
    ]
)
"""A press verdict: the fields of `PressVerdict`, and the CRC of all bytes before it."""

BLOCK = np.dtype(
    [
        ("first", "<i8"),
        ("count", "<u4"),
        ("overload", "<u4"),
        ("time", "<f8"),
        ("samples_crc", "<u4"),
        ("crc", "<u4"),
    ]
)
"""Block record of a finished file: first sample, number of samples, channels at the end of their range
(bit mask), time of arrival (s of the rig's clock), CRC of the samples, and CRC of all bytes before it."""


class Event(NamedTuple):
    """An event during recording, at a sample index."""

    sample: int
    kind: str
    text: str


class PressVerdict(NamedTuple):
    """The verdict on one press. A later verdict with the same number and attempt replaces it."""

    number: int
    """Number of the requested press, from 1."""
    attempt: int
    """Attempt at this press, from 1."""
    first: int
    """Index of the first sample."""
    end: int
    """End index (exclusive)."""
    activation: float
    """Instant of the activation (samples); NaN without one."""
    force: float
    """N at the activation; NaN without one."""
    accepted: bool
    flags: tuple[str, ...]
    """Subset of `FLAGS`, in their order."""
    reason: str
    """One sentence of at most 200 bytes of UTF-8; may be empty."""


def block_dtype(channels: int, samples: int) -> np.dtype[np.void]:
    """Data type of one record of `/blocks`. `crc` is the CRC-32 of all bytes of the record before it."""
    return np.dtype(
        [
            ("first", "<i8"),
            ("count", "<u4"),
            ("overload", "<u4"),
            ("time", "<f8"),
            ("samples", "<i2", (channels, samples)),
            ("crc", "<u4"),
        ]
    )


def sealed(row: NDArray[np.void]) -> bytes:
    """Set the `crc` of a row (CRC-32 of all bytes before it), and return the row's bytes."""
    raw = row.tobytes()
    row["crc"] = crc32(raw[:-4])
    return row.tobytes()


def whole(row: np.void) -> bool:
    """True when a row was written completely. An unfilled row is zeros, whose CRC is not 0."""
    return crc32(row.tobytes()[:-4]) == int(row["crc"])


def event_row(event: Event) -> bytes:
    """Encode an event as a row of the file; a text that is too long is truncated."""
    row = np.array((event.sample, _utf8(event.kind, 16), _utf8(event.text, 228), 0), dtype=EVENT)
    return sealed(row)


def finished_row(record: np.void) -> NDArray[np.void]:
    """Make the (1,) `BLOCK` row of a finished file from a block's record of an unfinished one."""
    row = np.zeros(1, BLOCK)
    for name in ("first", "count", "overload", "time"):
        row[name] = record[name]
    row["samples_crc"] = samples_crc(record["samples"][:, : int(record["count"])])
    sealed(row)
    return row


def samples_crc(codes: Codes) -> int:
    """CRC-32 of a block's samples: (channels, samples), row by row."""
    return crc32(np.ascontiguousarray(codes, dtype="<i2").data)


def events_in(rows: NDArray[np.void]) -> tuple[Event, ...]:
    """Decode the events in rows of `EVENT`."""
    return tuple(
        Event(int(row["sample"]), row["kind"].decode(errors="replace"), row["text"].decode(errors="replace"))
        for row in rows
    )


def verdict_row(press: PressVerdict) -> bytes:
    """Encode a verdict as a row of the file. Raises DataError for an unknown flag or a bad span."""
    unknown = [flag for flag in press.flags if flag not in FLAGS]
    if unknown:
        raise DataError(f"There is no press flag {unknown[0]!r}; the flags are {', '.join(FLAGS)}.")
    if press.number < 1 or press.attempt < 1 or not 0 <= press.first <= press.end:
        raise DataError(
            f"Press {press.number}, attempt {press.attempt}, from sample {press.first} to {press.end}: "
            "number and attempt must be at least 1, and the span must not end before it begins."
        )
    mask = sum(1 << FLAGS.index(flag) for flag in set(press.flags))
    row = np.array((*press[:6], mask, press.accepted, _utf8(press.reason, 200), 0), dtype=VERDICT)
    return sealed(row)


def verdicts_in(rows: NDArray[np.void]) -> tuple[PressVerdict, ...]:
    """Decode the verdicts in rows of `VERDICT`: the last row of each number and attempt, sorted."""
    last: dict[tuple[int, int], PressVerdict] = {}
    for row in rows:
        flags = tuple(flag for bit, flag in enumerate(FLAGS) if int(row["flags"]) >> bit & 1)
        press = PressVerdict(
            int(row["number"]),
            int(row["attempt"]),
            int(row["first"]),
            int(row["end"]),
            float(row["activation"]),
            float(row["force"]),
            bool(row["accepted"]),
            flags,
            row["reason"].decode(errors="replace"),
        )
        last[press.number, press.attempt] = press
    return tuple(last[key] for key in sorted(last))


def _utf8(text: str, length: int) -> bytes:
    """Encode at most `length` bytes of UTF-8, truncated between two characters."""
    return text.encode()[:length].decode(errors="ignore").encode()
