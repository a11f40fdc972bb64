"""What a client asks beside the signal, and APPLy: display, list of waveforms, modulations that are off."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Protocol

from .headers import Product
from .levels import Quantity
from .scpi import Entry, Fail, ScpiError, number_of, word_of
from .waveform import Channel

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
