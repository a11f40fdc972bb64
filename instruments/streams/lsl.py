"""Streams of other programs, recorded along by Lab Streaming Layer: an EEG, markers, a motion tracker.

A sample comes with its sender's stamp (s), by the clock of the sender's computer, which begins anywhere and
runs by a crystal of its own. What is to be added for LSL's clock of this computer, the correction, LSL
measures about every two seconds with packets that go there and back: it is wrong by half of what one way is
slower than the other. Here neither is touched. One XDF file for each stream keeps stamps and corrections, as
LabRecorder does, so that another correction can be computed later. Beside them, in the stream `CLOCK` of the
same file, lie pairs of times of LSL's clock and the rig's. A recording knows when its blocks arrived on the
rig's clock (`/blocks`), and so each sample has its place in it (`acquisition/recording/streams.py`).

What breaks it: a sender that stamps late, whose own delay is in no correction; a network that is slower one
way; and the least delay of the DAQ's blocks. None of the three shows in the data.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Self

import numpy as np
from pydantic import Field, model_validator

from ...base.bounded import Strict
from ...base.clock import Clock
from ...base.entry_points import optional
from ...base.errors import InstrumentError
from ..recorded_along import NewFile, Reading
from .xdf_writer import FORMATS, XdfWriter, header

CLOCK = "rig clock"
"""Name of the stream with the rig's clock (s) at stamps of LSL's clock of this computer."""
_RESOLVED_IN, _TRIES = 1.0, 3
"""Time in which every program of the network answers (s), and how often they are asked at the beginning."""
_OPENED_IN = 2.0
"""Longest wait for a stream's data, and for its description (s)."""
_CORRECTED_IN = 0.05
"""Longest wait for a correction that LSL has not measured yet (s)."""
_CHUNK = 4096
"""Samples that are taken at once."""
_SILENT = 2.0
"""Time without a sample of a regular stream that is told (s)."""
_GAP, _GAP_SAMPLES = 0.1, 5
"""A gap in the stamps of a regular stream that is told: longer than both, in s and in samples."""

_BINARY = getattr(os, "O_BINARY", 0)  # on Windows
_SHAPE = ("channel_format", "channel_count", "nominal_srate")
"""What a stream that comes back must have as before."""


class Wanted(Strict):
    """Which stream: what is given must be equal, and one stream alone may be so."""

    name: str | None = None
    type: str | None = None
    source_id: str | None = None

    @model_validator(mode="after")
    def _says_which(self) -> Self:
        if not self.given:
            raise ValueError("give at least one of name, type and source_id, as the sender states them")
        return self

    @property
    def given(self) -> Mapping[str, str]:
        """What is given."""
        return self.model_dump(exclude_none=True)

    def __str__(self) -> str:
        return " and ".join(f"{key} {value!r}" for key, value in self.given.items())


class LslStreams:
    """The role `streams` and its only driver; see this module, and `RecordedAlong`.

    Streams need not be there when the rig is opened: they are looked for when a recording begins.
    """

    reads_hz = 2.0

    class Settings(Strict):
        """The `[streams]` table of a rig file."""

        inlets: Annotated[
            dict[Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,19}$")], Wanted],
            Field(min_length=1, max_length=16),
        ]
        """Streams by names of one's own, which stand in the names of their files."""

    def __init__(self, settings: Settings, clock: Clock, library: Any) -> None:
        self._lsl = library
        self._receivers = [_Receiver(name, one, library, clock) for name, one in settings.inlets.items()]
        self.identity = "LSL"
        self.reads = tuple(read for one in self._receivers for read in one.reads)

    @staticmethod
    def hardware(settings: Settings) -> tuple[str, ...]:
        """See `Driver.hardware`: any number of programs may receive a stream."""
        return ()

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Load pylsl. Raises ConfigurationError without it."""
        return cls(settings, clock, optional("pylsl", "lsl", "The driver lsl"))

    def look(self) -> dict[str, str | InstrumentError]:
        """Look for each stream, and say what it is, or why it cannot be received."""
        found = self._resolved()
        said: dict[str, str | InstrumentError] = {}
        for one in self._receivers:
            try:
                said[one.name] = one.describe(found)
            except InstrumentError as error:
                said[one.name] = error
        return said

    def start(self, stem: Path, clock: Clock) -> None:
        """See `RecordedAlong.start`. Raises InstrumentError when a stream is not there."""
        found = self._resolved()
        for one in self._receivers:
            one.start(stem, found)

    def read(self) -> Sequence[Reading | NewFile]:
        """See `RecordedAlong.read`: samples go to the files. Raises InstrumentError for what was lost."""
        gaps, lost = list[Reading](), []
        found = self._lsl.resolve_streams(_RESOLVED_IN) if any(one.lost for one in self._receivers) else ()
        for one in self._receivers:
            try:
                gaps += one.receive(found)
            except InstrumentError as error:
                lost.append(str(error))
        if lost:
            raise InstrumentError(" ".join(lost))
        return gaps

    def stop(self) -> Sequence[Reading | NewFile]:
        """See `RecordedAlong.stop`: the files, and how many samples are in each."""
        return [told for one in self._receivers for told in one.stop()]

    def close(self) -> None:
        """Let go of every stream. May be called again."""
        for one in self._receivers:
            one.stop()

    def _resolved(self) -> Sequence[Any]:
        found: Sequence[Any] = ()
        for _ in range(_TRIES):
            found = self._lsl.resolve_streams(_RESOLVED_IN)
            if all(one.matching(found) for one in self._receivers):
                break
        return found


class _Receiver:
    """One stream, and its file."""

    def __init__(self, name: str, wanted: Wanted, library: Any, clock: Clock) -> None:
        self.name, self._wanted, self._lsl, self._clock = name, wanted, library, clock
        self.reads = (name, f"{name} samples", f"{name} gap")
        self._stem = Path()
        self._path = Path()
        self._file: BinaryIO | None = None
        self._inlet: Any = None
        self._info: Any = None
        """LSL's description of what the inlet is connected to."""
        self._number = 0
        """Of the connection among the streams of the file; 0 before its header is written."""
        self._written = 0
        """Streams in the file: the first is `CLOCK`, then one for each connection."""
        self._samples = 0
        self._correction = self._last = math.nan
        """The newest correction and stamp (s)."""
        self._heard = 0.0
        """When samples came (s of the rig's clock)."""

    @property
    def lost(self) -> bool:
        """True when it was there, and is not connected."""
        return self._inlet is None

    def matching(self, found: Sequence[Any]) -> list[Any]:
        """Those streams that are what is wanted."""
        given = self._wanted.given.items()
        return [info for info in found if all(getattr(info, key)() == value for key, value in given)]

    def describe(self, found: Sequence[Any]) -> str:
        """Say what the stream is. Raises InstrumentError unless there is one, and it sends."""
        self._connect(self._one(found))
        try:
            correction = self._lsl_call(lambda: self._inlet.time_correction(_OPENED_IN))
            info, rate_hz = self._info, self._info.nominal_srate()
            rate = f"{rate_hz:g} samples/s" if rate_hz else "no steady rate"
            count = info.channel_count()
            form, _ = FORMATS[info.channel_format()]
            channels = f"{count} channel{'s' * (count > 1)} of {form}"
            return (
                f"{info.name()!r} on {info.hostname()}: {channels}, {rate}; its clock is {-correction:+.4f} "
                "s from this computer's."
            )
        finally:
            self._inlet = None

    def start(self, stem: Path, found: Sequence[Any]) -> None:
        """Connect. The file is made when the first samples are read."""
        self._stem, self._written, self._samples = stem, 0, 0
        self._connect(self._one(found))

    def receive(self, found: Sequence[Any] = ()) -> list[Reading]:
        """Write what has come; tell a gap in it. One that was lost is looked for among those `found`.

        Raises InstrumentError when the stream is lost or silent.
        """
        file = self._opened()
        before = self._lsl.local_clock()
        now = self._clock.now()
        after = self._lsl.local_clock()
        file.samples(1, 2, [(before + after) / 2], [[now]])
        if self.lost:
            self._come_back(self.matching(found))
        if not self._number:
            self._number = self._written = self._written + 1
            file.stream(self._number, self._info.as_xml())
        gaps, more = [], True
        while more:
            values, stamps = self._lsl_call(lambda: self._inlet.pull_chunk(0.0, _CHUNK))
            more = len(stamps) == _CHUNK
            if stamps:
                file.samples(self._number, self._info.channel_format(), stamps, values)
                gaps.append(self._gap(stamps))
                self._samples += len(stamps)
                self._heard = now
        self._correct(file)
        if self._info.nominal_srate() and now - self._heard > _SILENT:
            raise InstrumentError(f"The stream {self.name} is there, but sends nothing: look at its program.")
        return [Reading(f"{self.name} gap", max(gaps), "s")] if any(gaps) else []

    def stop(self) -> list[Reading | NewFile]:
        """Write what is left, and let go of the stream; what there is to tell."""
        file, gaps = self._file, list[Reading]()
        try:
            if file is not None and not self.lost:
                gaps = self.receive()
        except InstrumentError:
            pass  # its last half second shows in the samples, which end before the recording
        finally:
            self._inlet = self._file = None
            if file is not None:
                file.close()
        if file is None:
            return []
        samples = Reading(f"{self.name} samples", self._samples, "samples")
        return [NewFile(self.name, self._path), samples, *gaps]

    def _one(self, found: Sequence[Any]) -> Any:
        """The stream that is wanted. Raises InstrumentError when there is none, or several."""
        those = self.matching(found)
        if len(those) == 1:
            return those[0]
        names = (f"{info.name()!r} (source_id {info.source_id()!r})" for info in those or found)
        named = ", ".join(sorted(names))
        if those:
            raise InstrumentError(
                f"{len(those)} LSL streams have the {self._wanted} of {self.name} in [streams]: {named}. "
                "Give its name or source_id too."
            )
        seen = f"LSL finds {named} only" if named else "LSL finds none at all"
        raise InstrumentError(
            f"There is no LSL stream with the {self._wanted} of {self.name} in [streams]; {seen}. Start the "
            "program that sends it, and let LSL through the firewall of both computers."
        )

    def _connect(self, found: Any) -> None:
        # Without LSL's own recovery, which is silent: a stream that was lost is told, and comes back as
        # another stream of the file, with corrections of its own.
        self._inlet = self._lsl.StreamInlet(found, recover=False)
        self._info = self._lsl_call(lambda: self._inlet.info(_OPENED_IN))
        self._lsl_call(lambda: self._inlet.open_stream(_OPENED_IN))
        self._number, self._correction, self._last = 0, math.nan, math.nan
        self._heard = self._clock.now()
        self._offset()  # LSL begins to measure

    def _come_back(self, those: Sequence[Any]) -> None:
        """Connect again. Raises InstrumentError unless the stream is there once, with the same channels."""
        if len(those) != 1:
            raise self._was_lost()
        before = self._info
        self._connect(those[0])
        if any(getattr(self._info, key)() != getattr(before, key)() for key in _SHAPE):
            self._inlet, self._info = None, before
            raise InstrumentError(
                f"The stream {self.name} came back with other channels, and is not recorded."
            )

    def _offset(self) -> float:
        """LSL's newest correction (s): NaN while it has not measured any."""
        try:
            return float(self._inlet.time_correction(_CORRECTED_IN))
        except RuntimeError:  # pylsl's time-out; what was lost is told when samples are taken
            return math.nan

    def _correct(self, file: XdfWriter) -> None:
        offset = self._offset()
        if not math.isnan(offset) and offset != self._correction:  # measured since
            self._correction = offset
            file.offset(self._number, self._lsl.local_clock() - offset, offset)

    def _gap(self, stamps: Sequence[float]) -> float:
        """The longest gap (s) before one of these stamps that is to be told; 0 without one."""
        steps = np.diff([self._last, *stamps])
        self._last = stamps[-1]
        rate_hz, longest = self._info.nominal_srate(), float(np.nanmax([0.0, *steps]))
        return round(longest, 4) if rate_hz and longest > max(_GAP, _GAP_SAMPLES / rate_hz) else 0.0

    def _opened(self) -> XdfWriter:
        """The file, which is made here. Raises InstrumentError."""
        number = 1
        while self._file is None:
            # Another number, after the files of a session that ended before its first press.
            name = f"{self._stem.name}-{self.name}{f'.{number}' * (number > 1)}.xdf"
            self._path = self._stem.with_name(name)
            try:
                self._file = _new_file(self._path)
            except FileExistsError:
                number += 1
            except OSError as error:
                raise InstrumentError(f"{self._path} cannot be written ({error.strerror}).") from None
            else:
                self._writer = XdfWriter(self._file)
                self._writer.stream(1, header(CLOCK, "Clock", 0, 2, [("rig", "s")]))
                self._writer.offset(1, self._lsl.local_clock(), 0.0)
                self._written = 1
        return self._writer

    def _lsl_call(self, call: Callable[[], Any]) -> Any:
        try:
            return call()
        except RuntimeError:  # pylsl's LostError and TimeoutError
            self._inlet = None
            raise self._was_lost() from None

    def _was_lost(self) -> InstrumentError:
        return InstrumentError(
            f"The stream {self.name} was lost: its program has ended, or the network is down."
        )


def _new_file(path: Path) -> BinaryIO:
    """Open a new file without a buffer. It is of people: its owner alone may read it, as the recording."""
    return os.fdopen(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY | _BINARY, 0o600), "wb", 0)
