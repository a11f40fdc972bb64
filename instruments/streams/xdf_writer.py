"""Write an XDF file (github.com/sccn/xdf, 1.0) chunk by chunk: what a kill leaves is readable up to there."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, BinaryIO
from xml.etree import ElementTree

import numpy as np

from ...base.arrays import FloatArray

FORMATS = {
    1: ("float32", "<f4"),
    2: ("double64", "<f8"),
    3: ("string", ""),
    4: ("int32", "<i4"),
    5: ("int16", "<i2"),
    6: ("int8", "<i1"),
    7: ("int64", "<i8"),
}
"""Of LSL's channel formats: the name in a header, and NumPy's type."""
_HEAD, _STREAM, _SAMPLES, _OFFSET = 1, 2, 3, 4
"""Tags of chunks."""


def header(
    name: str,
    kind: str,
    rate_hz: float,
    form: int,
    channels: Sequence[tuple[str, str]],
    source_id: str = "",
    desc: Mapping[str, object] = MappingProxyType({}),
) -> str:
    """Make a stream's header as LSL does. `rate_hz` is 0 without a steady rate; channels: labels and units.

    `desc` is what else there is to say of it.
    """
    info = ElementTree.Element("info")
    said = {"name": name, "type": kind, "channel_count": len(channels), "nominal_srate": rate_hz}
    said |= {"channel_format": FORMATS[form][0], "source_id": source_id}
    for key, value in said.items():
        ElementTree.SubElement(info, key).text = str(value)
    about = ElementTree.SubElement(info, "desc")
    for key, value in desc.items():
        ElementTree.SubElement(about, key).text = str(value)
    parts = ElementTree.SubElement(about, "channels")
    for label, unit in channels:
        channel = ElementTree.SubElement(parts, "channel")
        ElementTree.SubElement(channel, "label").text = label
        ElementTree.SubElement(channel, "unit").text = unit or "none"
    return "<?xml version='1.0'?>" + ElementTree.tostring(info, encoding="unicode")


class XdfWriter:
    """Writes into an open file, without a buffer of its own. Every method may raise OSError."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._file.write(b"XDF:")
        self._chunk(_HEAD, b"<?xml version='1.0'?><info><version>1.0</version></info>")

    def stream(self, number: int, xml: str) -> None:
        """Begin a stream, by the header that LSL has of it."""
        self._chunk(_STREAM, struct.pack("<I", number) + xml.encode())

    def samples(
        self, number: int, form: int, stamps: Sequence[float] | FloatArray, values: Sequence[Sequence[Any]]
    ) -> None:
        """Add samples: `form` is a key of `FORMATS`, `stamps` (samples,) s, `values` (samples, channels)."""
        head = struct.pack("<IBI", number, 4, len(stamps))
        if FORMATS[form][1]:
            kind = np.dtype([("bytes", "u1"), ("stamp", "<f8"), ("values", FORMATS[form][1], len(values[0]))])
            rows = np.empty(len(stamps), kind)
            rows["bytes"], rows["stamp"], rows["values"] = 8, stamps, np.reshape(values, rows["values"].shape)
            content = rows.tobytes()
        else:
            content = b"".join(
                struct.pack("<Bd", 8, stamp) + b"".join(map(_text, row))
                for stamp, row in zip(stamps, values, strict=True)
            )
        self._chunk(_SAMPLES, head + content)

    def offset(self, number: int, at: float, offset: float) -> None:
        """Add what a clock was measured to be behind the receiver's (s) at a time `at` of its own (s)."""
        self._chunk(_OFFSET, struct.pack("<Idd", number, at, offset))

    def _chunk(self, tag: int, content: bytes) -> None:
        self._file.write(b"\x04" + struct.pack("<IH", len(content) + 2, tag) + content)


def _text(value: str) -> bytes:
    data = value.encode()
    return b"\x04" + struct.pack("<I", len(data)) + data
