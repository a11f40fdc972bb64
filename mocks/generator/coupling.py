"""Two channels of a simulated function generator whose frequencies are coupled.

Channel 2 has channel 1's frequency and an offset more, or a ratio times it; whichever is set, the other
follows (DG800 programming guide, FREQuency:COUPle; the same of a 33500 is an estimate).
"""

from __future__ import annotations

from collections.abc import Mapping

from .channel import Channel
from .pulses import FREQUENCY
from .scpi import Fail, ScpiError

COUPLED = "[:SOURce#]:FREQuency:COUPle[:STATe]"
MODE = "[:SOURce#]:FREQuency:COUPle:MODE"
OFFSET, RATIO = "[:SOURce#]:FREQuency:COUPle:OFFSet", "[:SOURce#]:FREQuency:COUPle:RATio"
HOW = (MODE, OFFSET, RATIO)
RIGOL_COUPLES = {
    COUPLED: ":COUPling:FREQuency[:STATe]",
    MODE: ":COUPling:FREQuency:MODE",
    OFFSET: ":COUPling:FREQuency:DEViation",
    RATIO: ":COUPling:FREQuency:RATio",
}
"""Headers that the DG1000Z has besides."""


def follow(
    channels: Mapping[int, Channel], n: int, low: float, highest: Mapping[int, float], fail: Fail
) -> None:
    """Let the other channel's frequency follow that of channel `n`, where they are coupled.

    One that would go beyond its `highest` (Hz), or below `low`, stays there, and the first one with it.
    """
    values = channels[1].values
    if not values[COUPLED]:
        return
    plus, times = (values[OFFSET], 1.0) if channels[1].words[MODE] == "OFFS" else (0.0, values[RATIO])

    def other_of(which: int, hz: float) -> float:
        return hz * times + plus if which == 1 else (hz - plus) / times

    other = 3 - n
    wanted = other_of(n, channels[n].values[FREQUENCY])
    taken = min(max(wanted, low), highest[other])
    channels[other].values[FREQUENCY] = taken
    if taken != wanted:
        channels[n].values[FREQUENCY] = min(max(other_of(other, taken), low), highest[n])
        fail(ScpiError(-221, "Settings conflict; frequency coupling limited frequency on other channel"))
