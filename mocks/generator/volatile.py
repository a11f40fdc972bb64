"""Volatile memory of the DG1000Z, which plays what is sent to it at once."""

from __future__ import annotations

import numpy as np

from ...base.arrays import FloatArray
from .channel import Channel
from .scpi import ScpiDevice, ScpiError, word_of
from .waveform import Points

_NAME = '"VOLATILE"'
_FULL = 16383
"""Code of the highest level (DG1000Z programming guide, 2-174)."""


def receive(device: ScpiDevice, channel: Channel, kind: str, argument: str, most: int) -> bool:
    """Take points as DATA, DAC or DAC16 sends them; True with the last of them. Raises ScpiError.

    The order of the bytes was not found: the low one first (estimate).
    """
    memory, _, data = argument.partition(",")
    word_of(memory.strip(), ("VOLATILE",))
    flag = "END"
    if kind == "DAC16":
        flag, _, data = data.partition(",")
        flag = word_of(flag.strip(), ("CON", "END"))
    values = device.numbers_in(data, "<u2")
    levels = values if kind == "DATA" else values / _FULL * 2 - 1
    levels = np.concatenate([*channel.arriving, levels])
    channel.arriving.clear()
    _check(levels, most)
    if flag == "CON":
        channel.arriving.append(levels)
        return False
    channel.points[_NAME] = Points(levels)
    channel.arb = _NAME
    return True


def _check(levels: FloatArray, most: int) -> None:
    if len(levels) < 2:
        raise ScpiError(-109, "Missing parameter")
    if len(levels) > most:
        raise ScpiError(-223, "Too much data")
    if np.abs(levels).max() > 1.0 + 1e-6:
        raise ScpiError(-222, "Data out of range")
