"""What a client asks beside the signal: the display, the list of waveforms, modulations that are off."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from .channel import Channel
from .levels import Quantity
from .products import Product
from .scpi import Entry, Fail, ScpiError, number_of, word_of

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
