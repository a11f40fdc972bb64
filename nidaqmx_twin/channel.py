"""One virtual channel of a task: what it measures or puts out, in which range and units."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from nidaqmx.constants import CurrentShuntResistorLocation, TerminalConfiguration

from ..base.arrays import FloatArray
from .converter import code_width
from .devices import NiDevice
from .errors import unsupported
from .measurements import measured_scale
from .products import TIMEBASE_HZ, Product, input_range
from .scales import Scale

Kind = Literal["ai", "ao", "di", "do", "ci", "co"]

_Sockets = dict[int, dict[str, int]]
_PFI: _Sockets = {
    0: {"source": 8, "gate": 9, "aux": 10},
    1: {"source": 3, "gate": 4, "aux": 11},
    2: {"source": 0, "gate": 1, "aux": 2},
    3: {"source": 5, "gate": 6, "aux": 7},
}
"""PFI terminals of the inputs of counters 0 to 3 (X Series manual, chapter 7; M Series has the first two;
of a 6052E: MathWorks, answer 790574)."""
_EIGHT_LINES: _Sockets = {
    0: {"source": 0, "gate": 1, "aux": 2},
    1: {"source": 4, "gate": 5, "aux": 6},
    2: {"source": 3, "gate": 2, "aux": 0},
    3: {"source": 7, "gate": 6, "aux": 4},
}
_FOUR_LINES: _Sockets = {
    0: {"source": 0, "gate": 1, "aux": 2},
    1: {"source": 3, "gate": 2, "aux": 1},
    2: {"source": 1, "gate": 3, "aux": 0},
    3: {"source": 2, "gate": 0, "aux": 3},
}
"""Those of modules (NI-DAQmx Device Considerations, "Connecting Counter Signals", CompactDAQ: A is the
source, Z the gate, B and the direction the third)."""
_SOURCE_ONLY: _Sockets = {0: {"source": 0}}
"""Of a USB-6008 and USB-6009 (their user guide, "Event Counter")."""
_SOCKETS: dict[str, _Sockets] = {
    **dict.fromkeys(("E Series", "M Series", "X Series", "AO Series"), _PFI),
    **dict.fromkeys(("NI 9401", "NI 9421", "NI 9422", "NI 9423", "NI 9436", "NI 9437"), _EIGHT_LINES),
    **dict.fromkeys(("NI 9402", "NI 9435"), _FOUR_LINES),
    **dict.fromkeys(("USB-6008", "USB-6009"), _SOURCE_ONLY),
    **{name: {} for name in ("USB-6210", "USB-6211", "USB-6215")},  # without PFI 8 to 15
}
"""By product or family; of any other, and of those that are empty, no source was found."""
_PROPORTIONAL = (
    "ACCELERATION_ACCELEROMETER_CURRENT_INPUT", "ACCELERATION_4_WIRE_DC_VOLTAGE", "FORCE_IEPE_SENSOR",
    "VELOCITY_IEPE_SENSOR", "CURRENT",
)  # fmt: skip
"""Measurements whose limits are volts over a sensitivity or a shunt, and so must fit a range of the input."""
_SENSORS_MARGIN = 1.1
"""Ranges are nominal, and a sensitivity is that of one sensor: how far limits may go beyond (inferred)."""
_RTD_MARGIN = 1.02
"""Volts that the driver allows above those of the highest temperature (it takes a range of 0.2 V for 99.3 mV:
NI's own test of a thermometer)."""
M_SERIES_FILTERS = (125e-9, 6.425e-6, 2.56e-3)
"""Pulses that the digital filters of M Series cards let pass (s)."""
_LEAST_TICKS = 2
"""Ticks of a pulse's high and of its low part (NI-DAQmx Base, text of -200745: frequency <= timebase/4)."""
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
    def negative(self) -> str | None:
        """Input of the card at the negative end of a differential one; None where it is no input of its own.

        AI 0 and AI 8, AI 1 and AI 9, and so on (`Product.ai_bank`).
        """
        number = self.device.ai_number(self.physical[0])
        differential = self.values.get("AI_TERM_CFG") == TerminalConfiguration.DIFF.value
        if number is None or not differential or not self.product.ai_single_ended:
            return None
        return f"{self.device.name}/ai{number + self.product.ai_bank // 2}"

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
                raise unsupported(
                    f"{self.name} of {self.product.name} puts out {low:g} to {self.product.ao_range:g} V, "
                    f"not {self.volts[0]:g} to {self.volts[1]:g} V."
                )
            return self.product.ao_range
        forced = [abs(self.values[name]) for name in ("AI_RNG_HIGH", "AI_RNG_LOW") if name in self.values]
        wanted = max(forced) if forced else float(np.abs(self.volts).max())
        usage = self.values.get("AI_MEAS_TYPE_NAME", "VOLTAGE")
        inside = self.values.get("AI_CURRENT_SHUNT_LOC") == CurrentShuntResistorLocation.INTERNAL.value
        proportional = usage in _PROPORTIONAL and self.scale is not None and not inside
        if (usage != "VOLTAGE" and not proportional) or self.values.get("AI_IS_TEDS"):
            widest = self.product.ai_ranges[0]
            if usage == "TEMPERATURE_RTD":
                wanted *= _RTD_MARGIN
            return input_range(self.product, float(wanted)) or widest if self.scale is not None else widest
        found = input_range(self.product, float(wanted))
        if found is None and proportional and wanted < _SENSORS_MARGIN * self.product.ai_ranges[0]:
            return self.product.ai_ranges[0]
        if found is None:
            raise unsupported(
                f"{self.name} of {self.product.name} has no range of +-{wanted:g} V, only "
                f"+-{', +-'.join(f'{r:g}' for r in self.product.ai_ranges)} V."
            )
        return found

    def filter_width(self, term: str) -> float:
        """Pulse that the digital filter of the terminal property `term` lets pass (s); 0 without a filter."""
        return filter_width(self.product, term, self.values.get)

    @property
    def pulse(self) -> tuple[float, float]:
        """High and low time of a counter output's pulses, as its properties say (s).

        Whole ticks of the timebase, the nearest (NI-DAQmx Key Concepts, "Counter Frequency Coercion").
        """
        values, hz = self.values, timebase_of(self, counter_timebase(self.product.family))
        if "CO_PULSE_FREQ" in values:
            ticks = max(2 * _LEAST_TICKS, round(hz / float(values["CO_PULSE_FREQ"])))
            high = round(ticks * float(values["CO_PULSE_DUTY_CYC"]))
            high = min(max(high, _LEAST_TICKS), ticks - _LEAST_TICKS)
            return high / hz, (ticks - high) / hz
        if "CO_PULSE_HIGH_TICKS" in values:
            return values["CO_PULSE_HIGH_TICKS"] / hz, values["CO_PULSE_LOW_TICKS"] / hz
        return float(values["CO_PULSE_HIGH_TIME"]), float(values["CO_PULSE_LOW_TIME"])

    @property
    def pulse_delay(self) -> float:
        """Time from the start to a counter output's first pulse (s)."""
        ticks = self.values.get("CO_PULSE_TICKS_INITIAL_DELAY")
        if ticks is not None:
            return float(ticks) / timebase_of(self, counter_timebase(self.product.family))
        names = ("CO_PULSE_FREQ_INITIAL_DELAY", "CO_PULSE_TIME_INITIAL_DELAY")
        return float(next((self.values[name] for name in names if name in self.values), 0.0))

    @property
    def width(self) -> float:
        """Volts per code."""
        if self.kind == "ao":
            return self.product.ao_range / 2.0 ** (self.product.ao_bits - 1)
        return float(code_width(self.product, np.array(self.full_scale)))


def default_terminal(channel: Channel, socket: str) -> str | None:
    """Name of the terminal that an input of a channel's counter has unless a program sets another.

    None where it is not known: also where the family's is no input of this product.
    """
    product = channel.product
    sockets = _SOCKETS.get(product.name, _SOCKETS.get(product.family, {}))
    found = sockets.get(int(re.sub(r"\D", "", channel.physical[0])), {}).get(socket)
    there = found is not None and (product.pfi_lines is None or found < product.pfi_lines)
    if found is None or not there or product.pfi_way(found) == "out":
        return None
    return f"/{channel.device.name}/PFI{found}"


def filter_of(term: str) -> str:
    """Beginning of the names of the properties of a terminal's digital filter."""
    own = term.removesuffix("_TERM").removesuffix("_SRC").replace("COUNT_EDGES_DIR", "COUNT_EDGES_COUNT_DIR")
    return f"{own}_DIG_FLTR"


def filter_width(product: Product, term: str, value: Callable[[str], Any]) -> float:
    """Pulse that the digital filter of the terminal property `term` lets pass (s); 0 without a filter.

    `value` gives a property by its name, or None. Of M Series, the next longer of its three (M Series manual
    371022, "PFI Filters"; that it is the longer is inferred).
    """
    name = filter_of(term)
    asked = float(value(f"{name}_MIN_PULSE_WIDTH") or 0.0) if value(f"{name}_ENABLE") else 0.0
    if product.family != "M Series" or not asked:
        return asked
    return min((width for width in M_SERIES_FILTERS if width >= asked * (1 - 1e-9)), default=asked)


def timebase_of(channel: Channel, fallback_hz: float) -> float:
    """Frequency of the timebase of a channel's counter (Hz)."""
    source = str(channel.values.get(f"{channel.kind.upper()}_CTR_TIMEBASE_SRC", ""))
    found = re.search(r"(\d+)([kM]?)HzTimebase", source, re.IGNORECASE)
    return float(found[1]) * _PER[found[2]] if found else fallback_hz
