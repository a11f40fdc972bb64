"""Formats of digital lines in the driver's calls: words of a port, and lines in rising order."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..base.arrays import FloatArray
from .channel import Channel


def port_words(channels: Sequence[Channel], rows: Any) -> Any:
    """Pack (lines, samples) bool into (channels, samples) words: bit i is line i; higher ports follow."""
    words, row = [], 0
    for channel in channels:
        bits = _bits(channel)
        mine = rows[row : row + len(bits)].astype(np.uint32)
        words.append((mine << np.array(bits, dtype=np.uint32)[:, np.newaxis]).sum(axis=0, dtype=np.uint32))
        row += len(bits)
    return np.array(words, dtype=np.uint32)


def word_lines(channels: Sequence[Channel], words: Any) -> FloatArray:
    """Unpack (channels, samples) words into (lines, samples) of 0 and 1: the reverse of `port_words`."""
    lines = []
    for channel, row in zip(channels, words, strict=True):
        lines += [(np.asarray(row, dtype=np.int64) >> bit) & 1 for bit in _bits(channel)]
    return np.array(lines, dtype=np.float64)


def _bits(channel: Channel) -> list[int]:
    base, bases = 0, {}
    for port in sorted({line.partition("/")[0] for line in channel.physical}):
        bases[port] = base
        base += channel.product.ports[int(port.removeprefix("port"))]
    return [bases[p] + int(n) for p, _, n in (line.partition("/line") for line in channel.physical)]


def line_order(channel: Channel) -> list[int]:
    """Return the order of a channel's lines in the driver's arrays: rising, independent of their naming."""
    bits = _bits(channel)
    return sorted(range(len(bits)), key=bits.__getitem__)
