"""The generator's linear sweep, as in the paper: measured by the DAQ and the laser, on a clock of its own.

Nothing is played by the DAQ, so no sample of a drive is known beforehand: the drive monitor shows the volts
at the patch, and the sweep is found in them. The generator starts when its trigger arrives, above 0 Hz, does
not fade, and goes on at its first frequency until it is switched off. All of that is in the record of the
drive as in that of the surface, from rest to rest, and the ratio of their spectra is free of leakage. What
breaks it: a generator that plays another sweep than the one asked for, which is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...base.arrays import FloatArray
from ...base.errors import InstrumentError
from ...base.progress import Progress, part_of, silent
from ...instruments import Capture, Rig, Sweep
from .excitation import LinearSweep
from .spot import Channels, Spot, overloaded, signals_of

START_HZ = 1.0
"""Where a sweep starts: no generator starts at 0 Hz, and no estimate begins below 20 Hz."""
LEAD = 0.05
"""Rest (s) that is kept before a sweep."""
_ALIKE = 0.9
"""Correlation of the drive monitor's volts with the sweep that was asked for, below which it is another one.
Of a steady sine, or a sweep of another length, it is below 0.1; an amplifier's corner leaves 0.99."""


@dataclass(frozen=True, eq=False)
class Swept:
    """Volts at the patch and what the laser shows, (samples,), from `LEAD` before the sweep to rest."""

    volts: FloatArray
    velocity: FloatArray
    channels: Channels
    gain: float
    """Volts at the patch per volt that it was to get."""
    problem: str
    """Sentence on a signal that left its range; empty where none did."""


def play_sweep(
    spot: Spot, sweep: LinearSweep, peak: float, progress: Progress = silent, *, beside: Sequence[str] = ()
) -> Swept:
    """Sweep a patch, and others `beside` it, `peak` V at the patch, and find the sweep in what was recorded.

    Raises what `Rig.generate` raises, and InstrumentError where the drive monitor shows another sweep.
    """
    rig, rate_hz = spot.rig, spot.rig.table.rate_hz
    recorded = (rig.monitor(spot.patch), rig.vibrometer.channel)
    capture, start, gain = capture_sweep(rig, sweep, peak, (spot.patch, *beside), recorded, progress=progress)
    first = start - round(LEAD * rate_hz)
    if first < 0:
        raise InstrumentError(
            f"The drive monitor of patch {spot.patch} does not show the sweep of {START_HZ:g} to "
            f"{sweep.stop_hz:g} Hz in {sweep.seconds:g} s that the {rig.generator.identity} was to play: "
            "check its trigger, its sweep (time, linear), its load, and the amplifier."
        )
    volts, velocity, channels = signals_of(rig, capture, spot.patch, staircase=False)
    return Swept(volts[first:], velocity[first:], channels, gain, overloaded(rig, capture) or "")


def capture_sweep(
    rig: Rig,
    sweep: LinearSweep,
    peak: float,
    patches: Sequence[str],
    channels: Sequence[str],
    *,
    progress: Progress = silent,
) -> tuple[Capture, int, float]:
    """Sweep patches, and record channels, the first of them a drive monitor.

    Returns the capture, the sample at which the sweep begins (-1 where that monitor shows none), and its
    volts over those asked for. Raises what `Rig.generate` raises.
    """
    capture = rig.generate(
        Sweep(START_HZ, sweep.stop_hz, sweep.seconds, peak), patches, channels, sweep.tail, progress
    )
    assert rig.sensors.drive is not None  # a table is measured
    shown = rig.sensors.drive.to_si(capture.volts[:1])[0]
    return capture, *_found(shown, peak * ordered(sweep, capture.rate_hz))


def play_sweeps(spot: Spot, sweep: LinearSweep, peak: float, progress: Progress) -> list[Swept]:
    """All repeats and levels of a sweep, cut to the same length.

    Raises as `play_sweep` does, and InstrumentError for a signal that left its range.
    """
    levels = (*(1.0,) * sweep.repeats, *sweep.shares)
    plays = []
    for number, share in enumerate(levels):
        tell = part_of(progress, f"Measure {spot}", sweep.duration * number / len(levels), sweep.duration)
        plays.append(play_sweep(spot, sweep, share * peak, tell))
        if plays[-1].problem:
            raise InstrumentError(plays[-1].problem)
    progress(f"Measure {spot}", sweep.duration, sweep.duration, "s")
    length = min(len(one.volts) for one in plays)
    return [replace(p, volts=p.volts[:length], velocity=p.velocity[:length]) for p in plays]


def ordered(sweep: LinearSweep, rate_hz: float) -> FloatArray:
    """(samples,) of the sweep that the generator is asked for, of 1 V."""
    waveform = Sweep(START_HZ, sweep.stop_hz, sweep.seconds, 1.0)
    t = np.arange(round(sweep.seconds * rate_hz)) / rate_hz
    pace = (waveform.stop_hz - waveform.start_hz) / waveform.duration
    return np.asarray(np.sin(2 * np.pi * (waveform.start_hz + pace * t / 2) * t))


def _found(volts: FloatArray, wanted: FloatArray) -> tuple[int, float]:
    """Sample at which a sweep begins in a record, -1 where there is none; and its volts over the wanted."""
    calm = volts - np.median(volts)
    alike = scipy.signal.correlate(calm, wanted, mode="valid", method="fft")
    start = int(np.argmax(alike))
    gain = float(alike[start] / (wanted @ wanted))
    size = np.linalg.norm(calm[start : start + len(wanted)]) * np.linalg.norm(wanted)
    return start if alike[start] > _ALIKE * size else -1, gain
