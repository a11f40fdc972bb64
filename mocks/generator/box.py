"""Simulated function generator, which turns its SCPI settings into volts at a node of the plant.

Ranges and keywords are those of the product families. A limit that was not found is the usual one for
this type of instrument (estimate).
"""

from __future__ import annotations

import copy
import math
from functools import partial
from typing import Protocol

from ...base.clock import Clock
from ...nidaqmx_twin.nodes import Source
from . import headers
from .front import INFINITE, PACES, QUANTITIES, Quantity, apply_entries, front_entries, within
from .headers import (
    ARB_MODE,
    BOOLEANS,
    BURST,
    BURST_MODE,
    BURST_PHASE,
    LIMITED,
    NUMBERS,
    OWN_WORDS,
    SHAPE,
    SPACING,
    START,
    STOP,
    SWEEP,
    TIME,
    TRIGGERS,
    WORDS,
    Product,
)
from .modulation import AM, FM, check_carrier, modulation_of
from .scpi import Entry, ScpiDevice, ScpiError, number_of, word_of
from .waveform import (
    FREQUENCY,
    HIGHEST,
    HOLD,
    PULSES,
    Channel,
    Output,
    Playing,
    duty,
    hold,
    load,
    pulse_value,
    receive,
    select,
    set_pulse,
)

_CHANNELS = (1, 2)
_ON = ":OUTPut#[:STATe]"
_DUTY, _SYMMETRY = "[:SOURce#]:FUNCtion:SQUare:DCYCle", "[:SOURce#]:FUNCtion:RAMP:SYMMetry"
_CYCLES = "[:SOURce#]:BURSt:NCYCles"
_BURST_PERIOD = "[:SOURce#]:BURSt:INTernal:PERiod"
_RATE = "[:SOURce#]:FUNCtion:ARBitrary:SRATe"
_CONTINUOUS = ":INITiate#:CONTinuous"


class Input(Protocol):
    """The part of the plant that a generator uses."""

    @property
    def clock(self) -> Clock:
        """The plant's time."""

    def drive(self, node: str, source: Source) -> None:
        """See `haploop.nidaqmx_twin.nodes.Nodes.drive`."""

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
        self._triggers = [h for h in TRIGGERS[product.by_mode] if h.endswith("SOURce")]
        self._words = WORDS | OWN_WORDS[product.by_mode] | TRIGGERS[product.by_mode]
        self._numbers = NUMBERS | product.own
        self.playing = Playing(plant.clock)
        self._channels = {n: Channel() for n in _CHANNELS}
        self._device = ScpiDevice(
            product.identity, self._entries(), self._reset, self._software_trigger, product.by_mode
        )
        self._device.keeping(self._save, self._recall)
        self._saved: dict[int, dict[int, Channel]] = {}
        self.answer, self.fail = self._device.answer, self._device.fail
        self._advance = plant.advance
        self._reset()
        plant.drive(node, self.playing)

    def get(self, line: str) -> str:
        """Answer one query."""
        return self.answer(line)[0]

    def _save(self, place: int) -> None:
        self._saved[place] = copy.deepcopy(self._channels)

    def _recall(self, place: int) -> None:
        if place not in self._saved:
            raise ScpiError(810, "State has not been stored")
        self._channels = copy.deepcopy(self._saved[place])
        for channel in self._channels.values():
            channel.values[_ON] = 0.0  # as the instruments do
        self._apply()

    def _reset(self) -> None:
        for channel in self._channels.values():
            channel.values = {h: float(v[0]) for h, v in self._numbers.items()}
            channel.values |= {h: float(v) for h, v in BOOLEANS.items()}
            channel.words = {h: word_of(w[0].upper(), w) for h, w in self._words.items()}
            channel.peak_to_peak, channel.offset, channel.load = 0.2, 0.0, 50.0
            channel.points.clear()
            channel.arriving.clear()
            channel.arb = '"INT:\\BUILTIN\\EXP_RISE.ARB"'
            channel.low, channel.high = -HIGHEST / 2, HIGHEST / 2
            channel.armed = 0
        self._apply()

    def _entries(self) -> dict[str, Entry]:
        get, put = self._get_number, self._put_number
        entries = {
            h: Entry(partial(get, h, low, high), partial(put, h, low, high))
            for h, (_, low, high) in self._numbers.items()
        }
        quantities = QUANTITIES | (PACES if self._product.by_mode else {})
        entries |= {h: self._quantity(quantity) for h, quantity in quantities.items()}
        entries |= {h: Entry(partial(self._get_on, h), partial(self._put_on, h)) for h in BOOLEANS}
        entries |= {
            h: Entry(partial(self._get_word, h), partial(self._put_word, h, w))
            for h, w in self._words.items()
        }
        entries |= {
            "[:SOURce#]:FUNCtion:ARBitrary": Entry(lambda n, _: self._channel(n).arb, self._select),
            "[:SOURce#]:DATA:VOLatile:CLEar": Entry(put=lambda n, _: self._channel(n).points.clear()),
            "[:SOURce#]:DATA:ARBitrary": Entry(put=partial(self._load_points, 1.0)),
            "[:SOURce#]:DATA:ARBitrary:DAC": Entry(put=partial(self._load_points, 32767.0)),
            "[:SOURce#]:PHASe:SYNChronize": Entry(put=lambda n, _: None),
            ":ABORt": Entry(put=lambda n, _: self._abort()),
            ":INITiate#[:IMMediate]": Entry(put=lambda n, _: self._arm(n)),
            ":SYSTem:ERRor[:NEXT]": Entry(get=lambda n, _: self._device.next_error()),
            ":SYSTem:BEEPer[:IMMediate]": Entry(put=lambda n, _: None),
            **{f":SYSTem:{word}": Entry(put=lambda n, _: None) for word in ("LOCal", "REMote", "RWLock")},
            ":SYSTem:VERSion": Entry(get=lambda n, _: "1999.0"),
        }
        entries |= apply_entries(self, self._product)
        entries |= front_entries(self._channel, self._product)
        pulse = "[:SOURce#]:FUNCtion:PULSe" if self._product.by_mode else "[:SOURce#][:FUNCtion]:PULSe"
        entries |= {
            f"{pulse}:{name}": Entry(partial(self._get_pulse, name), partial(self._put_pulse, name))
            for name in PULSES
        }
        if self._product.by_mode:
            entries["[:SOURce#]:FREQuency:MODE"] = Entry(self._get_mode, self._put_mode)
            entries[":TRIGger#[:IMMediate]"] = Entry(put=lambda n, _: self._fire(n))
        else:
            entries["[:SOURce#]:PERiod[:FIXed]"] = entries[f"{pulse}:PERiod"]
            entries["[:SOURce#]:PULSe:HOLD"] = entries[HOLD]
            entries |= {
                f"[:SOURce#][:TRACe]:DATA{form}": Entry(put=partial(self._receive, kind))
                for kind, form in (("DATA", "[:DATA]"), ("DAC", ":DAC"), ("DAC16", ":DAC16"))
            }
            entries |= {
                h.replace("]:", "]:MOD:", 1): entry
                for h, entry in entries.items()
                if h.startswith(("[:SOURce#]:AM", "[:SOURce#]:FM"))
            }
            entries |= {
                f"[:SOURce#]:{mode}": entries[f"[:SOURce#]:{mode}:STATe"] for mode in ("SWEep", "BURSt")
            }
            entries |= {
                f"[:SOURce#]:{mode}:TRIGger[:IMMediate]": Entry(put=lambda n, _: self._fire(n))
                for mode in ("SWEep", "BURSt")
            }
        return entries

    # Settings

    @property
    def _angle(self) -> str:
        return self._channel(1).words[":UNIT:ANGLe"]

    def _quantity(self, quantity: Quantity) -> Entry:
        def get(n: int, argument: str) -> str:
            return self._text(quantity.get(self._channel(n)))

        def put(n: int, argument: str) -> None:
            quantity.put(self._channel(n), argument, self.fail)
            self._apply()

        return Entry(get, put)

    def _get_number(self, header: str, low: float, high: float, n: int, argument: str) -> str:
        ends = {"MINimum": low, "MAXimum": headers.highest(self._product, self._channel(n), header, high)}
        value = number_of(argument, ends) if argument else self._channel(n).values[header]
        value /= headers.degrees(header, self._angle)
        return self._text(value)

    def _put_number(self, header: str, low: float, high: float, n: int, argument: str) -> None:
        high = headers.highest(self._product, self._channel(n), header, high)
        ends = {"MINimum": low, "MAXimum": high}
        endless = {"INFinity": INFINITE} if header == _CYCLES and self._product.by_mode else {}
        value = number_of(argument, ends | endless, headers.kind_of(header))
        value = headers.in_degrees(header, argument, value, self._angle)
        self._channel(n).values[header] = (
            value if value in endless.values() else within(value, low, high, self.fail)
        )
        self._settle(n)

    def _get_pulse(self, name: str, n: int, argument: str) -> str:
        low, high = PULSES[name]
        ends = {"MINimum": low, "MAXimum": high}
        return self._text(number_of(argument, ends) if argument else pulse_value(self._channel(n), name))

    def _put_pulse(self, name: str, n: int, argument: str) -> None:
        low, high = PULSES[name]
        value = number_of(argument, {"MINimum": low, "MAXimum": high})
        set_pulse(self._channel(n), name, within(value, low, high, self.fail))
        self._settle(n)

    def _get_on(self, header: str, n: int, argument: str) -> str:
        return self._product.booleans[bool(self._channel(n).values[header])]

    def _put_on(self, header: str, n: int, argument: str) -> None:
        channel = self._channel(n)
        on = _boolean(argument)
        if on:
            check_carrier(header, channel.words[SHAPE])
            headers.exclude(channel.values, header, self.fail)
        channel.values[header] = float(on)
        self._settle(n)

    def _get_word(self, header: str, n: int, argument: str) -> str:
        return self._channel(n).words[header]

    def _put_word(self, header: str, words: tuple[str, ...], n: int, argument: str) -> None:
        word = word_of(argument, words)
        if word == "DBM" and math.isinf(self._channel(n).load):
            raise ScpiError(-221, "Settings conflict; not able to use dBm units with infinite load")
        channel = self._channel(n)
        if header == SHAPE:
            for mode in (AM, FM):
                if channel.values[mode]:
                    check_carrier(mode, word)
        if header == HOLD:
            hold(channel)
        channel.words[header] = word
        most_hz = headers.highest(self._product, channel, FREQUENCY, math.inf)
        if channel.values[FREQUENCY] > most_hz:
            channel.values[FREQUENCY] = most_hz
            self.fail(ScpiError(-221, "Settings conflict; frequency reduced for selected function"))
        most = (HIGHEST - channel.peak_to_peak) / 2
        if abs(channel.offset) > most and not channel.is_direct:
            channel.offset = math.copysign(most, channel.offset)
            self.fail(ScpiError(-221, "Settings conflict; offset changed due to function"))
        self._settle(n)

    def _settle(self, n: int) -> None:
        """Let what depends on a setting that was changed follow it, and put it out."""
        headers.keep_deviation(self._product, self._channels[n], self.fail)
        self._apply()

    def _get_mode(self, n: int, argument: str) -> str:
        return "SWE" if self._channel(n).values[SWEEP] else "CW"

    def _put_mode(self, n: int, argument: str) -> None:
        swept = word_of(argument, ("CW", "FIXed", "SWEep")) == "SWE"
        self._put_on(SWEEP, n, "ON" if swept else "OFF")

    # Arbitrary waveforms

    def _load_points(self, full: float, n: int, argument: str) -> None:
        swapped = self._channel(1).words[":FORMat:BORDer"] == "SWAP"
        load(self._device, self._channel(n), full, swapped, argument, self._product.memory)

    def _receive(self, kind: str, n: int, argument: str) -> None:
        channel = self._channel(n)
        if receive(self._device, channel, kind, argument, self._product.memory):
            channel.words[SHAPE] = "ARB"
            self._apply()

    def _select(self, n: int, name: str) -> None:
        select(self._channel(n), name)
        self._apply()

    # Output

    def _software_trigger(self) -> None:
        if not self._product.by_mode:
            raise ScpiError(-113, "Undefined header")
        waiting = [n for n, c in self._channels.items() if self._trigger(c) == "BUS"]
        for n in waiting:
            self._fire(n)
        if not waiting:
            raise ScpiError(-211, "Trigger ignored")

    def _trigger(self, channel: Channel) -> str:
        """Return the source of the trigger of what is on, sweep or burst."""
        return channel.words[self._triggers[-1 if channel.values[BURST] else 0]]

    def _fire(self, n: int) -> None:
        channel = self._channel(n)
        wanted = "BUS" if self._product.by_mode else "MAN"
        if not (channel.values[SWEEP] or channel.values[BURST]) or self._trigger(channel) != wanted:
            raise ScpiError(-211, "Trigger ignored")
        if not channel.values[_CONTINUOUS]:
            if not channel.armed:
                raise ScpiError(-211, "Trigger ignored")
            channel.armed -= 1
        if n == 1:
            self._advance(self._clock.now())
            self.playing.fire()

    def _arm(self, n: int) -> None:
        channel = self._channel(n)
        if channel.values[_CONTINUOUS]:
            raise ScpiError(-213, "Init ignored")
        channel.armed = round(channel.values.get(":TRIGger#:COUNt", 1.0))

    def _abort(self) -> None:
        """End what was triggered; sweep and burst wait again."""
        for channel in self._channels.values():
            channel.armed = 0
        self._advance(self._clock.now())
        self.playing.abort()

    def _apply(self) -> None:
        """Step the plant to now with the old output, then put out the current settings of channel 1."""
        channel = self._channel(1)
        values, words = channel.values, channel.words
        timed = self._trigger(channel) == "TIM"
        period = values[":TRIGger#:TIMer"] if timed else values[_BURST_PERIOD]
        points = channel.points.get(channel.arb)
        by_frequency = words.get(ARB_MODE) == "FREQ"
        endless = words[BURST_MODE] == "INF"
        cycles = math.inf if endless else values[_CYCLES]
        self._advance(self._clock.now())
        self.playing.set(
            Output(
                on=bool(values[_ON]),
                shape=words[SHAPE],
                amplitude=channel.peak_to_peak / 2 * (-1 if words[":OUTPut#:POLarity"] == "INV" else 1),
                offset=channel.offset,
                frequency=values[FREQUENCY],
                duty=duty(channel) if words[SHAPE] == "PULS" else values[_DUTY] / 100,
                symmetry=values[_SYMMETRY] / 100,
                points=points,
                rate_hz=values[FREQUENCY] * len(points) if points and by_frequency else values[_RATE],
                sweep=(values[START], values[STOP], values[TIME]) if values[SWEEP] else None,
                burst=(cycles, period) if values[BURST] else None,
                burst_phase=values[BURST_PHASE] / 360,
                modulation=modulation_of(values, words),
                ends=(channel.low, channel.high) if values[LIMITED] else (-HIGHEST / 2, HIGHEST / 2),
                delay=values.get(":TRIGger#:DELay", values["[:SOURce#]:BURSt:TDELay"]),
                logarithmic=words[SPACING] == "LOG",
                repeats=self._trigger(channel) in ("IMM", "INT", "TIM") and not (endless and values[BURST]),
            )
        )

    def _channel(self, n: int) -> Channel:
        if n not in self._channels:
            raise ScpiError(-114, "Header suffix out of range")
        return self._channels[n]

    def _text(self, value: float) -> str:
        return self._product.infinite if value >= INFINITE else format(value, self._product.number)


def _boolean(argument: str) -> bool:
    match argument.upper():
        case "ON" | "1":
            return True
        case "OFF" | "0":
            return False
    raise ScpiError(-224, "Illegal parameter value") if argument else ScpiError(-109, "Missing parameter")
