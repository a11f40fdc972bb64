"""The signals of a recording in SI units, from the codes of its channels and the sensors of its rig.

Each is made part by part (`base/parts.py`), so that a recording of hours is read in flat memory. Whole arrays
are made on first use, and kept.

Model of the cap's vertical acceleration: an accelerometer shows it. A velocity is differentiated once, a
displacement twice, in the frequency domain: multiplied by j w, or (j w)^2, which multiplies noise as well. So
only a band is kept: up to the highest frequency at which the loudest parts of the recording stand above the
noise of the rest. Travel is positive downwards and the acceleration upwards, hence the sign. Assumed: the
rest shows the sensor's noise, presses are louder than that, and the noise does not change. What breaks it: a
resonance of the sensor beyond the band's end, which is not seen; a motor that runs while pressed only.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import BoolArray, FloatArray
from ...base.errors import DataError
from ...base.filters import fast_length
from ...base.parts import Parted, carried
from ...instruments import LinearSensor, Sensor, Sensors
from ...instruments.sensors import Restorer
from .file_format import CODES, Contents, Header, from_codes

_ORDERS = {"acceleration": 0, "velocity": 1, "displacement": 2}
"""Derivatives from each to the acceleration; the first that a recording has is used."""


class Signals(ABC):
    """Arrays (channels, samples); sample k of a channel was taken at (k + delay * rate_hz) / rate_hz seconds.

    Where a rest matters, it is the mean of the samples in which hands are off (`quiet`).
    """

    path: Path
    header: Header

    @property
    @abstractmethod
    def _contents(self) -> Contents:
        """Codes, blocks, events and verdicts."""

    @property
    @abstractmethod
    def sensors(self) -> Sensors:
        """Sensors of the rig at the time of recording."""

    @property
    @abstractmethod
    def quiet(self) -> slice:
        """Samples in which hands are off."""

    def __len__(self) -> int:
        """Samples of each channel."""
        return self.shape[1]

    @property
    def shape(self) -> tuple[int, int]:
        """(channels, samples) of `volts`."""
        return len(self.channels), int(self._contents.codes.shape[1])

    @property
    def rate_hz(self) -> float:
        """Samples per second and channel."""
        return self.header.rate_hz

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the rows of `volts`."""
        return self.header.channels

    @property
    def duration(self) -> float:
        """Duration (s)."""
        return len(self) / self.rate_hz

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

        Without an accelerometer a velocity or a displacement is differentiated, up to
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


_LEAST_HZ, _SHARE = 100.0, 0.4
"""Lowest upper edge of the band (Hz); highest, over the sample rate."""
_ABOVE = 4.0
"""Power over the rest's from which a frequency is part of the band."""
_SEGMENT = 0.1
"""s: length of the segments whose power is compared."""
_LOUD = 0.1
"""Part of the segments that is taken for presses: the loudest."""
_FADE = 0.2
"""Width of the band's upper edge, over its frequency."""


def differentiated(signal: FloatArray, order: int, rate_hz: float, rest: slice) -> tuple[FloatArray, float]:
    """Acceleration (samples,) of a velocity or an upward displacement, and the band's upper edge (Hz)."""
    edge = _edge(signal, order, rate_hz, rest)
    pad = round(0.25 * rate_hz)
    # A straight line between the ends has no derivative within the band, and leaves no jump.
    padded = np.pad(signal - (signal.mean() if len(signal) else 0.0), pad, mode="reflect", reflect_type="odd")
    length = fast_length(len(padded))
    spectrum = np.fft.rfft(padded, length)
    f = np.asarray(np.fft.rfftfreq(length, 1 / rate_hz))
    spectrum *= (2j * np.pi * f) ** order * _passed(f, edge)
    return np.asarray(np.fft.irfft(spectrum, length)[pad : pad + len(signal)]), edge


def _passed(f: FloatArray, edge: float) -> FloatArray:
    return np.asarray(np.cos(np.pi / 2 * np.clip((f / edge - 1) / _FADE, 0, 1)) ** 2)


def _edge(signal: FloatArray, order: int, rate_hz: float, rest: slice) -> float:
    """Upper edge of the band in which the loudest segments stand above the rest."""
    import scipy  # noqa: PLC0415  a recording that is verified or listed needs none

    width, most = round(_SEGMENT * rate_hz), _SHARE * rate_hz
    segments, quiet = _powers(signal, width), _powers(signal[rest], width)
    if not len(segments) or not len(quiet):
        return most
    f = np.asarray(np.fft.rfftfreq(width, 1 / rate_hz))
    # Loudness is that of the acceleration, within what every sensor shows.
    weights = (2 * np.pi * f) ** (2 * order) * ((f > 20) & (f < 4 * _LEAST_HZ))
    loudest = np.argsort(segments @ weights)[-max(1, round(_LOUD * len(segments))) :]
    near = max(3, round(60 / (f[1] or 1.0)))
    loud, still = (
        scipy.ndimage.uniform_filter1d(powers.mean(axis=0), near) for powers in (segments[loudest], quiet)
    )
    within = (loud > _ABOVE * still) | (f < _LEAST_HZ)
    # From the band's lower end up to the first frequency that is lost in the noise.
    lost = np.flatnonzero(~within)
    return float(np.clip(f[lost[0]] if len(lost) else most, _LEAST_HZ, most))


def _powers(signal: FloatArray, width: int) -> FloatArray:
    """Power spectra of the signal's segments (segments, frequencies), each without its straight line."""
    count = len(signal) // width if width > 7 else 0
    segments = signal[: count * width].reshape(count, width)
    line = np.linspace(0, 1, width)
    ends = segments[:, :1] * (1 - line) + segments[:, -1:] * line if count else segments
    return np.asarray(np.abs(np.fft.rfft((segments - ends) * np.hanning(width), axis=1)) ** 2)
