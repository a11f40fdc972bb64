"""One virtual channel of a task: what it measures or puts out, in which range and units."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from ....base.arrays import FloatArray
from ..converter import code_width
from ..products import TIMEBASE_HZ, Product, input_range
from .devices import NiDevice
from .errors import DaqmxError, DAQmxErrors
from .measurements import measured_scale
from .scales import Scale

Kind = Literal["ai", "ao", "di", "do", "ci", "co"]

_SOCKETS = {
    0: {"source": "PFI8", "gate": "PFI9", "aux": "PFI10"},
    1: {"source": "PFI3", "gate": "PFI4", "aux": "PFI11"},
    2: {"source": "PFI0", "gate": "PFI1", "aux": "PFI2"},
    3: {"source": "PFI5", "gate": "PFI6", "aux": "PFI7"},
}
"""Terminals of the inputs of counters 0 to 3 (X Series manual, chapter 7; M Series has the first two)."""
_RTD_MARGIN = 1.02
"""Volts that the driver allows above those of the highest temperature (it takes a range of 0.2 V for 99.3 mV:
NI's own test of a thermometer)."""
_PER = {"": 1.0, "k": 1e3, "M": 1e6}


def counter_timebase(family: str) -> float:
    """Frequency of a family's fastest counter timebase (Hz)."""
    return TIMEBASE_HZ.get(family, 100e6)


@dataclass
class Channel:
    """One virtual channel: a converter's terminal, or a group of digital lines."""

    name: str
    kind: Kind
    device: NiDevice
    physical: tuple[str, ...]
    """Names without the device: ("ai0",), or lines in the order given ("port0/line0", ...), a whole port from
    its highest line down. It is also the order of a digital waveform's columns."""
    values: dict[str, Any] = field(default_factory=dict)
    """Properties that were set, by attribute name."""
    written: set[str] = field(default_factory=set)
    """Names of the properties that a program has set one by one."""
    ports: bool = False
    """True for a digital channel of whole ports."""
    custom: Scale | None = None
    """Custom scale between volts and the program's units."""

    @property
    def scale(self) -> Scale | None:
        """Scale between volts and the program's units: a custom one, or that of a sensor."""
        return self.custom or (measured_scale(self.values) if self.kind == "ai" else None)

    @property
    def rows(self) -> int:
        """Number of rows that it has among a task's samples: a line each, and two of a counter."""
        return {"ai": 1, "ci": 2, "co": 2}.get(self.kind, len(self.physical))

    @property
    def product(self) -> Product:
        """Product of the channel's device."""
        return self.device.product

    @property
    def low(self) -> float:
        """Lowest value that the program requested."""
        return float(self.values.get(f"{self.kind.upper()}_MIN", -10.0))

    @property
    def high(self) -> float:
        """Highest value that the program requested."""
        return float(self.values.get(f"{self.kind.upper()}_MAX", 10.0))

    @property
    def volts(self) -> FloatArray:
        """Limits that the program requested, as voltages at the terminal: (2,) V, rising."""
        level = self.values.get("AI_SOUND_PRESSURE_MAX_SOUND_PRESSURE_LVL")
        if level is not None and "AI_MAX" not in self.values:
            # The level is that of a sine: 20 uPa rms are 0 dB.
            peak = np.sqrt(2) * 20e-6 * 10 ** (float(level) / 20)
            limits = np.array([-peak, peak])
        else:
            limits = np.array([self.low, self.high])
        return limits if self.scale is None else np.sort(self.scale.to_volts(limits))

    @property
    def full_scale(self) -> float:
        """Range of the converter, as +- full scale (V)."""
        if self.kind == "ao":
            wanted = float(np.abs(self.volts).max())
            low = 0.0 if self.product.ao_unipolar else -self.product.ao_range
            if wanted > self.product.ao_range * (1 + 1e-9) or self.volts[0] < low * (1 + 1e-9):
                raise DaqmxError(
                    DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
                    f"Requested value is not a supported value for this property: {self.name} of "
                    f"{self.product.name} puts out {low:g} to {self.product.ao_range:g} V, not "
                    f"{self.volts[0]:g} to {self.volts[1]:g} V.",
                )
            return self.product.ao_range
        forced = self.values.get("AI_RNG_HIGH")
        wanted = forced if forced is not None else float(np.abs(self.volts).max())
        if self.values.get("AI_MEAS_TYPE_NAME", "VOLTAGE") != "VOLTAGE" or self.values.get("AI_IS_TEDS"):
            widest = self.product.ai_ranges[0]
            if self.values.get("AI_MEAS_TYPE_NAME") == "TEMPERATURE_RTD":
                wanted *= _RTD_MARGIN
            return input_range(self.product, float(wanted)) or widest if self.scale is not None else widest
        found = input_range(self.product, float(wanted))
        if found is None:
            raise DaqmxError(
                DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
                f"Requested value is not a supported value for this property: {self.name} of "
                f"{self.product.name} has no range of +-{wanted:g} V, only "
                f"+-{', +-'.join(f'{r:g}' for r in self.product.ai_ranges)} V.",
            )
        return found

    @property
    def pulse(self) -> tuple[float, float]:
        """High and low time of a counter output's pulses, as its properties say (s)."""
        values = self.values
        if "CO_PULSE_FREQ" in values:
            period, duty = 1 / float(values["CO_PULSE_FREQ"]), float(values["CO_PULSE_DUTY_CYC"])
            return period * duty, period * (1 - duty)
        if "CO_PULSE_HIGH_TICKS" in values:
            hz = timebase_of(self, 100e6)
            return values["CO_PULSE_HIGH_TICKS"] / hz, values["CO_PULSE_LOW_TICKS"] / hz
        return float(values["CO_PULSE_HIGH_TIME"]), float(values["CO_PULSE_LOW_TIME"])

    @property
    def pulse_delay(self) -> float:
        """Time from the start to a counter output's first pulse (s)."""
        ticks = self.values.get("CO_PULSE_TICKS_INITIAL_DELAY")
        if ticks is not None:
            return float(ticks) / timebase_of(self, 100e6)
        names = ("CO_PULSE_FREQ_INITIAL_DELAY", "CO_PULSE_TIME_INITIAL_DELAY")
        return float(next((self.values[name] for name in names if name in self.values), 0.0))

    @property
    def width(self) -> float:
        """Volts per code."""
        if self.kind == "ao":
            return self.product.ao_range / 2.0 ** (self.product.ao_bits - 1)
        return float(code_width(self.product, np.array(self.full_scale)))


def default_terminal(channel: Channel, socket: str) -> str:
    """Name of the terminal that an input of a channel's counter has unless a program sets another."""
    number = int(re.sub(r"\D", "", channel.physical[0])) % 4
    return f"/{channel.device.name}/{_SOCKETS[number][socket]}"


def timebase_of(channel: Channel, fallback_hz: float) -> float:
    """Frequency of the timebase of a channel's counter (Hz)."""
    source = str(channel.values.get(f"{channel.kind.upper()}_CTR_TIMEBASE_SRC", ""))
    found = re.search(r"(\d+)([kM]?)HzTimebase", source, re.IGNORECASE)
    return float(found[1]) * _PER[found[2]] if found else fallback_hz
