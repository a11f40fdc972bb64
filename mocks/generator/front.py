"""A simulated function generator as its front shows it: voltages and sweep ends, APPLy, display, what is off.

Voltages and sweep ends depend on each other. Voltages are stored without load, and set and reported for the
load that is declared. A value that cannot be is moved to one that can, with an error in the queue, as both
families do it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from .headers import LIMITED, NUMBERS, SHAPE, START, STOP, UNIT, Product
from .scpi import Entry, Fail, ScpiError, number_of, unit_of, word_of
from .waveform import HIGHEST, Channel

INFINITE = 9.9e37
"""SCPI's number for infinity."""
_LOWEST = 2e-3


@dataclass(frozen=True)
class Quantity:
    """A number of a channel that is computed from its settings."""

    get: Callable[[Channel], float]
    put: Callable[[Channel, str, Fail], None]
    """Set it to an argument. Raises ScpiError for none."""


def within(value: float, low: float, high: float, fail: Fail) -> float:
    """Clip a value to its limits, with an error."""
    if low <= value <= high:
        return value
    end = "lower" if value < low else "upper"
    fail(ScpiError(-222, f"Data out of range; value clipped to {end} limit"))
    return min(max(value, low), high)


_RMS = {"SIN": 1 / math.sqrt(8), "SQU": 0.5, "PULS": 0.5, "PRBS": 0.5, "RAMP": 1 / math.sqrt(12),
        "TRI": 1 / math.sqrt(12)}  # fmt: skip
"""Rms value of a shape without its mean, for 1 V peak to peak; a sine's is taken for any other (estimate)."""


def _rms(channel: Channel) -> float:
    return _RMS.get(channel.words[SHAPE], _RMS["SIN"])


def _level(channel: Channel) -> float:
    rms = channel.peak_to_peak * channel.share * _rms(channel)
    match channel.words[UNIT]:
        case "VRMS":
            return rms
        case "DBM":
            return 10 * math.log10(1e3 * rms**2 / channel.load)
    return channel.peak_to_peak * channel.share


def _put_level(channel: Channel, argument: str, fail: Fail) -> None:
    ends = {"MINimum": _LOWEST * channel.share, "MAXimum": HIGHEST * channel.share}
    volts = number_of(argument, ends, "V")
    own = unit_of(argument)
    if own == "DBM" and math.isinf(channel.load):
        raise ScpiError(-221, "Settings conflict; not able to use dBm units with infinite load")
    # A unit of the argument counts for it alone; an end of the range is peak to peak.
    match own.removeprefix("M") if own else channel.words[UNIT] if argument[:1].upper() != "M" else "VPP":
        case "VRMS":
            volts /= _rms(channel)
        case "DBM":
            volts = math.sqrt(channel.load * 1e-3 * 10 ** (volts / 10)) / _rms(channel)
    most = HIGHEST - (0 if channel.is_direct else 2 * abs(channel.offset))
    wanted = within(volts / channel.share, _LOWEST, most, fail)
    channel.peak_to_peak, _ = _limited(channel, wanted, channel.offset, fail)


def _limited(channel: Channel, peak_to_peak: float, offset: float, fail: Fail) -> tuple[float, float]:
    """Amplitude and offset within the voltage limits, if they are on."""
    if not channel.values[LIMITED]:
        return peak_to_peak, offset
    most = 2 * min(channel.high - offset, offset - channel.low)
    if channel.is_direct or peak_to_peak <= most + 1e-12:
        return peak_to_peak, min(max(offset, channel.low), channel.high)
    fail(ScpiError(-221, "Settings conflict; amplitude limited by voltage limits"))
    return max(most, _LOWEST), offset


def _put_offset(channel: Channel, argument: str, fail: Fail) -> None:
    most = (HIGHEST - (0 if channel.is_direct else channel.peak_to_peak)) / 2
    wanted = within(number_of(argument) / channel.share, -most, most, fail)
    channel.peak_to_peak, channel.offset = _limited(channel, channel.peak_to_peak, wanted, fail)


def _end(side: int, channel: Channel) -> float:
    return (channel.offset + side * channel.peak_to_peak / 2) * channel.share


def _put_end(side: int, channel: Channel, argument: str, fail: Fail) -> None:
    other = channel.offset - side * channel.peak_to_peak / 2
    end = within(number_of(argument) / channel.share, -HIGHEST / 2, HIGHEST / 2, fail)
    if side * (end - other) < _LOWEST:
        other = end - side * _LOWEST  # As the instruments do, move the other end.
        fail(ScpiError(-221, "Settings conflict; high level must be above low level"))
    channel.peak_to_peak, channel.offset = side * (end - other), (end + other) / 2


def _limit(side: int, channel: Channel) -> float:
    return (channel.high if side > 0 else channel.low) * channel.share


def _put_limit(side: int, channel: Channel, argument: str, fail: Fail) -> None:
    ends = {"MINimum": -HIGHEST / 2 * channel.share, "MAXimum": HIGHEST / 2 * channel.share}
    volts = number_of(argument, ends) / channel.share
    present = side * channel.offset + channel.peak_to_peak / 2
    if side * volts < present - 1e-12:
        fail(ScpiError(-221, "Settings conflict; limit moved to the signal that is put out"))
        volts = side * present
    volts = within(volts, -HIGHEST / 2, HIGHEST / 2, fail)
    if side > 0:
        channel.high = volts
    else:
        channel.low = volts


def _load(channel: Channel) -> float:
    return min(channel.load, INFINITE)


def _put_load(channel: Channel, argument: str, fail: Fail) -> None:
    ends = {"INFinity": INFINITE, "MINimum": 1.0, "MAXimum": 1e4, "DEFault": 50.0}
    ohms = number_of(argument, ends)
    if channel.values[LIMITED]:
        raise ScpiError(-221, "Settings conflict; output load not changed while voltage limits are on")
    channel.load = math.inf if ohms >= INFINITE else within(ohms, 1.0, 1e4, fail)
    if math.isinf(channel.load) and channel.words[UNIT] == "DBM":
        channel.words[UNIT] = "VPP"


def _centre(channel: Channel) -> float:
    return (channel.values[START] + channel.values[STOP]) / 2


def _span(channel: Channel) -> float:
    return channel.values[STOP] - channel.values[START]


def _put_sweep(channel: Channel, centre: float, span: float, fail: Fail) -> None:
    """Set a centre and a span, narrower where it would reach below zero or beyond the highest."""
    _, low, high = NUMBERS[START]
    centre = within(centre, low, high, fail)
    most = 2 * min(centre - low, high - centre)
    if abs(span) > most:
        fail(ScpiError(-221, "Settings conflict; span changed due to centre frequency"))
        span = most
    channel.values[START], channel.values[STOP] = centre - span / 2, centre + span / 2


_VOLTAGE = "[:SOURce#]:VOLTage"
_NOW = f"{_VOLTAGE}[:LEVel][:IMMediate]"
QUANTITIES: dict[str, Quantity] = {
    f"{_NOW}[:AMPLitude]": Quantity(_level, _put_level),
    f"{_NOW}:OFFSet": Quantity(lambda channel: channel.offset * channel.share, _put_offset),
    f"{_NOW}:HIGH": Quantity(partial(_end, 1), partial(_put_end, 1)),
    f"{_NOW}:LOW": Quantity(partial(_end, -1), partial(_put_end, -1)),
    f"{_VOLTAGE}:LIMit:HIGH": Quantity(partial(_limit, 1), partial(_put_limit, 1)),
    f"{_VOLTAGE}:LIMit:LOW": Quantity(partial(_limit, -1), partial(_put_limit, -1)),
    ":OUTPut#:LOAD": Quantity(_load, _put_load),
    ":OUTPut#:IMPedance": Quantity(_load, _put_load),
    "[:SOURce#]:FREQuency:CENTer": Quantity(
        _centre, lambda channel, given, fail: _put_sweep(channel, number_of(given), _span(channel), fail)
    ),
    "[:SOURce#]:FREQuency:SPAN": Quantity(
        _span, lambda channel, given, fail: _put_sweep(channel, _centre(channel), number_of(given), fail)
    ),
}
"""Quantities by their headers."""


_KINDS = ("PM", "PWM", "FSKey", "BPSK", "SUM")
_RATE = "[:SOURce#]:FUNCtion:ARBitrary:SRATe"
_ON_OFF = {"ON": "1", "1": "1", "OFF": "0", "0": "0"}


class Display:
    """The instrument's screen."""

    def __init__(self) -> None:
        self.text = ""
        self.on = "1"

    def write(self, argument: str) -> None:
        """Show a quoted text."""
        self.text = argument.strip().strip("\"'")

    def switch(self, argument: str) -> None:
        """Switch the screen."""
        self.on = _ON_OFF[word_of(argument, tuple(_ON_OFF))]


def front_entries(channel: Callable[[int], Channel], product: Product) -> dict[str, Entry]:
    """Entries of these commands."""
    display = Display()
    entries = {
        ":DISPlay[:STATe]": Entry(lambda n, _: display.on, lambda n, a: display.switch(a)),
        ":DISPlay:TEXT": Entry(lambda n, _: f'"{display.text}"', lambda n, a: display.write(a)),
        ":DISPlay:TEXT:CLEar": Entry(put=lambda n, _: display.write("")),
    }
    entries |= {
        f"[:SOURce#]:{kind}[:STATe]" if not product.by_mode else f"[:SOURce#]:{kind}:STATe": Entry(
            lambda n, _: product.booleans[0], lambda n, argument: _unmodulated(argument)
        )
        for kind in _KINDS
    }
    if product.by_mode:
        entries |= {
            "[:SOURce#]:DATA:VOLatile:CATalog": Entry(get=lambda n, _: _catalogue(channel(n))),
            "[:SOURce#]:DATA:VOLatile:FREE": Entry(get=lambda n, _: _free(channel(n), product.memory)),
            "[:SOURce#]:FUNCtion:ARBitrary:POINts": Entry(get=lambda n, _: f"{_points(channel(n)):+d}"),
        }
    return entries


def _unmodulated(argument: str) -> None:
    if _ON_OFF[word_of(argument, tuple(_ON_OFF))] == "1":
        raise ScpiError(-221, "Settings conflict; AM and FM only are simulated")


def _catalogue(channel: Channel) -> str:
    return ",".join(dict.fromkeys(['"INT:\\BUILTIN\\EXP_RISE.ARB"', *channel.points]))


def _free(channel: Channel, memory: int) -> str:
    return f"{memory - sum(map(len, channel.points.values())):+d}"


def _points(channel: Channel) -> int:
    if channel.arb not in channel.points:
        raise ScpiError(786, "Specified arb waveform does not exist")
    return len(channel.points[channel.arb])


def _put_pace(power: int, channel: Channel, argument: str, fail: Fail) -> None:
    value = number_of(argument)
    if value <= 0:
        raise ScpiError(-222, "Data out of range")
    channel.values[_RATE] = value**power * _points(channel)


PACES = {
    f"[:SOURce#]:FUNCtion:ARBitrary:{name}": Quantity(
        lambda channel, power=power: (channel.values[_RATE] / _points(channel)) ** power,  # type: ignore[misc]
        partial(_put_pace, power),
    )
    for name, power in (("FREQuency", 1), ("PERiod", -1))
}
"""How fast Keysight's points are put out, by headers: their rate, stated as that of the whole waveform."""


# APPLy, the command that everybody begins with: function, frequency, amplitude, offset, and output on.

_SHAPES = ("SINusoid", "SQUare", "TRIangle", "RAMP", "PULSe", "PRBS", "NOISe", "ARBitrary", "USER", "DC")
_DEFAULTS = ("1000", "0.1", "0")
"""Frequency (Hz), amplitude (V peak to peak) and offset (V) of what is left out."""
_NAMES = ("FREQ", "VOLT", "VOLT:OFFS")


class Answering(Protocol):
    """What is applied to: the commands that APPLy stands for."""

    def answer(self, line: str) -> object:
        """Execute a line of commands."""

    def get(self, line: str) -> str:
        """Answer one query."""


def apply_entries(box: Answering, product: Product) -> dict[str, Entry]:
    """Entries of APPLy in a family's form."""
    root = "[:SOURce#]:APPLy"
    entries = {f"{root}:{shape}": Entry(put=partial(_apply, box, product, shape)) for shape in _SHAPES}
    return {root: Entry(get=partial(_applied, box, product)), **entries}


def _apply(box: Answering, product: Product, shape: str, n: int, argument: str) -> None:
    given = [word.strip() for word in argument.split(",")] if argument else []
    if len(given) > (3 if product.by_mode else 4):
        raise ScpiError(-108, "Parameter not allowed")
    name = "ARB" if shape == "USER" else shape
    # What would be in the way of the new signal: the old offset, sweep, burst, modulation and unit.
    for header in (
        "SWE:STAT OFF",
        "BURS:STAT OFF",
        "AM:STAT OFF",
        "FM:STAT OFF",
        "VOLT:UNIT VPP",
        "VOLT:OFFS 0",
    ):
        box.answer(f"SOUR{n}:{header}")
    box.answer(f"SOUR{n}:FUNC {name}")
    names = list(_NAMES)
    if not product.by_mode:
        names, given = _rigol(box, n, shape, names, given)
    wanted = [*given, *[""] * 3][:3]
    for header, value, default in zip(names, wanted, _DEFAULTS, strict=True):
        word = default if value.upper() in ("", "DEF", "DEFAULT") else value
        if header == "FREQ" and name in ("NOISe", "DC"):
            continue
        box.answer(f"SOUR{n}:{header} {word}")
    if len(given) == 4 and given[3]:
        box.answer(f"SOUR{n}:PHAS {given[3]}")
    if product.by_mode:
        box.answer(f"TRIG{n}:SOUR IMM")
    box.answer(f"OUTP{n} ON")


def _rigol(
    box: Answering, n: int, shape: str, names: list[str], given: list[str]
) -> tuple[list[str], list[str]]:
    """Headers and arguments where the DG1000Z has others: points by their rate, noise without a frequency.

    QCoDeS's driver sends noise with all four arguments; they are taken as well.
    """
    match shape:
        case "NOISe" if len(given) < 3:
            return names, ["", *given]
        case "ARBitrary":
            box.answer(f"SOUR{n}:FUNC:ARB:MODE SRAT")
            return ["FUNC:ARB:SRAT", *names[1:]], given
        case "USER":
            box.answer(f"SOUR{n}:FUNC:ARB:MODE FREQ")
    return names, given


def _applied(box: Answering, product: Product, n: int, argument: str) -> str:
    shape, *numbers = (box.get(f"SOUR{n}:{header}?") for header in ("FUNC", *_NAMES))
    if product.by_mode:
        return f'"{shape} {",".join(numbers)}"'
    phase = box.get(f"SOUR{n}:PHAS?")
    match shape:
        case "NOIS":
            return ",".join(["NOISE", "DEF", *numbers[1:], "DEF"])
        case "ARB" if box.get(f"SOUR{n}:FUNC:ARB:MODE?") == "SRAT":
            return ",".join(["ARB", box.get(f"SOUR{n}:FUNC:ARB:SRAT?"), *numbers[1:]])
    return ",".join([{"PULS": "PULSE", "ARB": "USER"}.get(shape, shape), *numbers, phase])
