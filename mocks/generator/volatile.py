"""Volatile memory: the points of arbitrary waveforms. The DG1000Z plays what is sent to it at once."""

from __future__ import annotations

import numpy as np

from ...base.arrays import FloatArray
from .channel import Channel
from .scpi import ScpiDevice, ScpiError, word_of
from .waveform import Points

_NAME = '"VOLATILE"'
_FULL = 16383
"""Code of the highest level (DG1000Z programming guide, 2-174)."""


def load(device: ScpiDevice, channel: Channel, full: float, swapped: bool, argument: str, most: int) -> None:
    """Take a named waveform of at most `most` points up to `full`, as the 33500 does. Raises ScpiError."""
    name, _, values = argument.partition(",")
    kind = ("<" if swapped else ">") + ("f4" if full == 1.0 else "i2")
    points = device.numbers_in(values, kind) / full
    _check(points, 8, most)
    if quoted(name) in channel.points:
        raise ScpiError(785, "Specified arb waveform already exists")
    channel.points[quoted(name)] = Points(points)


def select(channel: Channel, name: str) -> None:
    """Choose the waveform that is put out. Raises ScpiError for one that is not there."""
    if quoted(name) not in channel.points and quoted(name) != channel.arb:
        raise ScpiError(786, "Specified arb waveform does not exist")
    channel.arb = quoted(name)


def quoted(name: str) -> str:
    """Return a waveform's name as the instrument reports it: quoted and in capitals."""
    return f'"{name.strip().strip(chr(34)).upper()}"'


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
    _check(levels, 2, most)
    if flag == "CON":
        channel.arriving.append(levels)
        return False
    channel.points[_NAME] = Points(levels)
    channel.arb = _NAME
    return True


def _check(levels: FloatArray, least: int, most: int) -> None:
    if len(levels) < least:
        raise ScpiError(-109, "Missing parameter")
    if len(levels) > most:
        raise ScpiError(-223, "Too much data")
    if np.abs(levels).max() > 1.0 + 1e-6:
        raise ScpiError(-222, "Data out of range")
