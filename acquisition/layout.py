"""What stands in a recording file: the contract that docs/format.md states in words.

A file is in one of two states. While it is being recorded, `/blocks` is a contiguous dataset of
records laid out beforehand and filled in place; a finished file holds `/codes`, channel by channel
and compressed, instead. Everything else is the same in both, and written before the first sample.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from instruments import ConfigurationError, DataError
from instruments.arrays import BoolArray, FloatArray

__all__ = [
    "CODES",
    "EVENT",
    "FORMAT",
    "VERSION",
    "Codes",
    "Event",
    "Header",
    "block_dtype",
    "file_name",
    "from_codes",
    "read_header",
    "to_codes",
    "write_header",
]

FORMAT = "haploop recording"
VERSION = 1
CODES = 32768
"""Codes from 0 V to full scale: a sample is full_scale * code / CODES volts."""

Codes = NDArray[np.int16]

EVENT = np.dtype([("sample", "<i8"), ("kind", "S16"), ("text", "S232")])
"""An event: the sample that it belongs to, what kind it is of, and a sentence, both UTF-8."""

_PSEUDONYM = re.compile(r"[A-Za-z]{1,4}[0-9]{1,4}")
_BUTTON = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}")


class Event(NamedTuple):
    """Something that happened while recording, at a sample index."""

    sample: int
    kind: str
    text: str


@dataclass(frozen=True, eq=False)
class Header:
    """What is known before the first sample, and never changes."""

    button: str
    participant: str
    presses: int
    rig_name: str
    simulated: bool
    rate_hz: float
    channels: tuple[str, ...]
    full_scale: FloatArray
    """(channels,) V."""
    delays: FloatArray
    """(channels,) s: when a channel is sampled after its sample's clock edge."""
    rest: float
    """Seconds of hands off that the event "rest" ends."""
    rig: str
    """The rig file as it was, JSON."""
    daq: str
    """What the cards say they are."""
    software: str
    started: str
    """Date and time, ISO 8601 with the offset from UTC."""

    def content_hash(self, codes: Codes) -> str:
        """SHA-256 (hex) of the samples and of all that turns them into SI.

        `codes` is (channels, samples). Neither the date nor the version of the software is in it:
        the same samples have the same hash, before and after finishing or recovering a file.
        """
        essential: dict[str, Any] = {
            "button": self.button,
            "participant": self.participant,
            "simulated": self.simulated,
            "rate_hz": self.rate_hz,
            "channels": list(self.channels),
            "full_scale": self.full_scale.tolist(),
            "delays": self.delays.tolist(),
            "sensors": json.loads(self.rig).get("sensors"),
            "samples": int(codes.shape[1]),
        }
        digest = hashlib.sha256(json.dumps(essential, sort_keys=True).encode())
        digest.update(np.ascontiguousarray(codes, dtype="<i2").tobytes())
        return digest.hexdigest()


def block_dtype(channels: int, samples: int) -> np.dtype[np.void]:
    """One record of `/blocks`. `crc` is the CRC-32 of all bytes of the record before it."""
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


def file_name(participant: str, button: str) -> str:
    """`<participant>-<button>.h5`. Raises ConfigurationError, which states the rule that was broken."""
    if not _PSEUDONYM.fullmatch(participant):
        raise ConfigurationError(
            f"{participant!r} is not a participant's pseudonym: use one to four letters and then one to "
            "four digits, such as P01; never a name."
        )
    if not _BUTTON.fullmatch(button):
        raise ConfigurationError(
            f"{button!r} is not a button's name: use up to 40 letters, digits, '_' and '-', "
            "and begin with a letter or a digit, such as doorbell."
        )
    return f"{participant}-{button}.h5"


def to_codes(volts: FloatArray, full_scale: FloatArray) -> tuple[Codes, BoolArray]:
    """(channels, samples) V to the codes of a 16-bit converter, and (channels,): was one cut off?

    A card of at most 16 bits reports volts that are such codes, so nothing is rounded; what a
    driver has linearised in software is off by half a code at most.
    """
    codes = volts * (CODES / full_scale)[:, None]
    np.rint(codes, out=codes)
    beyond = (codes.min(axis=1, initial=0) < -CODES) | (codes.max(axis=1, initial=0) > CODES - 1)
    if beyond.any():
        np.clip(codes, -CODES, CODES - 1, out=codes)
    return codes.astype(np.int16), np.asarray(beyond)


def from_codes(codes: Codes, full_scale: FloatArray) -> FloatArray:
    """(channels, samples) codes to volts."""
    return codes * (full_scale / CODES)[:, None]


def write_header(file: h5py.File, header: Header, state: str) -> None:
    """Attributes of the root, and `/rig` for what may outgrow an attribute."""
    file.attrs.update({"format": FORMAT, "format_version": VERSION, "state": state})
    for key, value in asdict(header).items():
        if key == "rig":
            file.create_dataset("rig", data=value, dtype=h5py.string_dtype())
        elif key == "channels":
            file.attrs.create(key, list(value), dtype=h5py.string_dtype())
        else:
            file.attrs[key] = value


def read_header(file: h5py.File, path: Path) -> tuple[Header, str]:
    """The header and the file's state. Raises DataError for any other or a newer format."""
    if file.attrs.get("format") != FORMAT:
        raise DataError(f"{path} is an HDF5 file, but not a recording of haploop.")
    version = int(file.attrs["format_version"])
    if version > VERSION:
        raise DataError(
            f"{path} has the recording format {version}, and this haploop reads up to {VERSION}: update it."
        )
    a = file.attrs
    rig = file["rig"].asstr()[()]
    json.loads(rig)  # here a file that was damaged there is one that cannot be read
    header = Header(
        button=str(a["button"]),
        participant=str(a["participant"]),
        presses=int(a["presses"]),
        rig_name=str(a["rig_name"]),
        simulated=bool(a["simulated"]),
        rate_hz=float(a["rate_hz"]),
        channels=tuple(str(name) for name in a["channels"]),
        full_scale=np.asarray(a["full_scale"], dtype=np.float64),
        delays=np.asarray(a["delays"], dtype=np.float64),
        rest=float(a["rest"]),
        rig=rig,
        daq=str(a["daq"]),
        software=str(a["software"]),
        started=str(a["started"]),
    )
    return header, str(a["state"])
