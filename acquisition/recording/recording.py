"""Read one recording file: raw volts, SI arrays that are computed on first use, and presses rejected since.

A finished recording is never changed, so later rejections go into a file of their own, `rejections.json` in
the folder of the recordings.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from ...base.checksum import opened
from ...base.errors import DataError
from ...base.files import private_files
from ...base.json_files import append_json, read_json
from ...base.marks import is_marked
from ...base.notebook import InNotebook
from ...instruments import Sensors
from .file_format import Contents, Header, read_header
from .rows import Event, PressVerdict, events_in, verdicts_in
from .salvage import read_contents, tables
from .signals import Signals
from .streams import AlongFile, AlongReading, RecordedStream, files_in, read_streams, readings_in

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


_FILE, _KIND = "rejections.json", "rejections"


@dataclass(frozen=True)
class Rejection:
    """A press that was rejected after its session."""

    file: str
    """Name of the recording in the same folder."""
    sha256: str
    """Its content hash."""
    number: int
    attempt: int
    reason: str
    time: str
    """ISO 8601."""


def without_rejected(
    path: Path, content_hash: str, presses: Collection[PressVerdict]
) -> tuple[PressVerdict, ...]:
    """Apply later rejections to the verdicts of a recording. Raises DataError."""
    rejected = {}
    for one in _rejections(path.parent):
        if one.file != path.name:
            continue
        if one.sha256 != content_hash:
            raise DataError(
                f"{path} does not match its rejections: {path.parent / _FILE} states another content "
                f"hash. Restore the recording and its {_FILE} from the same copy."
            )
        rejected[one.number, one.attempt] = one.reason
    return tuple(
        press._replace(accepted=False, flags=(*press.flags, "rejected"), reason=f"Rejected: {rejected[key]}")
        if (key := (press.number, press.attempt)) in rejected
        else press
        for press in presses
    )


def add_rejections(folder: Path, rejections: Collection[Rejection]) -> None:
    """Add rejections of recordings in a folder, all or none; several programs may. Raises DataError."""
    with private_files():
        append_json(folder / _FILE, _KIND, [asdict(one) for one in rejections])


def _rejections(folder: Path) -> tuple[Rejection, ...]:
    path = folder / _FILE
    if not path.exists():
        return ()
    try:
        return tuple(Rejection(**entry) for entry in read_json(path, _KIND, list))
    except TypeError:
        raise DataError(f"{path} holds something else than rejections: restore it from a copy.") from None


class Recording(Signals, InNotebook):
    """One participant's presses of one button, as `Recording.open` reads them.

    Opening reads the header only. Arrays are (channels, samples); sample k of a channel was taken
    at (k + delay * rate_hz) / rate_hz seconds (`delay`). Each property that reads samples raises DataError
    for a damaged file, or one that was changed after it was finished (the content hash is compared on the
    first access).

    For example:

        >>> recording = haploop.Recording.open("data/P01-latch.h5")
        >>> recording.button, recording.force.shape == (len(recording),)
        ('latch', True)
    """

    def __init__(self, path: Path, header: Header, state: str) -> None:
        self.path = path
        self.header = header
        self._state = state
        self._in_progress = state == "recording" and is_marked(path)
        if state == "recording" and not self._in_progress:
            # It may have been finished between reading the header and the lock.
            with opened(path) as file:
                self.header, self._state = read_header(file, path)

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """Open a recording, finished or not. Raises DataError for any other or a damaged file."""
        path = Path(path)
        with opened(path) as file:
            return cls(path, *read_header(file, path))

    def __getstate__(self) -> dict[str, Any]:
        """What another process needs to read the file again; no sample goes to it."""
        return {name: vars(self)[name] for name in ("path", "header", "_state", "_in_progress")}

    def __repr__(self) -> str:
        simulated = ", simulated" if self.simulated else ""
        return f"<Recording {self.path.name}: {self.button} by {self.participant}, {self._state}{simulated}>"

    def to_pandas(self) -> pd.DataFrame:
        """DataFrame over `time` (s) with the columns `force`, `acceleration_x`, `_y` and `_z`, `travel`,
        `velocity`, `activation` and `saturated`: those that were measured.

        A column for each extra channel follows, and one `<instrument>_<name>` for each reading, with NaN in
        all rows without a reading. `attrs` has the units. Raises ConfigurationError without pandas.
        """
        from .export import data_frame  # noqa: PLC0415 - it imports this module

        return data_frame(self)

    def to_xarray(self) -> xr.Dataset:
        """Dataset with `force`, `travel`, `velocity`, `activation`, `saturated` over `time`, and
        `acceleration` over `axis`, `time`: those that were measured.

        Extra channels are over `time` too, and a reading `<instrument>_<name>` over
        `<instrument>_<name>_time`. Each variable has the attribute `units`; sampled variables also have
        `delay` (s, from the time of a sample to its own instant). Raises ConfigurationError without xarray.
        """
        from .export import dataset  # noqa: PLC0415 - it imports this module

        return dataset(self)

    @property
    def about(self) -> dict[str, str | float | bool]:
        """What the study file said of the participant: columns such as age, sex, handedness."""
        return dict(json.loads(self.header.about))

    @property
    def button(self) -> str:
        """Name of the button."""
        return self.header.button

    @property
    def participant(self) -> str:
        """Pseudonym of the participant."""
        return self.header.participant

    @property
    def rig(self) -> str:
        """Name of the rig."""
        return self.header.rig_name

    @property
    def imported(self) -> Mapping[str, Any]:
        """Origin of a recording of another program: file, sha256, rate_hz, mapping, notes; else empty."""
        return dict(json.loads(self.header.rig).get("imported", {}))

    @property
    def simulated(self) -> bool:
        """True when the rig was simulated."""
        return self.header.simulated

    @property
    def measured_hz(self) -> float:
        """Samples per second at which it was measured: below `rate_hz` in an import that was resampled."""
        return min(self.rate_hz, float(self.imported.get("rate_hz", np.inf)))

    @property
    def complete(self) -> bool:
        """True when every press was recorded and the file is finished."""
        return self._state == "finished"

    @property
    def state(self) -> str:
        """File state: "recording" (in progress or killed), "finished", "interrupted" or "recovered"."""
        return self._state

    @property
    def in_progress(self) -> bool:
        """True when a running program was recording the file when it was opened."""
        return self._in_progress

    @property
    def events(self) -> list[Event]:
        """Events of the recording, each with sample index, kind and a sentence."""
        return list(events_in(self._contents.events))

    @property
    def readings(self) -> tuple[AlongReading, ...]:
        """Numbers from instruments recorded along, each at its sample index."""
        return readings_in(self.events)

    @property
    def files(self) -> tuple[AlongFile, ...]:
        """Files from instruments recorded along, each at its sample index."""
        return files_in(self.events)

    @cached_property
    def streams(self) -> Mapping[str, RecordedStream]:
        """Streams of other programs that were recorded along, by their names in the rig file: values, the
        sender's stamps and corrections, and the time of each sample in this recording.

        Raises ConfigurationError without pyxdf, DataError for a file that is missing or was changed.
        """
        return read_streams(self.path.parent, self.files, self.blocks, self.rate_hz)

    @property
    def verdicts(self) -> tuple[PressVerdict, ...]:
        """Final verdict on each attempt at each press, in order.

        Presses rejected afterwards (`rejections.json` beside the file) have the flag `rejected`.
        """
        return without_rejected(self.path, self.content_hash, verdicts_in(self._contents.presses))

    def outline(self) -> tuple[tuple[PressVerdict, ...], str]:
        """`verdicts`, and the content hash as the file states it, without reading a sample.

        For many recordings at once. The file's bytes are compared with their checksum. Raises DataError.
        """
        if self._state == "recording":
            return self.verdicts, self.content_hash
        with opened(self.path) as file:
            _, presses = tables(file)
            stated = str(file.attrs["content_hash"])
        return without_rejected(self.path, stated, verdicts_in(presses)), stated

    @property
    def accepted(self) -> tuple[PressVerdict, ...]:
        """Verdicts of the accepted presses."""
        return tuple(press for press in self.verdicts if press.accepted)

    @property
    def rest(self) -> slice:
        """Samples at the beginning in which hands were off."""
        end = next((e.sample for e in self.events if e.kind == "rest"), None)
        length = max(1, round(self.header.rest * self.rate_hz))
        start = max(0, end - length) if end is not None else 0
        return slice(start, start + length)

    @property
    def quiet(self) -> slice:
        """Samples in which hands are off: `rest`, and in a part of a recording those before its press."""
        return self.rest

    @property
    def blocks(self) -> NDArray[np.void]:
        """Blocks as they arrived: first, count, overload (a bit per channel), time (s, rig's clock)."""
        return self._contents.blocks

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 of the samples, the metadata of their conversion to SI, the events and the verdicts."""
        return self._checked[1]

    def forget(self) -> None:
        """Free the samples and all signals; they are read and computed again when they are asked for.

        For many recordings at once: with all its signals, a sample of ten channels takes 200 bytes.
        """
        for name, value in (vars(Signals) | vars(Recording)).items():
            if isinstance(value, cached_property) and name not in ("content_hash", "sensors"):
                self.__dict__.pop(name, None)

    @cached_property
    def sensors(self) -> Sensors:
        """Sensors of the rig at the time of recording."""
        try:
            return Sensors.model_validate(json.loads(self.header.rig)["sensors"])
        except (ValidationError, ValueError, KeyError):
            raise DataError(
                f"{self.path} describes its sensors in a way that this haploop cannot read: update haploop."
            ) from None

    @property
    def _contents(self) -> Contents:
        return self._checked[0]

    @cached_property
    def _checked(self) -> tuple[Contents, str]:
        """The contents and their hash. Raises DataError when the file was changed after it was finished."""
        contents = read_contents(self.path)
        found = contents.hash(self.header)
        if contents.stored_hash not in (None, found):
            raise DataError(
                f"{self.path} was changed after it was finished: its content hash is {found}, but the file "
                f"states {contents.stored_hash[:64]}. Use an unchanged copy."
            )
        return contents, found
