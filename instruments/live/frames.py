"""Frames: the byte encoding of live blocks. Pure: no socket, no clock.

A frame is a magic number, the lengths of its two parts, a JSON header, and the volts as little-endian
float64, channel by channel. Other bytes, and frames larger than any block, raise DataError.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
import numpy.typing as npt

from ...base.errors import DataError
from ..sensors import Sensors
from ..vibrometer import QUANTITIES, Quantity
from .tap import LiveBlock, Run

_PREFIX = struct.Struct("<4sIQ")
_MAGIC = b"HLV1"
_LARGEST_HEADER = 1 << 20
_LARGEST_VOLTS = 1 << 30

PREFIX = _PREFIX.size
"""Length of a frame's prefix (bytes), for `lengths_of`."""
TOKEN = 64
"""Length of the token that a client sends before it receives any frame (bytes)."""


def frame_of(block: LiveBlock, dropped: int) -> tuple[bytes, memoryview]:
    """Encode prefix and header, and the volts, not copied. `dropped` blocks are missing before this one."""
    run = block.run
    header = {
        "rig": run.rig,
        "simulated": run.simulated,
        "number": run.number,
        "doing": run.doing,
        "about": run.about,
        "channels": run.channels,
        "rate_hz": run.rate_hz,
        "sensors": run.sensors.model_dump(mode="json"),
        "laser": run.laser,
        "first": block.first,
        "samples": block.end - block.first,
        "overload": [bool(flag) for flag in block.overload],
        "dropped": dropped,
    }
    text = json.dumps(header).encode()
    volts = np.ascontiguousarray(block.volts, dtype="<f8")
    return _PREFIX.pack(_MAGIC, len(text), volts.nbytes) + text, volts.reshape(-1).view(np.uint8).data


def lengths_of(prefix: bytes) -> tuple[int, int]:
    """Lengths of the header and of the volts (bytes). Raises DataError."""
    magic, header, volts = _PREFIX.unpack(prefix)
    if magic != _MAGIC or header > _LARGEST_HEADER or volts > _LARGEST_VOLTS:
        raise DataError(_foreign("its prefix is not one of haploop's"))
    return header, volts


def header_of(text: bytes) -> tuple[dict[str, Any], Run]:
    """Decode the header of a frame, and the run that it describes. Raises DataError."""
    try:
        header = json.loads(text)
        laser = header["laser"]
        run = Run(
            str(header["rig"]),
            bool(header["simulated"]),
            str(header["doing"]),
            str(header["about"]),
            tuple(str(name) for name in header["channels"]),
            float(header["rate_hz"]),
            Sensors.model_validate(header["sensors"]),
            None if laser is None else _laser(laser),
            int(header["number"]),
        )
        for key in ("first", "samples", "dropped"):
            if int(header[key]) < 0:
                raise ValueError(key)
        if len(header["overload"]) != len(run.channels) or not 0 < run.rate_hz < float("inf"):
            raise ValueError("overload")
    except (ArithmeticError, LookupError, StopIteration, TypeError, ValueError, RecursionError) as error:
        raise DataError(_foreign(f"its header cannot be read ({type(error).__name__})")) from None
    return header, run


def _laser(told: Any) -> tuple[str, float, Quantity]:
    """Raises ValueError, or another error of a wrong shape."""
    channel, scale, name = told
    return str(channel), float(scale), next(q for q in QUANTITIES if q == name)


def volts_of(header: dict[str, Any], run: Run, volts: bytes | npt.NDArray[np.uint8]) -> LiveBlock:
    """Decode the block of a frame. Raises DataError when the number of volts is not the header's."""
    shape = (len(run.channels), int(header["samples"]))
    size = len(volts)
    if size != 8 * shape[0] * shape[1]:
        raise DataError(_foreign(f"it has {size} bytes of volts for {shape[0]} x {shape[1]} samples"))
    array = np.frombuffer(volts, dtype="<f8").reshape(shape).astype(np.float64, copy=False)
    return LiveBlock(run, int(header["first"]), array, np.array(header["overload"], dtype=np.bool_))


def _foreign(why: str) -> str:
    return (
        f"What the live address sent is no block ({why}): use the same version of haploop in both programs."
    )
