"""Read one recording file: raw volts, and SI arrays that are computed on first use."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from ...base.arrays import BoolArray, FloatArray
from ...base.checksum import opened
from ...base.errors import DataError
from ...base.marks import is_marked
from ...base.notebook import InNotebook
from ...base.parts import Parted, carried
from ...instruments import LinearSensor, Sensor, Sensors
from ...instruments.sensors import Restorer
from .file_format import CODES, Contents, Header, from_codes, read_header
from .rejections import without_rejected
from .rows import Event, PressVerdict, events_in, verdicts_in
from .salvage import read_contents, tables
from .streams import AlongFile, AlongReading, RecordedStream, files_in, read_streams, readings_in

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

_ORDERS = {"acceleration": 0, "velocity": 1, "displacement": 2}
"""Derivatives from each to the acceleration; the first that a recording has is used."""


class Recording(InNotebook):
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

    def __len__(self) -> int:
        """Samples of each channel."""
        return self.shape[1]

    @property
    def shape(self) -> tuple[int, int]:
        """(channels, samples) of `volts`."""
        return len(self.channels), int(self._contents.codes.shape[1])

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
    def rate_hz(self) -> float:
        """Samples per second and channel."""
        return self.header.rate_hz

    @property
    def measured_hz(self) -> float:
        """Samples per second at which it was measured: below `rate_hz` in an import that was resampled."""
        return min(self.rate_hz, float(self.imported.get("rate_hz", np.inf)))

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the rows of `volts`."""
        return self.header.channels

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
    def duration(self) -> float:
        """Duration (s)."""
        return len(self) / self.rate_hz

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
        for name, value in vars(Recording).items():
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

    @cached_property
    def volts(self) -> FloatArray:
        """(channels, samples) V, as acquired."""
        return from_codes(self._contents.codes[:], self.header.full_scale)

    def volts_in(self, channels: Sequence[str], part: slice) -> FloatArray:
        """(channels, samples) V of some channels within some samples: `volts` converts all of them."""
        rows = [self.channels.index(name) for name in channels]
        return from_codes(self._contents.codes[rows, part], self.header.full_scale[rows])

    def has(self, quantity: str) -> bool:
        """True when force, acceleration, displacement, velocity or activation was measured."""
        return quantity in self.sensors.of_presses

    def in_parts(self, signal: str) -> Parted:
        """A signal that is made part by part as it is asked for, by its name below ("extra.NAME" of `extra`).

        With all signals in memory, a sample of ten channels takes 200 bytes. Raises DataError for a signal
        that there is not.
        """
        if signal not in self._parted:
            made: dict[str, Callable[[], Parted]] = {
                "force": partial(self._tared, "force"),
                "travel": partial(self._tared, "displacement"),
                "acceleration": self._acceleration,
                "velocity": self._velocity,
                "vertical": self._vertical,
                "activation": self._activation,
                "saturated": self._saturated,
                **{f"extra.{name}": partial(self._extra, name) for name in self.sensors.extra},
            }
            if signal not in made:
                raise DataError(f"{self.path} has no signal {signal!r}: ask for one of {', '.join(made)}.")
            self._parted[signal] = made[signal]()
        return self._parted[signal]

    @cached_property
    def _parted(self) -> dict[str, Parted]:
        return {}

    def _acceleration(self) -> Parted:
        sensor = self._linear("acceleration")
        rows = (len(sensor.axes),)
        return self._by_parts(lambda part: sensor.to_si(self.volts_in(sensor.channels, part)), rows=rows)

    def _velocity(self) -> Parted:
        sensor = self._linear("velocity")
        return self._by_parts(lambda part: sensor.along(self.volts_in(sensor.channels, part)))

    def _vertical(self) -> Parted:
        sensor = self.sensors.acceleration
        if sensor is None:
            return Parted.of(self._differentiated[0])
        row, sign, axes = sensor.row, sensor.sign, self.in_parts("acceleration")
        return self._by_parts(lambda part: axes[row, part] if sign > 0 else -axes[row, part])

    def _activation(self) -> Parted:
        sensor = self._sensor("activation")
        return self._by_parts(lambda part: sensor.to_si(self.volts_in(sensor.channels, part))[0])

    def _extra(self, name: str) -> Parted:
        sensor = self.sensors.extra[name]
        return self._by_parts(lambda part: sensor.to_si(self.volts_in([sensor.channel], part)[0]))

    def _saturated(self) -> Parted:
        def make(part: slice) -> BoolArray:
            none = np.zeros(part.stop - part.start, dtype=np.bool_)
            return np.asarray(np.any([none, *(edge[part] for edge in self._at_ends.values())], axis=0))

        return self._by_parts(make, bool)

    @cached_property
    def force(self) -> FloatArray:
        """(samples,) N along the press: from its rest (the mean during hands off), what fades restored."""
        return self.in_parts("force")[:]

    @cached_property
    def travel(self) -> FloatArray:
        """(samples,) m of the cap: from its rest, rising as it is pressed."""
        return self.in_parts("travel")[:]

    @cached_property
    def acceleration(self) -> FloatArray:
        """(axes, samples) m/s^2 along the accelerometer's axes."""
        return self.in_parts("acceleration")[:]

    @cached_property
    def velocity(self) -> FloatArray:
        """(samples,) m/s of the cap, positive upwards."""
        return self.in_parts("velocity")[:]

    @property
    def motion(self) -> str | None:
        """What `vertical` is from: "acceleration", "velocity" or "displacement"; None without any."""
        return next((quantity for quantity in _ORDERS if self.has(quantity)), None)

    @property
    def vertical(self) -> FloatArray:
        """(samples,) m/s^2: the vertical acceleration, with gravity where the sensor shows it.

        Without an accelerometer a velocity or a displacement is differentiated (`motion.py`), up to
        `motion_hz`. Raises DataError without any.
        """
        return self.in_parts("vertical")[:]

    @property
    def motion_hz(self) -> float | None:
        """Upper edge (Hz) of the band in which `vertical` was differentiated; None for an accelerometer."""
        return None if self.has("acceleration") else self._differentiated[1]

    @cached_property
    def activation(self) -> FloatArray:
        """(samples,): 1.0 where the contact is closed, 0.0 where it is open."""
        return self.in_parts("activation")[:]

    @cached_property
    def extra(self) -> dict[str, FloatArray]:
        """(samples,) of each channel of `[sensors.extra]`, in the unit stated there."""
        return {name: self.in_parts(f"extra.{name}")[:] for name in self.sensors.extra}

    @cached_property
    def saturated(self) -> BoolArray:
        """(samples,): True where a sensor, or its converter, was at the range end (not extra channels).

        A contact has two states and no range: its converter's end is one of them.
        """
        return self.in_parts("saturated")[:]

    def saturated_in(self, part: slice) -> tuple[str, ...]:
        """What was at the end of its range within samples: "force", "acceleration" and so on."""
        return tuple(name for name, edge in self._at_ends.items() if edge[part].any())

    @cached_property
    def _at_ends(self) -> dict[str, Parted]:
        """Samples (samples,) at which a sensor was at the end of its range, by what it measures."""
        found = {}
        for name, sensor in self.sensors.linear.items():
            rest = self._rest_of(sensor) if sensor.tared else None
            found[name] = self._by_parts(partial(self._at_end, sensor, rest), bool)
        return found

    def _at_end(self, sensor: LinearSensor, rest: FloatArray | None, part: slice) -> BoolArray:
        codes = self._contents.codes[self._indices(sensor), part]
        # The largest positive code is 32767, the largest negative one -32768.
        edge = np.any(np.abs(codes.astype(np.int32)) >= CODES - 1, axis=0)
        return np.asarray(edge | sensor.saturated(self.volts_in(sensor.channels, part), rest))

    def delay(self, quantity: str) -> float:
        """Delay (s) from a sample's clock edge to the instant of `quantity` that it shows.

        `quantity` is "force", "displacement", "velocity", "acceleration" (all along the press), "activation"
        or a name in `extra`. A multiplexed card samples its channels one after the other; the delay of
        several channels is their mean, weighted by their shares. A sensor's own delay (`delay` in the rig
        file) is earlier: what it shows has happened before.
        """
        if quantity in self.sensors.extra:
            return float(self.header.delays[self.channels.index(self.sensors.extra[quantity].channel)])
        sensor = self._sensor(quantity)
        delays = self.header.delays[self._indices(sensor)]
        if isinstance(sensor, LinearSensor):
            return float(np.average(delays, weights=np.abs(sensor.weights))) - sensor.transfer.delay
        return float(delays[-1])

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

    @cached_property
    def _differentiated(self) -> tuple[FloatArray, float]:
        """The vertical acceleration without an accelerometer, and the upper edge of its band (Hz)."""
        source = self.motion
        if source is None:
            raise DataError(
                f"{self.path} shows no motion: it was recorded without a sensor for acceleration, velocity "
                "or displacement."
            )
        signal = self.velocity if source == "velocity" else -self.travel
        # A recording that is verified or listed needs no scipy.
        from .motion import differentiated  # noqa: PLC0415

        return differentiated(signal, _ORDERS[source], self.rate_hz, self.quiet)

    def _tared(self, quantity: str) -> Parted:
        """(samples,) along the press, from the rest; what an AC-coupled sensor lets fade is restored."""
        sensor = self._linear(quantity)
        rest = self._rest_of(sensor)
        signal = self._by_parts(lambda part: sensor.along(self.volts_in(sensor.channels, part), rest))
        return carried(signal, Restorer(sensor, self.rate_hz)) if sensor.ac_coupled else signal

    def _rest_of(self, sensor: LinearSensor) -> FloatArray:
        """(channels,) V that a sensor's channels show at rest: weight and offset."""
        if not len(self):
            return np.zeros(len(sensor.channels))
        return np.asarray(self.volts_in(sensor.channels, self.quiet).mean(axis=1))

    def _by_parts(
        self, make: Callable[[slice], NDArray[Any]], dtype: type = float, rows: tuple[int, ...] = ()
    ) -> Parted:
        return Parted((*rows, len(self)), dtype, make)

    def _sensor(self, name: str) -> Sensor:
        sensor = self.sensors.of_presses.get(name)
        if sensor is None:
            raise DataError(f"{self.path} was recorded without a sensor for {name}.")
        return sensor

    def _linear(self, name: str) -> LinearSensor:
        sensor = self._sensor(name)
        assert isinstance(sensor, LinearSensor)
        return sensor

    def _indices(self, sensor: Sensor) -> list[int]:
        return [self.channels.index(name) for name in sensor.channels]
