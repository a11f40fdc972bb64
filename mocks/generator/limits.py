"""What a setting may be: highest frequencies by shape, units of angles, modes that exclude each other."""

from __future__ import annotations

import math

from .channel import Channel
from .headers import SHAPE, START, STOP
from .modulation import AM, DEVIATION, FM, PACE
from .products import Product
from .pulses import FREQUENCY
from .scpi import Fail, ScpiError, unit_of

SWEEP, BURST = "[:SOURce#]:SWEep:STATe", "[:SOURce#]:BURSt:STATe"
TIME, BURST_PHASE = "[:SOURce#]:SWEep:TIME", "[:SOURce#]:BURSt:PHASe"
_FREQUENCIES = (FREQUENCY, START, STOP, "[:SOURce#]:MARKer:FREQuency")
_MODES = {SWEEP: "sweep", BURST: "burst", AM: "AM", FM: "FM"}
_ANGLES = ("[:SOURce#]:PHASe[:ADJust]", BURST_PHASE)
_KINDS = {
    **dict.fromkeys((*_FREQUENCIES, DEVIATION, *PACE.values()), "HZ"),
    **dict.fromkeys(_ANGLES, "DEG"),
    TIME: "S",
}
_RADIAN = 180 / math.pi


def kind_of(header: str) -> str:
    """Return the kind of a setting's units, for `number_of`."""
    return _KINDS.get(header, "")


def highest(product: Product, channel: Channel, header: str, high: float) -> float:
    """Return the upper limit of a setting: of a frequency that of the product and the shape (Hz)."""
    if header not in _FREQUENCIES:
        return high
    return product.highest.get(channel.words.get(SHAPE, "SIN"), product.highest["SIN"])


def degrees(header: str, unit: str) -> float:
    """Return the degrees in the `unit` of angles that is set; 1 of any other setting."""
    return _RADIAN if header in _ANGLES and unit == "RAD" else 1.0


def in_degrees(header: str, argument: str, value: float, unit: str) -> float:
    """Return the `value` of an argument in degrees, where the setting is an angle."""
    own = unit_of(argument)
    if argument[:1].upper() == "M" or header not in _ANGLES or own not in ("", "RAD"):
        return value
    return value * (_RADIAN if own else degrees(header, unit))


def exclude(values: dict[str, float], header: str, fail: Fail) -> None:
    """Switch the other modes off for one: of sweep, burst and the modulations, one is on."""
    for other, name in _MODES.items():
        if header in _MODES and other != header and values[other]:
            values[other] = 0.0
            fail(ScpiError(-221, f"Settings conflict; {name} turned off by selection of other mode"))


def keep_deviation(product: Product, channel: Channel, fail: Fail) -> None:
    """Reduce the deviation of a frequency modulation to what carrier and shape allow."""
    carrier = channel.values[FREQUENCY]
    most = min(carrier, highest(product, channel, FREQUENCY, math.inf) - carrier)
    if channel.values[FM] and channel.values[DEVIATION] > most:
        channel.values[DEVIATION] = most
        fail(ScpiError(-221, "Settings conflict; FM deviation limited by frequency"))
