"""The file format of a recording, as docs/reference/format.md specifies it.

A file is in one of two states. During recording, `/blocks`, `/events` and `/presses` are preallocated
contiguous datasets that are filled in place; a finished file holds `/codes`, channel by channel and
compressed, and only the filled records. The rest is the same in both states, and is written before the
first sample.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ...base.arrays import BoolArray, FloatArray
from ...base.errors import ConfigurationError, DataError
from ...base.parts import Parted
from .rows import Codes

FORMAT = "haploop recording"
VERSION = 5
CODES = 32768
"""Number of codes from 0 V to full scale: a sample is full_scale * code / CODES volts."""


_HELD = 128 << 20
"""Bytes of rows that are held while the row before them is hashed."""
_AGAIN = "Copy it again from its source."
_PSEUDONYM = re.compile(r"[A-Za-z]{1,4}[0-9]{1,4}")
_BUTTON = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}")


@dataclass(frozen=True, eq=False)
class Header:
    """Metadata of a recording: known before the first sample, never changed."""

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
    """(channels,) s: delay of each channel's sampling after the sample's clock edge."""
    rest: float
    """Seconds of hands off before the event "rest"."""
    rig: str
    """The rig file as it was, JSON."""
    daq: str
    """Identity reported by the cards."""
    software: str
    started: str
    """Date and time, ISO 8601 with the offset from UTC."""

    study: str = ""
    """Name of the study; "" outside a study."""
    session: str = ""
    """Number of the session within the study; "" outside a study."""
    protocol: str = "{}"
    """Prompt timing and acceptance limits (`Protocol`), JSON."""
    notes: str = ""
    """Operator's notes before the first press."""
    about: str = "{}"
    """What the study file says of the participant (age, sex, ...): columns and values, JSON."""

    @property
    def identity(self) -> tuple[str, ...]:
        """What tells a recording from others, also from those that began in the same second."""
        return self.started, self.participant, self.button, self.study, self.session


@dataclass(frozen=True, eq=False)
class Contents:
    """Contents of a file without its header, in either state.

    `codes` is (channels, samples) of int16; `blocks`, `events` and `presses` are the filled rows of `BLOCK`,
    `EVENT` and `VERDICT`. `stored_hash` is None for a file that was never finished.
    """

    codes: Parted
    blocks: NDArray[np.void]
    events: NDArray[np.void]
    presses: NDArray[np.void]
    stored_hash: str | None = None

    def hash(self, header: Header) -> str:
        """SHA-256 (hex) of the samples, the metadata of their conversion to SI, the events and the verdicts.

        It excludes the date, the software's version, the identity of the cards and the blocks' times: the
        same presses on the same simulated rig have the same hash.
        """
        essential: dict[str, Any] = {
            "about": header.about,
            "button": header.button,
            "channels": list(header.channels),
            "delays": header.delays.tolist(),
            "full_scale": header.full_scale.tolist(),
            "notes": header.notes,
            "participant": header.participant,
            "presses": header.presses,
            "protocol": header.protocol,
            "rate_hz": header.rate_hz,
            "rest": header.rest,
            "samples": int(self.codes.shape[1]),
            "sensors": json.loads(header.rig).get("sensors"),
            "session": header.session,
            "simulated": header.simulated,
            "study": header.study,
        }
        digest = hashlib.sha256(json.dumps(essential, sort_keys=True).encode())
        # Row by row, and stored chunk by chunk: of a long recording only some rows fit into memory.
        channels, samples = self.codes.shape
        more = _HELD // max(1, 2 * samples)
        for row in range(0, channels, 1 + more):
            held = np.empty((min(more, channels - row - 1), samples), "<i2")
            for part in self.codes.parts():
                codes = self.codes[:, part]
                digest.update(np.ascontiguousarray(codes[row], "<i2").data)
                held[:, part] = codes[row + 1 : row + 1 + len(held)]
            digest.update(held.reshape(-1).data)
        for column in ("first", "count", "overload"):
            digest.update(self.blocks[column].tobytes())
        digest.update(self.events.tobytes())
        digest.update(self.presses.tobytes())
        return digest.hexdigest()


def refuse_name(participant: str) -> None:
    """Raise ConfigurationError for a participant who is not named by a pseudonym: files are shared."""
    if not _PSEUDONYM.fullmatch(participant):
        raise ConfigurationError(
            f"{participant!r} is not a valid participant pseudonym: use one to four letters, then one to "
            "four digits, such as P01. Do not use a person's name."
        )


def file_name(participant: str, button: str, name: str = "") -> str:
    """`<participant>-<button>.h5`, or `<name>.h5`. Raises ConfigurationError for an invalid name."""
    refuse_name(participant)
    if not _BUTTON.fullmatch(button):
        raise ConfigurationError(
            f"{button!r} is not a valid button name: use up to 40 letters, digits, '_' and '-', "
            "beginning with a letter or a digit, such as doorbell."
        )
    if name and not _NAME.fullmatch(name):
        raise ConfigurationError(
            f"{name!r} is not a valid name for a recording's file: use up to 60 letters, digits, '_' "
            f"and '-', beginning with a letter or a digit, such as {participant}-{button}-2, without .h5."
        )
    return f"{name or f'{participant}-{button}'}.h5"


def codes_per_volt(full_scale: FloatArray) -> NDArray[np.float32]:
    """(channels, 1) codes of a volt, for `convert`."""
    return (CODES / full_scale).astype(np.float32)[:, None]


def to_codes(volts: FloatArray, full_scale: FloatArray) -> tuple[Codes, BoolArray]:
    """Convert (channels, samples) V to 16-bit codes; also return (channels,): True where one was clipped.

    The volts of a card of at most 16 bits are such codes, so nothing is rounded. Volts linearised by a
    driver in software are off by at most 0.504 of a code: the arithmetic is in float32 (24 bits: a code
    and 8 bits of fraction), which takes half the time. NaN counts as clipped.
    """
    codes = np.empty(volts.shape, np.int16)
    return codes, convert(volts, codes_per_volt(full_scale), codes, np.empty(volts.shape, np.float32))


def convert(
    volts: FloatArray, per_volt: NDArray[np.float32], codes: Codes, scratch: NDArray[np.float32]
) -> BoolArray:
    """Fill `codes` as `to_codes` says; return where one was clipped. `scratch` is overwritten.

    Nothing is allocated for a block but the answer.
    """
    np.copyto(scratch, volts, casting="same_kind")
    np.multiply(scratch, per_volt, scratch)
    np.rint(scratch, scratch)
    # All channels at once, which for short blocks takes a quarter of the time; NaN is neither.
    if scratch.size and not (_LEAST(scratch, None) >= -CODES and _MOST(scratch, None) <= CODES - 1):
        within = (_LEAST(scratch, 1) >= -CODES) & (_MOST(scratch, 1) <= CODES - 1)
        np.nan_to_num(scratch, copy=False, nan=-CODES)
        np.clip(scratch, -CODES, CODES - 1, out=scratch)
        beyond = ~within
    else:
        beyond = np.zeros(len(volts), dtype=bool)
    np.copyto(codes, scratch, casting="unsafe")
    return np.asarray(beyond)


_LEAST, _MOST = np.minimum.reduce, np.maximum.reduce


def from_codes(codes: Codes, full_scale: FloatArray) -> FloatArray:
    """Convert (channels, samples) codes to volts."""
    return codes * (full_scale / CODES)[:, None]


def write_header(file: h5py.File, header: Header, state: str) -> None:
    """Write the header: attributes of the root, and datasets for texts too long for an attribute."""
    file.attrs.update({"format": FORMAT, "format_version": VERSION, "state": state})
    file.attrs["header_hash"] = _header_hash(header, state)
    for key, value in asdict(header).items():
        if key in ("rig", "protocol", "notes", "about"):
            # Of a fixed length, and ASCII where it can be: GNU Octave reads no other text.
            raw, code = value.encode(), "ascii" if value.isascii() else "utf-8"
            file.create_dataset(key, data=raw, dtype=h5py.string_dtype(code, max(1, len(raw))))
        elif key == "channels":
            file.attrs.create(key, list(value), dtype=h5py.string_dtype())
        else:
            file.attrs[key] = value


def read_header(file: h5py.File, path: Path) -> tuple[Header, str]:
    """Read the header and the file's state.

    Raises DataError for any other format or version, and for a header that does not match its hash.
    """
    if file.attrs.get("format") != FORMAT:
        raise DataError(f"{path} is not a haploop recording.")
    version = int(file.attrs["format_version"])
    if version != VERSION:
        remedy = "update haploop" if version > VERSION else "read it with the haploop version that wrote it"
        raise DataError(
            f"{path} has recording format {version}, but this haploop reads format {VERSION}: {remedy}."
        )
    a = file.attrs
    rig = _text(file, "rig")
    if not isinstance(json.loads(rig), dict):  # checked here, so that a damaged rig is an unreadable file
        raise ValueError("rig")
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
        study=str(a["study"]),
        session=str(a["session"]),
        protocol=_text(file, "protocol"),
        notes=_text(file, "notes"),
        about=_text(file, "about"),
    )
    rows = len(header.channels)
    if header.full_scale.shape != (rows,) or header.delays.shape != (rows,) or not header.rate_hz > 0:
        raise ValueError("channels")
    state = str(a["state"])
    if str(a["header_hash"]) != _header_hash(header, state):
        raise DataError(f"{path} is damaged: its header does not match its hash. {_AGAIN}")
    return header, state


def _text(file: h5py.File, name: str) -> str:
    return str(file[name].asstr()[()])


def _header_hash(header: Header, state: str) -> str:
    """SHA-256 (hex) of a JSON object of the header's fields and the state."""
    plain = {
        key: value.tolist() if isinstance(value, np.ndarray) else value
        for key, value in asdict(header).items()
    }
    return hashlib.sha256(json.dumps(plain | {"state": state}, sort_keys=True).encode()).hexdigest()
