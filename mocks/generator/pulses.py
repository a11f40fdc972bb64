"""Pulse of a simulated function generator: width and share of the period, of which one is held.

The other follows the frequency, as both families do it.
"""

from __future__ import annotations

from .channel import Channel

FREQUENCY = "[:SOURce#]:FREQuency[:CW|:FIXed]"
HOLD = "[:SOURce#]:FUNCtion:PULSe:HOLD"
_WIDTH, _DUTY = "pulse width", "pulse duty"
PULSES: dict[str, tuple[float, float]] = {
    "PERiod": (33e-9, 1e6),
    "WIDTh": (16e-9, 1e6),
    "DCYCle": (0.0, 100.0),
}
"""Lowest and highest of what is set of a pulse (s, s, %)."""


def duty(channel: Channel) -> float:
    """Share of its period that a pulse is high."""
    if channel.words[HOLD] == "WIDT":
        return min(channel.values.get(_WIDTH, 100e-6) * channel.values[FREQUENCY], 1.0)
    return channel.values.get(_DUTY, 0.1)


def pulse_value(channel: Channel, name: str) -> float:
    """Return a key of `PULSES` in its unit."""
    frequency = channel.values[FREQUENCY]
    match name:
        case "PERiod":
            return 1 / frequency
        case "WIDTh":
            return duty(channel) / frequency
    return 100 * duty(channel)


def set_pulse(channel: Channel, name: str, value: float) -> None:
    """Set a key of `PULSES` in its unit."""
    if name == "PERiod":
        channel.values[FREQUENCY] = 1 / value
        return
    share = value / 100 if name == "DCYCle" else value * channel.values[FREQUENCY]
    channel.values[_DUTY] = min(share, 1.0)
    channel.values[_WIDTH] = channel.values[_DUTY] / channel.values[FREQUENCY]


def hold(channel: Channel) -> None:
    """Let what has been held go on from the pulse that is put out now, whichever is held next."""
    set_pulse(channel, "DCYCle", 100 * duty(channel))
