"""The reader of one recording file: raw volts, and SI arrays that are computed when they are asked for."""

from __future__ import annotations

import json
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from haploop.acquisition.recording import export
from haploop.acquisition.recording.file_format import (
    CODES,
    Contents,
    Event,
    Header,
    PressVerdict,
    events_in,
    from_codes,
    read_header,
    verdicts_in,
)
from haploop.acquisition.recording.rejections import without_rejected
from haploop.acquisition.recording.salvage import opened, read_contents
from haploop.instruments import DataError, Sensor, Sensors
from haploop.instruments.arrays import BoolArray, FloatArray
from haploop.instruments.safety import is_marked

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

__all__ = ["Recording"]


class Recording:
    """One participant's presses of one button, as `Recording.open` reads them.

    Opening reads the header only. Arrays are (channels, samples); sample k of a channel was taken
    at (k + delay * rate_hz) / rate_hz seconds (`delay`). Any of them may raise DataError: when the
    file turns out to be damaged, or was changed after it was finished (its content hash is compared
    when its samples are first read).
    """

    def __init__(self, path: Path, header: Header, state: str) -> None:
        self.path = path
        self.header = header
        self._state = state
        self._in_progress = state == "recording" and is_marked(path)
        if state == "recording" and not self._in_progress:
            # It may have been finished between the two looks.
            with opened(path) as file:
                self.header, self._state = read_header(file, path)

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """A recording, finished or not. Raises DataError for what is not one, or is damaged."""
        path = Path(path)
        with opened(path) as file:
            return cls(path, *read_header(file, path))

    def __repr__(self) -> str:
        return f"<Recording {self.path.name}: {self.button} by {self.participant}, {self._state}>"

    @property
    def button(self) -> str:
        """The button that was pressed."""
        return self.header.button

    @property
    def participant(self) -> str:
        """The pseudonym of who pressed it."""
        return self.header.participant

    @property
    def rig(self) -> str:
        """The name of the rig that recorded it."""
        return self.header.rig_name

    @property
    def simulated(self) -> bool:
        """Whether that rig was simulated."""
        return self.header.simulated

    @property
    def rate_hz(self) -> float:
        """Samples per second and channel."""
        return self.header.rate_hz

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the rows of `volts`."""
        return self.header.channels

    @property
    def complete(self) -> bool:
        """Whether it ran to its end: every press was recorded, and the file is finished."""
        return self._state == "finished"

    @property
    def state(self) -> str:
        """The state in the file: "recording" (or killed), "finished", "interrupted" or "recovered"."""
        return self._state

    @property
    def in_progress(self) -> bool:
        """Whether a living program was recording it when it was opened."""
        return self._in_progress

    @property
    def duration(self) -> float:
        """Seconds."""
        return int(self._contents.codes.shape[1]) / self.rate_hz

    @property
    def events(self) -> list[Event]:
        """The events while recording, each with its sample index, its kind and a sentence."""
        return list(events_in(self._contents.events))

    @property
    def verdicts(self) -> tuple[PressVerdict, ...]:
        """The final verdict on each attempt at each press, in their order.

        Presses rejected afterwards (`rejections.jsonl` beside the file) have the flag `rejected`.
        """
        return without_rejected(self.path, self.content_hash, verdicts_in(self._contents.presses))

    @property
    def accepted(self) -> tuple[PressVerdict, ...]:
        """The presses that were accepted."""
        return tuple(press for press in self.verdicts if press.accepted)

    @property
    def blocks(self) -> NDArray[np.void]:
        """The blocks as they came: first, count, overload (a bit per channel), time (s, rig's clock)."""
        return self._contents.blocks

    @property
    def content_hash(self) -> str:
        """SHA-256 of the samples, of what turns them into SI, and of the events and verdicts."""
        return self._checked[1]

    @cached_property
    def sensors(self) -> Sensors:
        """The rig's sensors as they were."""
        try:
            return Sensors.model_validate(json.loads(self.header.rig)["sensors"])
        except (ValidationError, ValueError, KeyError):
            raise DataError(
                f"{self.path} describes its sensors in a way that this haploop cannot read: update haploop."
            ) from None

    @cached_property
    def volts(self) -> FloatArray:
        """(channels, samples) V, as acquired."""
        return from_codes(self._contents.codes, self.header.full_scale)

    @cached_property
    def force(self) -> FloatArray:
        """(samples,) N: Fz above the gauges' rest, which is their mean while hands were off."""
        return np.asarray(self._sensor("force").to_si(self._gauges)[2])

    @cached_property
    def acceleration(self) -> FloatArray:
        """(3, samples) m/s^2 along x, y, z."""
        sensor = self._sensor("acceleration")
        return sensor.to_si(self._rows(sensor))

    @cached_property
    def activation(self) -> FloatArray:
        """(samples,): 1.0 where the contact is closed, 0.0 where it is open."""
        sensor = self._sensor("activation")
        return np.asarray(sensor.to_si(self._rows(sensor))[0])

    @cached_property
    def saturated(self) -> BoolArray:
        """(samples,): a sensor or its converter was at the end of its range."""
        # 32767 is full scale on the way up; a card's last code on the way down is -32768.
        edge = np.any(np.abs(self._contents.codes.astype(np.int32)) >= CODES - 1, axis=0)
        accelerometer = self._sensor("acceleration")
        edge |= accelerometer.saturated(self._rows(accelerometer))
        return np.asarray(edge | self._sensor("force").saturated(self._gauges))

    def delay(self, quantity: str) -> float:
        """Seconds from a sample's clock edge to the instant that `quantity` was taken at.

        `quantity` is "force", "acceleration" (z) or "activation". A multiplexed card takes its
        channels one after the other; a force that several gauges carry belongs to the mean of
        their instants, weighted as they weigh in Fz.
        """
        sensor = self._sensor(quantity)
        delays = self.header.delays[self._indices(sensor)]
        if quantity == "force":
            weights = np.abs(np.asarray(self._fz_weights))
            return float(np.average(delays, weights=weights))
        return float(delays[-1])

    def to_xarray(self) -> xr.Dataset:
        """See `haploop.acquisition.recording.export.to_xarray`."""
        return export.to_xarray(self)

    def to_pandas(self) -> pd.DataFrame:
        """See `haploop.acquisition.recording.export.to_pandas`."""
        return export.to_pandas(self)

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
                f"states {contents.stored_hash}. Use an unchanged copy."
            )
        return contents, found

    @cached_property
    def _gauges(self) -> FloatArray:
        """(6, samples) V above rest: without the weight of the box and the offsets of the gauges."""
        gauges = self._rows(self._sensor("force"))
        if not gauges.size:
            return gauges
        end = next((e.sample for e in self.events if e.kind == "rest"), None)
        length = max(1, round(self.header.rest * self.rate_hz))
        start = max(0, end - length) if end is not None else 0
        return np.asarray(gauges - gauges[:, start : start + length].mean(axis=1, keepdims=True))

    @property
    def _fz_weights(self) -> tuple[float, ...]:
        force = self.sensors.force
        assert force is not None
        return force.matrix[2]

    def _sensor(self, name: str) -> Sensor:
        sensor: Sensor | None = getattr(self.sensors, name)
        if sensor is None:
            raise DataError(f"{self.path} was recorded without a sensor for {name}.")
        return sensor

    def _indices(self, sensor: Sensor) -> list[int]:
        return [self.channels.index(name) for name in sensor.channels]

    def _rows(self, sensor: Sensor) -> FloatArray:
        """(channels of the sensor, samples) V."""
        rows = self._indices(sensor)
        return from_codes(self._contents.codes[rows], self.header.full_scale[rows])
