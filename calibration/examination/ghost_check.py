"""Test for ghosts: a channel that shows the one that its card converts before it.

A multiplexed card converts its channels with one amplifier, which comes to each with the volts of the one
before. A source of low impedance settles it in time; one of some kiloohms does not (NI: below 1 kOhm;
docs/hardware.md). Read alone, a channel has nothing before it. So each is read alone and among the others, in
turns, and the difference of its means is compared with their scatter and with the difference to the channel
before it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...base.arrays import FloatArray
from ...instruments import Rig
from .finding import Finding
from .sensor_check import COUNTS

_TURNS = 4
_TURN = 0.1
"""Number of readings of each kind, and their length (s): whole periods of 50 and of 60 Hz."""
_APART = 0.02
"""Least difference from the channel before, as a part of the range, at which a ghost would show."""
_SIGMAS = 5.0
_PART = 2e-3
"""Part of that difference above which a ghost is told: 0.2 %."""


def check_ghosts(rig: Rig, cards: Sequence[Sequence[str]]) -> Iterator[Finding]:
    """Test each channel of each of `cards` (channels in the order of conversion)."""
    for channels in cards:
        if len(channels) > 1:
            yield from _of_card(rig, channels)


def _of_card(rig: Rig, channels: Sequence[str]) -> Iterator[Finding]:
    with rig.daq.stream(channels, rig.file.rate_hz, 10, 20) as stream:
        converted = stream.full_scale < COUNTS
        delays, ranges = stream.delays[converted], stream.full_scale[converted]
    channels = [name for name, one in zip(channels, converted, strict=True) if one]
    if not len(delays) or np.ptp(delays) == 0:  # each has its own converter
        return
    together, alone = np.empty((2, _TURNS, len(channels)))
    for turn in range(_TURNS):
        together[turn] = _means(rig, channels)
        alone[turn] = [_means(rig, [name])[0] for name in channels]
    ghosts = []
    for row in range(1, len(channels)):
        before = row - 1
        gap = float(alone[:, before].mean() - alone[:, row].mean())
        if abs(gap) < _APART * ranges[row]:
            continue
        shift = together[:, row] - alone[:, row]
        error = float(shift.std(ddof=1) / np.sqrt(_TURNS))
        part = float(shift.mean()) / gap
        if abs(shift.mean()) > _SIGMAS * error and part > _PART:
            ghosts.append((channels[row], channels[before], part))
    for name, other, part in ghosts:
        yield Finding(
            f"Ghost in {name}",
            "daq",
            "yellow",
            f"{name} shows {part:.1%} of the difference to {other}, which its card converts before it: its "
            "source has a high impedance. Give it a buffer, convert more slowly (ai_conv_rate in [daq]), or "
            f"let it follow a channel of nearly its own volts, not {other}: by the order of the rig file.",
        )


def _means(rig: Rig, channels: Sequence[str]) -> FloatArray:
    rate_hz = rig.file.rate_hz
    samples = max(2, round(_TURN * rate_hz))
    with rig.daq.stream(channels, rate_hz, samples, samples) as stream:
        return np.asarray(stream.capture().volts.mean(axis=1))
