"""Simulated function generator, which turns its SCPI settings into volts at a node of the plant.

Ranges and keywords are those of the product families. A limit that was not found is the usual one for
this type of instrument (estimate; docs/hardware.md, "Generators").
"""

from __future__ import annotations

import math
from functools import partial
from typing import Protocol

from ...instruments.clock import Clock
from ..plant import Source
from .products import Product
from .scpi import Entry, ScpiDevice, ScpiError, number_of, word_of
from .waveform import SHAPES, Output, Playing

__all__ = ["Box", "Input"]

_CHANNELS = (1, 2)
_SOURCE = 50.0
"""Output impedance (ohm)."""
_HIGHEST = 20.0
"""Largest amplitude without load (V peak to peak): half of it at 50 ohm."""
_LOWEST = 2e-3
_INFINITE = 9.9e37


# Header: default, lowest, highest. Settings without an effect on the plant are stored and reported only.
_NUMBERS = {
    "[:SOURce#]:FREQuency[:CW]": (1e3, 1e-6, 60e6),
    "[:SOURce#]:FREQuency:STARt": (100, 1e-6, 60e6),
    "[:SOURce#]:FREQuency:STOP": (1e3, 1e-6, 60e6),
    "[:SOURce#]:PHASe[:ADJust]": (0, -360, 360),
    "[:SOURce#]:SWEep:TIME": (1, 1e-3, 500),
    "[:SOURce#]:SWEep:RTIMe": (0, 0, 500),
    "[:SOURce#]:MARKer:FREQuency": (500, 1e-6, 60e6),
    "[:SOURce#]:FUNCtion:SQUare:DCYCle": (50, 0.01, 99.99),
    "[:SOURce#]:FUNCtion:RAMP:SYMMetry": (100, 0, 100),
    "[:SOURce#]:FUNCtion:PULSe:PERiod": (1e-3, 33e-9, 1e6),
    "[:SOURce#]:FUNCtion:PULSe:WIDTh": (100e-6, 16e-9, 1e6),
    "[:SOURce#]:FUNCtion:PULSe:DCYCle": (10, 0, 100),
    "[:SOURce#]:FUNCtion:PULSe:TRANsition[:BOTH]": (10e-9, 8.4e-9, 1e-6),
    "[:SOURce#]:FUNCtion:ARBitrary:SRATe": (40e3, 1e-6, 250e6),
    "[:SOURce#]:BURSt:INTernal:PERiod": (10e-3, 1e-6, 8e3),
    "[:SOURce#]:BURSt:NCYCles": (1, 1, 1e8),
    "[:SOURce#]:BURSt:PHASe": (0, -360, 360),
}
_BOOLEANS = {
    "[:SOURce#]:BURSt:STATe": False,
    "[:SOURce#]:SWEep:STATe": False,
    "[:SOURce#]:MARKer[:STATe]": False,
    ":OUTPut#[:STATe]": False,
    ":OUTPut#:SYNC[:STATe]": True,
    ":OUTPut#:TRIGger": False,
}
_WORDS: dict[str, tuple[str, ...]] = {
    "[:SOURce#]:FUNCtion[:SHAPe]": SHAPES,
    "[:SOURce#]:VOLTage:UNIT": ("VPP", "VRMS", "DBM"),
    "[:SOURce#]:SWEep:SPACing": ("LINear", "LOGarithmic"),
    "[:SOURce#]:BURSt:MODE": ("TRIGgered", "GATed"),
    "[:SOURce#]:BURSt:IDLE": ("FPT", "TOP", "CENTER", "BOTTOM"),
    "[:SOURce#]:FUNCtion:PULSe:HOLD": ("WIDTh", "DCYCle"),
    "[:SOURce#]:FUNCtion:ARBitrary:ADVance": ("SRATe", "TRIGger"),
    "[:SOURce#]:FUNCtion:ARBitrary:FILTer": ("NORMal", "STEP", "OFF"),
    ":OUTPut#:POLarity": ("NORMal", "INVerted"),
}
_TRIGGERS: dict[bool, dict[str, tuple[str, ...]]] = {
    True: {":TRIGger#:SOURce": ("IMMediate", "EXTernal", "TIMer", "BUS")},
    False: {
        f"[:SOURce#]:{mode}:TRIGger:SOURce": ("INTernal", "EXTernal", "MANual") for mode in ("SWEep", "BURSt")
    },
}
"""Sources of the trigger: of a sweep first, and of a burst last."""

_FREQUENCY, _START, _STOP = list(_NUMBERS)[:3]
_TIME = "[:SOURce#]:SWEep:TIME"
_ON, _SWEEP = ":OUTPut#[:STATe]", "[:SOURce#]:SWEep:STATe"
_SHAPE, _UNIT, _SPACING = list(_WORDS)[:3]
_DUTY, _SYMMETRY = "[:SOURce#]:FUNCtion:SQUare:DCYCle", "[:SOURce#]:FUNCtion:RAMP:SYMMetry"
_BURST, _CYCLES = "[:SOURce#]:BURSt:STATe", "[:SOURce#]:BURSt:NCYCles"
_BURST_PERIOD = "[:SOURce#]:BURSt:INTernal:PERiod"
_RATE = "[:SOURce#]:FUNCtion:ARBitrary:SRATe"


class Input(Protocol):
    """The part of the plant that a generator uses."""

    @property
    def clock(self) -> Clock:
        """The plant's time."""

    def drive(self, node: str, source: Source) -> None:
        """See `haploop.mocks.plant.Nodes.drive`."""

    def advance(self, until: float) -> None:
        """Step the plant to `until` (s), with the sources' output up to that time."""


class Box:
    """Two-channel generator; channel 1 is wired to the plant's `node`.

    The plant receives the open-circuit voltage regardless of the generator's load setting, so that a
    wrong load setting shows in the data.
    """

    def __init__(self, product: Product, plant: Input, node: str) -> None:
        self._product = product
        self._clock = plant.clock
        self._triggers = tuple(_TRIGGERS[product.by_mode])
        self._words = _WORDS | _TRIGGERS[product.by_mode]
        self._numbers = _NUMBERS | product.sweep
        self.playing = Playing(plant.clock)
        self._channels = {n: _Channel() for n in _CHANNELS}
        self._device = ScpiDevice(
            product.identity, self._entries(), self._reset, self._software_trigger, product.by_mode
        )
        self.answer, self.fail = self._device.answer, self._device.fail
        self._advance = plant.advance
        self._reset()
        plant.drive(node, self.playing)

    def _reset(self) -> None:
        for channel in self._channels.values():
            channel.values = {h: float(v[0]) for h, v in self._numbers.items()}
            channel.values |= {h: float(v) for h, v in _BOOLEANS.items()}
            channel.words = {h: word_of(w[0].upper(), w) for h, w in self._words.items()}
            channel.peak_to_peak, channel.offset, channel.load = 0.2, 0.0, 50.0
            channel.points.clear()
            channel.arb = '"INT:\\BUILTIN\\EXP_RISE.ARB"'
        self._apply(1)

    def _entries(self) -> dict[str, Entry]:
        get, put = self._get_number, self._put_number
        entries = {
            h: Entry(partial(get, h, low, high), partial(put, h, low, high))
            for h, (_, low, high) in self._numbers.items()
        }
        entries |= {h: Entry(partial(self._get_on, h), partial(self._put_on, h)) for h in _BOOLEANS}
        entries |= {
            h: Entry(partial(self._get_word, h), partial(self._put_word, h, w))
            for h, w in self._words.items()
        }
        entries |= {
            "[:SOURce#]:VOLTage[:LEVel][:IMMediate][:AMPLitude]": Entry(self._get_level, self._put_level),
            "[:SOURce#]:VOLTage[:LEVel][:IMMediate]:OFFSet": Entry(self._get_offset, self._put_offset),
            "[:SOURce#]:VOLTage[:LEVel][:IMMediate]:HIGH": Entry(
                partial(self._get_end, 1), partial(self._put_end, 1)
            ),
            "[:SOURce#]:VOLTage[:LEVel][:IMMediate]:LOW": Entry(
                partial(self._get_end, -1), partial(self._put_end, -1)
            ),
            ":OUTPut#:LOAD": Entry(self._get_load, self._put_load),
            ":OUTPut#:IMPedance": Entry(self._get_load, self._put_load),
            "[:SOURce#]:FUNCtion:ARBitrary": Entry(lambda n, _: self._channel(n).arb, self._select),
            "[:SOURce#]:DATA:VOLatile:CLEar": Entry(put=lambda n, _: self._channel(n).points.clear()),
            "[:SOURce#]:DATA:ARBitrary": Entry(put=partial(self._load_points, 1.0)),
            "[:SOURce#]:DATA:ARBitrary:DAC": Entry(put=partial(self._load_points, 32767.0)),
            "[:SOURce#]:PHASe:SYNChronize": Entry(put=lambda n, _: None),
            ":SYSTem:ERRor[:NEXT]": Entry(get=lambda n, _: self._device.next_error()),
            ":SYSTem:BEEPer[:IMMediate]": Entry(put=lambda n, _: None),
            ":SYSTem:VERSion": Entry(get=lambda n, _: "1999.0"),
            ":DISPlay:TEXT": Entry(put=lambda n, _: None),
            ":DISPlay:TEXT:CLEar": Entry(put=lambda n, _: None),
        }
        if self._product.by_mode:
            entries["[:SOURce#]:FREQuency:MODE"] = Entry(self._get_mode, self._put_mode)
            entries[":TRIGger#[:IMMediate]"] = Entry(put=lambda n, _: self._fire(n))
        else:
            entries |= {
                f"[:SOURce#]:{mode}:TRIGger[:IMMediate]": Entry(put=lambda n, _: self._fire(n))
                for mode in ("SWEep", "BURSt")
            }
        return entries

    # Settings

    def _get_number(self, header: str, low: float, high: float, n: int, argument: str) -> str:
        ends = {"MINimum": low, "MAXimum": high}
        return self._text(number_of(argument, ends) if argument else self._channel(n).values[header])

    def _put_number(self, header: str, low: float, high: float, n: int, argument: str) -> None:
        value = number_of(argument, {"MINimum": low, "MAXimum": high})
        self._channel(n).values[header] = self._within(value, low, high)
        self._apply(n)

    def _get_on(self, header: str, n: int, argument: str) -> str:
        return self._product.booleans[bool(self._channel(n).values[header])]

    def _put_on(self, header: str, n: int, argument: str) -> None:
        self._channel(n).values[header] = float(_boolean(argument))
        self._apply(n)

    def _get_word(self, header: str, n: int, argument: str) -> str:
        return self._channel(n).words[header]

    def _put_word(self, header: str, words: tuple[str, ...], n: int, argument: str) -> None:
        word = word_of(argument, words)
        if word == "DBM" and math.isinf(self._channel(n).load):
            raise ScpiError(-221, "Settings conflict; not able to use dBm units with infinite load")
        channel = self._channel(n)
        channel.words[header] = word
        most = (_HIGHEST - channel.peak_to_peak) / 2
        if abs(channel.offset) > most and not channel.is_direct:
            channel.offset = math.copysign(most, channel.offset)
            self.fail(ScpiError(-221, "Settings conflict; offset changed due to function"))
        self._apply(n)

    def _get_mode(self, n: int, argument: str) -> str:
        return "SWE" if self._channel(n).values[_SWEEP] else "CW"

    def _put_mode(self, n: int, argument: str) -> None:
        self._channel(n).values[_SWEEP] = float(word_of(argument, ("CW", "FIXed", "SWEep")) == "SWE")
        self._apply(n)

    # Voltages are stored without load, and reported for the load that is set

    def _get_level(self, n: int, argument: str) -> str:
        channel = self._channel(n)
        rms = channel.peak_to_peak * channel.share / 2 / math.sqrt(2)
        match channel.words[_UNIT]:
            case "VRMS":
                return self._text(rms)
            case "DBM":
                return self._text(10 * math.log10(1e3 * rms**2 / channel.load))
        return self._text(channel.peak_to_peak * channel.share)

    def _put_level(self, n: int, argument: str) -> None:
        channel = self._channel(n)
        ends = {"MINimum": _LOWEST * channel.share, "MAXimum": _HIGHEST * channel.share}
        volts = number_of(argument, ends)
        match channel.words[_UNIT]:
            case "VRMS":
                volts *= 2 * math.sqrt(2)
            case "DBM":
                volts = 2 * math.sqrt(2) * math.sqrt(channel.load * 1e-3 * 10 ** (volts / 10))
        most = _HIGHEST - (0 if channel.is_direct else 2 * abs(channel.offset))
        channel.peak_to_peak = self._within(volts / channel.share, _LOWEST, most)
        self._apply(n)

    def _get_offset(self, n: int, argument: str) -> str:
        return self._text(self._channel(n).offset * self._channel(n).share)

    def _put_offset(self, n: int, argument: str) -> None:
        channel = self._channel(n)
        most = (_HIGHEST - (0 if channel.is_direct else channel.peak_to_peak)) / 2
        channel.offset = self._within(number_of(argument) / channel.share, -most, most)
        self._apply(n)

    def _get_end(self, side: int, n: int, argument: str) -> str:
        channel = self._channel(n)
        return self._text((channel.offset + side * channel.peak_to_peak / 2) * channel.share)

    def _put_end(self, side: int, n: int, argument: str) -> None:
        channel = self._channel(n)
        other = channel.offset - side * channel.peak_to_peak / 2
        end = self._within(number_of(argument) / channel.share, -_HIGHEST / 2, _HIGHEST / 2)
        if side * (end - other) < _LOWEST:
            other = end - side * _LOWEST  # As the instruments do, move the other end.
            self.fail(ScpiError(-221, "Settings conflict; high level must be above low level"))
        channel.peak_to_peak, channel.offset = side * (end - other), (end + other) / 2
        self._apply(n)

    def _get_load(self, n: int, argument: str) -> str:
        load = self._channel(n).load
        return self._product.infinite if math.isinf(load) else self._text(load)

    def _put_load(self, n: int, argument: str) -> None:
        ends = {"INFinity": _INFINITE, "MINimum": 1.0, "MAXimum": 1e4, "DEFault": 50.0}
        ohms = number_of(argument, ends)
        channel = self._channel(n)
        channel.load = math.inf if ohms >= _INFINITE else self._within(ohms, 1.0, 1e4)
        if math.isinf(channel.load) and channel.words[_UNIT] == "DBM":
            channel.words[_UNIT] = "VPP"

    # Arbitrary waveforms

    def _load_points(self, full: float, n: int, argument: str) -> None:
        name, _, values = argument.partition(",")
        points = [number_of(v.strip()) / full for v in values.split(",")] if values else []
        if len(points) < 8:
            raise ScpiError(-109, "Missing parameter")
        known = self._channel(n).points
        if _arb(name) in known:
            raise ScpiError(785, "Specified arb waveform already exists")
        known[_arb(name)] = points

    def _select(self, n: int, name: str) -> None:
        channel = self._channel(n)
        if _arb(name) not in channel.points and _arb(name) != channel.arb:
            raise ScpiError(786, "Specified arb waveform does not exist")
        channel.arb = _arb(name)
        self._apply(n)

    # Output

    def _software_trigger(self) -> None:
        if not self._product.by_mode:
            raise ScpiError(-113, "Undefined header")
        waiting = [n for n, c in self._channels.items() if self._trigger(c) == "BUS"]
        for n in waiting:
            self._fire(n)
        if not waiting:
            raise ScpiError(-211, "Trigger ignored")

    def _trigger(self, channel: _Channel) -> str:
        """Return the source of the trigger of what is on, sweep or burst."""
        return channel.words[self._triggers[-1 if channel.values[_BURST] else 0]]

    def _fire(self, n: int) -> None:
        channel = self._channel(n)
        wanted = "BUS" if self._product.by_mode else "MAN"
        if not (channel.values[_SWEEP] or channel.values[_BURST]) or self._trigger(channel) != wanted:
            raise ScpiError(-211, "Trigger ignored")
        if n == 1:
            self._advance(self._clock.now())
            self.playing.fire()

    def _apply(self, n: int) -> None:
        """Step the plant to now with the old output, then put out the current settings."""
        if n != 1:
            return
        channel = self._channel(1)
        values, words = channel.values, channel.words
        self._advance(self._clock.now())
        self.playing.set(
            Output(
                on=bool(values[_ON]),
                shape=words[_SHAPE],
                amplitude=channel.peak_to_peak / 2 * (-1 if words[":OUTPut#:POLarity"] == "INV" else 1),
                offset=channel.offset,
                frequency=values[_FREQUENCY],
                duty=values[_DUTY] / 100,
                symmetry=values[_SYMMETRY] / 100,
                points=tuple(channel.points.get(channel.arb, ())),
                rate_hz=values[_RATE],
                sweep=(values[_START], values[_STOP], values[_TIME]) if values[_SWEEP] else None,
                burst=(values[_CYCLES], values[_BURST_PERIOD]) if values[_BURST] else None,
                logarithmic=words[_SPACING] == "LOG",
                repeats=self._trigger(channel) in ("IMM", "INT"),
            )
        )

    def _channel(self, n: int) -> _Channel:
        if n not in self._channels:
            raise ScpiError(-114, "Header suffix out of range")
        return self._channels[n]

    def _text(self, value: float) -> str:
        return format(value, self._product.number)

    def _within(self, value: float, low: float, high: float) -> float:
        """Clip a value to its limits and queue an error, as both families do."""
        if low <= value <= high:
            return value
        end = "lower" if value < low else "upper"
        self.fail(ScpiError(-222, f"Data out of range; value clipped to {end} limit"))
        return min(max(value, low), high)


class _Channel:
    """Settings of one channel; a reset fills them in."""

    def __init__(self) -> None:
        self.values: dict[str, float] = {}
        self.words: dict[str, str] = {}
        self.points: dict[str, list[float]] = {}
        self.arb = ""
        self.peak_to_peak = 0.0
        """Amplitude without load (V peak to peak)."""
        self.offset = 0.0
        self.load = 50.0

    @property
    def is_direct(self) -> bool:
        """True for direct voltage: the offset alone, whose range the amplitude does not reduce."""
        return self.words[_SHAPE] == "DC"

    @property
    def share(self) -> float:
        """Ratio of the voltage at the load that is set to the open-circuit voltage."""
        return 1.0 if math.isinf(self.load) else self.load / (self.load + _SOURCE)


def _arb(name: str) -> str:
    """Return a waveform's name as the instrument reports it: quoted and in capitals."""
    return f'"{name.strip().strip(chr(34)).upper()}"'


def _boolean(argument: str) -> bool:
    match argument.upper():
        case "ON" | "1":
            return True
        case "OFF" | "0":
            return False
    raise ScpiError(-224, "Illegal parameter value") if argument else ScpiError(-109, "Missing parameter")
