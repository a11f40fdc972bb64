"""Tests of a card's channels: volts, latency and AC coupling by a cable, and ghosts.

By a cable from an output to an input: the amplifier is unplugged, and no patch is connected. A tone tells the
ratio of what the input reads to what was played: volts per full scale of one of the two, once those of the
other are known; a voltmeter at the output tells them. A sweep tells how many samples late it is read, which
must be the same each time. A tone of a few hertz tells the corner of both couplings: each passes f / sqrt(f^2
+ fc^2).

A ghost is a channel that shows the one that its card converts before it: a multiplexed card converts its
channels with one amplifier, which comes to each with the volts of the one before. A source of low impedance
settles it in time; one of some kiloohms does not (NI: below 1 kOhm; docs/hardware.md). Read alone, a channel
has nothing before it. So each is read alone and among the others, in turns, and the difference of its means
is compared with their scatter and with the difference to the channel before it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError
from ...base.filters import correlate
from ...base.progress import Progress, silent
from ...instruments import Rig
from ...instruments.operator import Cable, Uncable
from .finding import Finding, Status
from .sensor_test import COUNTS

_TONE_HZ = 200.0
"""Frequency that every voltmeter measures."""
_READ = 8.0
"""Time for a person to read the voltmeter (s)."""
_LOW_HZ = 10.0
_TIMES = 3
"""Plays whose latency must be the same."""
_SHARE = 0.5
"""Part of what the rig's limits allow that is played."""
_SAME, _CLOSE = 0.002, 0.02
"""Relative differences of volts below which nothing is to be written, and below which it is a trifle."""
_HEARD = 0.05
"""Part of what was played below which the input does not hear it."""


def examine_loop(
    rig: Rig, channel: str, volts: float | None = None, progress: Progress = silent
) -> list[Finding]:
    """Measure a DAQ's output that feeds the amplifier by a cable to one of its own inputs.

    The operator is asked to unplug the amplifier and to plug the cable. `volts` is what a voltmeter at the
    output showed (V rms) while an earlier call played. The findings say what to write into the rig file.
    Raises ConfigurationError for a rig without such an output or without a relay, InstrumentError.
    """
    if rig.file.wiring == "direct":
        raise ConfigurationError(
            f"The rig {rig.name!r} has no relay, so a loop's plays may reach its actuator, and a drive "
            "monitor on the cable would not show it: measure as docs/how-to/sound-card.md says under "
            "'Without a relay'."
        )
    output = rig.amplifier.input
    if not output or rig.feeds_amplifier("player") or rig.feeds_amplifier("generator"):
        raise ConfigurationError(
            f"The amplifier of the rig {rig.name!r} is not fed by one output of the DAQ: name it as 'input' "
            "in [amplifier] for this test."
        )
    if volts is not None and not 0 < volts < math.inf:
        raise ConfigurationError(f"{volts} V is no reading of a voltmeter: give V rms, such as 0.35.")
    if not rig.operator.confirm(Cable(output, channel)):
        return [Finding("Loop", "daq", "yellow", "Not tested: no cable was plugged.")]
    try:
        return list(_findings(rig, output, channel, volts, progress))
    finally:
        rig.make_safe()
        rig.forget_gain()  # a cable on the drive monitor proves none
        rig.operator.confirm(Uncable(output))


def _findings(
    rig: Rig, output: str, channel: str, volts: float | None, progress: Progress
) -> Iterator[Finding]:
    limits, rate_hz = rig.limits_for(0), rig.table.rate_hz
    level = _SHARE * min(limits.peak, limits.max, -limits.min)
    played = float(rig.amplifier.to_input(np.array([level]))[0] - rig.amplifier.to_input(np.zeros(1))[0])
    tone = _tone(_TONE_HZ, _READ, rate_hz)
    heard = _played(rig, level * tone, channel, progress)
    ratio = _amplitude(heard, _TONE_HZ, rate_hz) / played
    if ratio < _HEARD:
        sentence = (
            f"{channel} hears nothing of {played:.3g} V at {output}: is the cable plugged at both ends?"
        )
        yield Finding("Loop", "daq", "red", sentence)
        return
    yield from _volts(rig, (output, channel), played, ratio, volts)
    yield _latency(rig, channel, level, progress)
    low = _amplitude(_played(rig, level * _tone(_LOW_HZ, 2.0, rate_hz), channel, progress), _LOW_HZ, rate_hz)
    yield _corner(rig, (output, channel), abs(low / played / ratio))


def _volts(
    rig: Rig, ends: tuple[str, str], played: float, ratio: float, volts: float | None
) -> Iterator[Finding]:
    """Findings on volts per full scale of output and input."""
    output, channel = ends
    out, into = _table(rig, "outputs", output), _table(rig, "channels", channel)
    real = 1.0 if volts is None else volts * math.sqrt(2) / played
    shown = f"{played / math.sqrt(2):.4g} V rms at {_TONE_HZ:g} Hz were played"
    if volts is None:
        sentence = (
            f"{shown}: put a voltmeter there while the tone plays ({_READ:g} s), and if it shows another "
            "value, run this again with --volts and that value."
        )
        yield Finding(f"Volts of {output}", "daq", "yellow", sentence)
    else:
        sentence = f"{shown}, and the voltmeter shows {volts:g}"
        yield _to_write(f"Volts of {output}", sentence, real, out, f"daq.outputs.{output}")
    sentence = f"{channel} reads {ratio:.4f} times what was played"
    yield _to_write(f"Volts of {channel}", sentence, real / ratio, into, f"daq.channels.{channel}")


def _to_write(name: str, sentence: str, factor: float, table: Mapping[str, Any], where: str) -> Finding:
    """Finding on a full scale that must be multiplied by `factor`."""
    old = table.get("volts_per_full_scale")
    if abs(factor - 1) < _SAME:
        return Finding(name, "daq", "green", f"{sentence}: as the rig file says.")
    status: Status = "yellow" if abs(factor - 1) < _CLOSE else "red"
    if isinstance(old, int | float):
        todo = f"write volts_per_full_scale = {old * factor:.4g} in [{where}]"
    else:
        todo = f"its volts are {factor:.4f} times what they should be: check the wiring, and the card"
    return Finding(name, "daq", status, f"{sentence}: {todo}.")


def _latency(rig: Rig, channel: str, level: float, progress: Progress) -> Finding:
    """Finding on the samples by which an input is late, in several plays."""
    rate_hz = rig.table.rate_hz
    t = np.arange(round(0.5 * rate_hz)) / rate_hz
    sweep = np.sin(2 * np.pi * (100 * t + 1500 * t**2)) * np.sin(np.pi * t / 0.5) ** 2
    sweep -= sweep.mean()
    found = [_late(_played(rig, level * sweep, channel, progress), sweep) for _ in range(_TIMES)]
    late = [samples for samples, _ in found]
    told = ", ".join(map(str, late))
    if any(upside_down for _, upside_down in found):
        sentence = "The input reads the output upside down: swap the wires of one of them."
        return Finding("Latency", "daq", "red", sentence)
    if len(set(late)) > 1:
        sentence = (
            f"The input is late by {told} samples, another time each, so no play is aligned: use a driver "
            "whose latency stays (ASIO, WASAPI exclusive, ALSA hw), and close other programs."
        )
        return Finding("Latency", "daq", "red", sentence)
    declared = rig.file.daq.settings.get("latency")
    sentence = f"The input is late by {late[0]} samples in each of {_TIMES} plays"
    if late[0] in (0, 1):
        return Finding("Latency", "daq", "green", f"{sentence}.")
    todo = "the card does not play and record on one clock edge"
    if isinstance(declared, int):
        todo = f"write latency = {declared + late[0]} in [daq]"
    return Finding("Latency", "daq", "red", f"{sentence}: {todo}.")


def _corner(rig: Rig, ends: tuple[str, str], passed: float) -> Finding:
    """Finding on what both couplings together pass of a low tone."""
    low = np.array([_LOW_HZ])
    declared = float(abs((rig.daq.output_response(ends[0], low) * rig.daq.response(ends[1], low))[0]))
    sentence = f"Output and input together pass {passed:.3f} of {_LOW_HZ:g} Hz"
    if abs(passed - declared) < _CLOSE:
        return Finding("AC coupling", "daq", "green", f"{sentence}, and {declared:.3f} by the rig file.")
    corner = _LOW_HZ * math.sqrt(max(1 / passed - 1, 0.0))
    todo = f"write high_pass_hz = {corner if corner > 0.05 * _LOW_HZ else 0:.3g} for both"
    return Finding("AC coupling", "daq", "red", f"{sentence}, and {declared:.3f} by the rig file: {todo}.")


def _table(rig: Rig, kind: str, name: str) -> Mapping[str, Any]:
    """The rig file's table of an output or a channel."""
    named = rig.file.daq.settings.get(kind, {})
    table = named.get(name, {}) if isinstance(named, Mapping) else {}
    return table if isinstance(table, Mapping) else {}


def _played(rig: Rig, drive: FloatArray, channel: str, progress: Progress) -> FloatArray:
    return np.asarray(rig.excite(drive, (), [channel], 0.1, progress).volts[0])


def _tone(hz: float, duration: float, rate_hz: float) -> FloatArray:
    """A tone of amplitude 1 in whole periods, faded in and out."""
    t = np.arange(round(duration * rate_hz)) / rate_hz
    fade = np.clip(np.minimum(t, duration - t) / 0.1, 0, 1)
    tone = np.sin(2 * np.pi * hz * t) * fade
    return np.asarray(tone - tone.mean())


def _amplitude(volts: FloatArray, hz: float, rate_hz: float) -> float:
    """Amplitude of a tone in the middle of a record."""
    edge = round(0.3 * rate_hz)
    middle = volts[edge : len(volts) - edge]
    t = (edge + np.arange(len(middle))) / rate_hz
    basis = np.stack([np.sin(2 * np.pi * hz * t), np.cos(2 * np.pi * hz * t), np.ones_like(t)], axis=1)
    found = np.linalg.lstsq(basis, middle, rcond=None)[0]
    return float(np.hypot(found[0], found[1]))


def _late(heard: FloatArray, sweep: FloatArray) -> tuple[int, bool]:
    """Samples by which a sweep is late in a record, and True when it is upside down there."""
    alike = correlate(heard, sweep)
    best = int(np.abs(alike).argmax())
    return best - (len(sweep) - 1), bool(alike[best] < 0)


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
