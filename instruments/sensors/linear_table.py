"""How a rig file describes a linear sensor, with the numbers of its data sheet.

A table becomes the value that everything else uses (`sensor`): its linear map is stated as `scale` (SI
per volt), as `sensitivity` (volts per SI, or text such as "100 mV/g"), or as `matrix`.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import BeforeValidator, Field

from ...base.bounded import Finite, NotNegative, Positive, Strict
from .sensor import LinearSensor, Motion
from .transfer import Measured, Root, Transfer
from .units import Dimensions, dimensions, value_of, with_unit

Stated = Finite | str
"""A number in SI, or a number with its unit."""


def in_units(*units: str) -> BeforeValidator:
    """Read text with one of these units as a number in SI; leave a number as it is."""

    def read(value: Any) -> Any:
        return value_of(value, *units) if isinstance(value, str) else value

    return BeforeValidator(read)


def _each(value: Any) -> Any:
    return value if isinstance(value, list | tuple) else [value]


Each = BeforeValidator(_each)
"""One value for all, or a list."""


class LinearTable(Strict):
    """A sensor whose channels are proportional to what it measures."""

    measures: ClassVar[Motion]
    per: ClassVar[str]
    """SI unit of what it measures."""
    most: ClassVar[int] = 1
    """Largest number of axes."""

    channels: Annotated[tuple[str, ...], Field(min_length=1, max_length=6)]
    """Channels of the DAQ, one for each axis unless there is a matrix."""
    axes: tuple[str, ...] | None = None
    """Axes that it measures, in order. Default: z for one; x, y, z for three."""
    vertical: str | None = None
    """Axis along which buttons are pressed, z by default; "-z" for a sensor mounted the other way round."""
    scale: Annotated[tuple[Stated, ...], Each] | None = None
    """Units per volt: a number in SI per V or text ("20 N/V"); one for all channels, or one for each."""
    sensitivity: Annotated[tuple[Stated, ...], Each] | None = None
    """The inverse, as data sheets have it: V per SI unit, or text ("100 mV/g", "2 mV/V", "-4.3 pC/N")."""
    zero: Annotated[tuple[Finite, ...], Each] = (0.0,)
    """V at 0; one for all channels, or one for each."""
    excitation: Positive | None = None
    """Supply of a bridge or an LVDT (V), whose sensitivity is relative to it."""
    amplifier: Annotated[Finite, in_units("V/C")] | None = None
    """Gain of a charge amplifier: V per C, or text ("10 mV/pC")."""
    gain: Finite = 1.0
    """Gain of a voltage amplifier between the sensor and the card."""
    range: Annotated[tuple[Any, ...], Each] | None = None
    """Largest magnitude: a number in SI, or text ("50 g"); one for all axes, or one for each."""
    output: Positive | None = None
    """Largest magnitude of the volts that the sensor can put out."""
    low_pass_hz: Positive | None = None
    """Corner of its low-pass (Hz); short for a pole."""
    high_pass_hz: Positive | None = None
    """Corner below which an AC-coupled sensor (IEPE, charge) shows nothing (Hz)."""
    time_constant: Positive | None = None
    """The same, as charge amplifiers state it (s): the corner is 1 / (2 pi time_constant)."""
    poles: tuple[Root, ...] = ()
    """Poles of its response: a frequency (Hz) for a real one, [frequency, damping ratio] for a pair."""
    zeros: tuple[Root, ...] = ()
    """Zeros, as poles."""
    frf: Measured | None = None
    """A measured response in place of poles: the name of a CSV file with columns of Hz, gain and degrees."""
    delay: NotNegative = 0.0
    """Delay of the sensor and its electronics (s)."""

    def sensor(self) -> LinearSensor:
        """The sensor that this describes. Raises ValueError with a clause."""
        axes, matrix = self._axes(), self._matrix()
        ranges = self._ranges()
        if ranges is not None and len(ranges) == 1:
            ranges *= len(axes)
        return LinearSensor(
            measures=self.measures,
            channels=self.channels,
            axes=axes,
            matrix=matrix,
            zero=self._of_each("zero", self.zero),
            range=ranges,
            output=self.output,
            vertical=self._vertical(axes),
            gravity=self._gravity(),
            transfer=self._transfer(),
            stated=self._stated(),
        )

    # What a kind of sensor may say otherwise

    def _matrix(self) -> tuple[tuple[float, ...], ...]:
        scales = self._of_each("scale or sensitivity", self._scales())
        return tuple(map(tuple, np.diag(scales).tolist()))

    def _gravity(self) -> bool:
        return False

    def _low_pass(self) -> float | None:
        return self.low_pass_hz

    def _voltage(self, value: float, found: Dimensions) -> float | None:
        """V per SI unit of a sensitivity with these dimensions; None for a unit that is not this sensor's."""
        if found == dimensions(f"V/({self.per})"):
            return value
        if found == dimensions(f"C/({self.per})"):
            if self.amplifier is None:
                raise ValueError(
                    "a sensitivity in coulombs needs the gain of its amplifier: amplifier = '1 mV/pC'"
                )
            self._need_high_pass("a charge amplifier")
            return value * self.amplifier
        return None

    def _needs(self) -> str:
        return f"V/({self.per})"

    # Common to all

    def _axes(self) -> tuple[str, ...]:
        known = ("x", "y", "z") if self.most < 6 else ("x", "y", "z", "rx", "ry", "rz")
        count = self._count()
        if count > self.most:
            raise ValueError(
                f"it has {count} channels, and a sensor of {self.measures} has at most {self.most}"
            )
        axes = self.axes or {1: ("z",), 3: known[:3], 6: known}.get(count)
        if axes is None:
            raise ValueError(f"it has {count} axes: name them, as axes = ['x', 'z']")
        if len(axes) != count or len(set(axes)) != count or not set(axes) <= set(known):
            raise ValueError(f"axes must name each of its {count} axes once, of {', '.join(known)}")
        return axes

    def _count(self) -> int:
        return len(self.channels)

    def _vertical(self, axes: tuple[str, ...]) -> str:
        vertical = self.vertical or ("z" if "z" in axes else axes[0] if len(axes) == 1 else None)
        if vertical is None:
            raise ValueError(f"say which axis a button is pressed along: vertical = '{axes[0]}'")
        if vertical.removeprefix("-") not in axes:
            raise ValueError(f"vertical is {vertical!r}, and it measures {', '.join(axes)}: use one of these")
        return vertical

    def _scales(self) -> tuple[float, ...]:
        if (self.scale is None) == (self.sensitivity is None):
            raise ValueError(
                f"give either scale ({self.per} per V) or sensitivity (V per {self.per}, or in its own unit)"
            )
        if self.scale is not None:
            found = [
                value_of(one, f"({self.per})/V") if isinstance(one, str) else float(one) for one in self.scale
            ]
        else:
            assert self.sensitivity is not None
            volts = [self.gain * self._volts_per_unit(one) for one in self.sensitivity]
            if not all(volts):
                raise ValueError("a sensitivity or gain of 0 measures nothing: give that of the data sheet")
            found = [1 / one for one in volts]
        if not all(found) or not np.isfinite(found).all():
            raise ValueError(f"a scale of 0 measures nothing: give {self.per} per V")
        return tuple(found)

    def _volts_per_unit(self, stated: float | str) -> float:
        if not isinstance(stated, str):
            return float(stated)
        value, found = with_unit(stated)
        volts = self._voltage(value, found)
        if volts is None:
            raise ValueError(
                f"the sensitivity {stated!r} is none of a sensor of {self.measures}: use {self._needs()}"
            )
        return volts

    def _of_each(self, key: str, values: tuple[float, ...]) -> tuple[float, ...]:
        if len(values) not in (1, len(self.channels)):
            raise ValueError(
                f"{key} has {len(values)} numbers: give one, or one for each of {len(self.channels)} channels"
            )
        return values if len(values) == len(self.channels) else values * len(self.channels)

    def _ranges(self) -> tuple[float, ...] | None:
        if self.range is None:
            return None
        found = []
        for one in self.range:
            value = value_of(one, self.per) if isinstance(one, str) else one
            if not isinstance(value, int | float) or not 0 < value < np.inf:
                raise ValueError(f"range must be above 0, in {self.per} (found {one!r})")
            found.append(float(value))
        if len(found) not in (1, self._count()):
            raise ValueError(
                f"range has {len(found)} numbers: give one, or one for each of its {self._count()} axes"
            )
        return tuple(found)

    def _need_high_pass(self, what: str) -> None:
        if self.high_pass_hz is None and self.time_constant is None:
            raise ValueError(f"{what} shows nothing that is constant: give high_pass_hz or time_constant")

    def _transfer(self) -> Transfer:
        if self.frf is not None and (self.poles or self.zeros or self._low_pass() is not None):
            raise ValueError("give either frf, or poles, zeros and low_pass_hz")
        if self.high_pass_hz is not None and self.time_constant is not None:
            raise ValueError("give either high_pass_hz or time_constant, which is 1 / (2 pi high_pass_hz)")
        corner = self.high_pass_hz if self.time_constant is None else 1 / (2 * np.pi * self.time_constant)
        low_pass = self._low_pass()
        if corner is not None and low_pass is not None and corner >= low_pass:
            raise ValueError(
                f"high_pass_hz ({corner:g}) must be below low_pass_hz ({low_pass:g}): nothing would pass"
            )
        return Transfer(
            high_pass_hz=() if corner is None else (corner,),
            poles=self.poles if low_pass is None else (low_pass, *self.poles),
            zeros=self.zeros,
            measured=self.frf,
            delay=self.delay,
        )

    def _stated(self) -> dict[str, Any]:
        said = self.model_dump(
            exclude_defaults=True,
            include={"sensitivity", "excitation", "amplifier", "gain", "time_constant", *self._own()},
        )
        return {key: list(value) if isinstance(value, tuple) else value for key, value in said.items()}

    def _own(self) -> set[str]:
        return set(type(self).model_fields) - set(LinearTable.model_fields) - {"matrix", "gravity"}
