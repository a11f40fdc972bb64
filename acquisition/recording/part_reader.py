"""Read a recording part by part, also while it is being written."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np

from ...base.arrays import FloatArray
from ...base.checksum import opened
from ...base.errors import DataError
from ...base.files import stamp
from ...instruments import LinearSensor
from ...instruments.sensors import Restorer
from .file_format import Header, from_codes, read_header
from .recording import Recording, without_rejected
from .rows import Event, PressVerdict, events_in, verdicts_in
from .salvage import codes_between, records_after, reopened, tables


class PartReader:
    """Reads what was added to a recording since the last look, and parts of it. For any thread.

    A look at a session of half an hour costs as much as at one of a minute, where a `Recording` reads all of
    it into memory. A finished file is verified as a whole, once. Raises DataError for a file that is no
    recording, damaged, or was changed after it was finished.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._looking = threading.Lock()
        self._begin()

    def _begin(self) -> None:
        recording = Recording.open(self.path)
        self.header: Header = recording.header
        self.state = "recording"
        self.samples = 0
        """Samples of each channel up to the last look, each in a block with the right CRC."""
        self.events: tuple[Event, ...] = ()
        self._verdicts: tuple[PressVerdict, ...] = ()
        self._hash = ""
        self._verified: tuple[int, ...] = ()
        """What the file system says of a finished file that was verified."""
        self._blocks = 0
        self._zeros: dict[str, FloatArray] = {}
        self._sensors = recording.sensors

    @property
    def verdicts(self) -> tuple[PressVerdict, ...]:
        """See `Recording.verdicts`."""
        return without_rejected(self.path, self._hash, self._verdicts) if self._hash else self._verdicts

    def look(self) -> None:
        """Read, and verify, what was added since the last look."""
        with self._looking:
            if self._hash and stamp(self.path) == self._verified:
                return
            with opened(self.path) as file:
                header, state = read_header(file, self.path)
                if self._hash or header.identity != self.header.identity:
                    self._begin()  # another recording has the name now
                self.state = state
                if state == "recording":
                    for record in records_after(file, self._blocks, self.samples):
                        self._blocks += 1
                        self.samples += int(record["count"])
                    events, presses = tables(file)
                    self.events = events_in(events[events["sample"] <= self.samples])
                    self._verdicts = verdicts_in(presses[presses["end"] <= self.samples])
                    return
            mark, whole = stamp(self.path), Recording.open(self.path)
            self.samples = round(whole.duration * whole.rate_hz)
            self.events, self._hash = tuple(whole.events), whole.content_hash
            self._verdicts, self._verified = whole.verdicts, mark

    def has(self, quantity: str) -> bool:
        """See `Recording.has`."""
        return quantity in self._sensors.of_presses

    def along(self, quantity: str, first: int, end: int) -> FloatArray:
        """(samples,) of samples `first` to `end` - 1 of a linear sensor along the press, of this part alone.

        A force and a displacement are from their rest; what fades in an AC-coupled one is restored from the
        part's first sample on.
        """
        sensor, volts = self._sensor(quantity), self._volts(quantity, first, end)
        if not sensor.tared:
            return sensor.along(volts)
        signal = sensor.along(volts, self._rest_of(quantity))
        return Restorer(sensor, self.header.rate_hz)(signal)

    def _rest_of(self, quantity: str) -> FloatArray:
        """(channels,) V that a sensor shows with hands off; kept once that is over."""
        known = self._zeros.get(quantity)
        if known is not None:
            return known
        at = next((event.sample for event in self.events if event.kind == "rest"), None)
        length = max(1, round(self.header.rest * self.header.rate_hz))
        begin = max(0, at - length) if at is not None else 0
        zero = np.asarray(self._volts(quantity, begin, begin + length).mean(axis=1))
        if at is not None:
            self._zeros[quantity] = zero
        return zero

    def _volts(self, name: str, first: int, end: int) -> FloatArray:
        rows = [self.header.channels.index(channel) for channel in self._sensor(name).channels]
        end = min(end, self.samples)
        with reopened(self.path, self.header, self._verified) as file:
            codes = codes_between(file, self.header, first, end)
        return from_codes(codes[rows], self.header.full_scale[rows])

    def _sensor(self, name: str) -> LinearSensor:
        sensor = self._sensors.linear.get(name)
        if sensor is None:
            raise DataError(f"{self.path} was recorded without a sensor for {name}.")
        return sensor
