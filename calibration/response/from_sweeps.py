"""Estimate of a response from sweeps, the paper's method: the DAQ's own, and the generator's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import InstrumentError
from ...base.filters import correlate_within, fast_length
from ...base.progress import Progress, part_of, silent
from ...instruments import Sweep
from ..spectra import fade
from .excitation import LinearSweep
from .response import FrfEstimate
from .spot import Channels, Spot, overloaded, signals_of

if TYPE_CHECKING:
    from ...instruments import Capture, Rig

_LOWEST = 20.0
"""Lowest frequency (Hz): below it the sweep fades in."""
_END = 5.0
"""Margin below the sweep's end (Hz), for its fade."""
_MORE = (8.0, 3.0)
"""Extra band below and above (Hz), for operations that need neighbouring lines."""
_ROOM = 1.5
"""Silence appended (s), so that harmonics, which wrap around to the end, stay clear of what rings."""
_PART = 75.0
"""Width (Hz) of the overlapping parts in which harmonics are separated from the response."""
_NEAR, _POOL = 5, 41
"""Neighbouring lines whose noise is averaged, the larger mean counts: over 5 Hz a few repeats give its level
within 10 %, and hum is on a few lines."""
_LEFT, _AT_END, _END_HZ = 0.06, 0.7, 40.0
"""Part of the harmonics that stays in the response, and the part more at the sweep's end, falling over so
many Hz: measured on plants with hysteresis of two kinds."""
_STAYS = 0.6
"""Part of the noise's power that stays, at least, when harmonics are removed."""
_WINDOW, _SLOWEST, _SIGNIFICANT = 0.2, 0.95, 6.0
"""Length (s) of the windows at a record's end whose ringing is compared; their ratio from which it is
a tone from elsewhere; and the ratio to the noise's power from which it is no noise."""
_CHANGED = 2.0
"""Variance, over that of a response at a smaller level, up to which a change of its shape may be noise."""
_FURTHER = 2.0
"""Error, for a steady sine at the full level, over that change: a sweep does not stay on a resonance until it
has reached its full amplitude (1.3 to 3.6 was measured on three plants with soft modes)."""
_STRAYS = 0.5
"""Distance of a line's gain from the median's, over it, from which it tells nothing of a level's gain."""
_SHIFT = 81
"""Lines (10 Hz) from whose change a drift of the resonance among them is estimated."""


def from_sweeps(
    sweep: LinearSweep,
    commanded: FloatArray,
    drives: Sequence[FloatArray],
    velocities: Sequence[FloatArray],
    channels: Channels,
) -> FrfEstimate:
    """Estimate the response by dividing spectra of whole records, ringing included: without leakage.

    `commanded` is (samples,) V, one sweep at the full level; `drives`, (samples,) V each, and
    `velocities`, (samples,) each, what the pick-up shows, are as sampled: `sweep.repeats` plays at that
    level, then one at each of `sweep.shares`.
    """
    rate_hz, repeats = channels.rate_hz, sweep.repeats
    samples = len(drives[0])
    length = fast_length(samples + round(_ROOM * rate_hz))
    low, high = _LOWEST, sweep.stop_hz - _END
    first, last = (edge * length / rate_hz for edge in (low - _MORE[0], high + _MORE[1]))
    lines = slice(int(np.ceil(first)), int(np.floor(last)) + 1)
    f = np.arange(lines.start, lines.stop) * rate_hz / length
    order = np.fft.rfft(commanded, length)[lines]
    # Without the mean, zero padding makes no step. One play at a time, of which these lines are kept: memory
    # that is new costs more than the transform.
    X, Y = (
        np.array([np.fft.rfft(signal - signal.mean(), length)[lines].copy() for signal in signals])
        for signals in (drives, velocities)
    )
    X, Y = X * channels.drive(X[:repeats], order, f), channels.velocity(Y, f)
    x, y = X[:repeats], Y[:repeats]

    power = (np.abs(x) ** 2).sum(axis=0)
    H = (np.conj(x) * y).sum(axis=0) / power
    # The drive is far above its noise, so the part that does not repeat is the velocity's noise.
    residual = (np.abs(y - H * x) ** 2).sum(axis=0) / (repeats - 1)
    residual = np.maximum(
        *(scipy.ndimage.uniform_filter1d(residual, pool, mode="nearest") for pool in (_NEAR, _POOL))
    )
    speed = sweep.stop_hz / sweep.seconds
    raw = H
    H = without_harmonics(raw, f, speed)
    smaller = [without_harmonics(b / a, f, speed) for a, b in zip(X[repeats:], Y[repeats:], strict=True)]
    kept = (f >= low) & (f <= high)
    signal = np.maximum((np.abs(H) ** 2 * power - residual) / repeats, 0.0)
    level_gain = np.array(
        [
            _gain(H[kept], h[kept], (signal * share**2 / (signal * share**2 + residual))[kept])
            for h, share in zip(smaller, sweep.shares, strict=True)
        ]
    )
    removed = scipy.ndimage.uniform_filter1d(np.abs(raw - H) ** 2, _POOL, mode="nearest")
    # Where noise is most of what the gates remove, that much less stays.
    scatter = np.maximum(residual / power - removed, _STAYS * residual / power)
    left_in = _left_in(np.maximum(removed - residual / power, 0.0), sweep.stop_hz - f)
    variance = scatter + left_in
    # What is compared there is what the pick-up shows, of which a velocity has this much power on each line.
    shown = np.abs(channels.laser(f)) ** 2
    cut_off = _cut_off(
        sum(velocities[1:repeats], velocities[0]) / repeats,
        rate_hz,
        length,
        lines,
        shown * residual / repeats,
    )
    variance += cut_off / shown / (power / repeats)
    variance += _drift(H, f, y / x, residual / power * repeats, len(drives))
    alone = [residual / np.abs(a) ** 2 + left_in for a in X[repeats:]]
    variance += _of_shape(H, smaller, level_gain, alone)
    return FrfEstimate(
        frequencies=f[kept],
        velocity=H[kept],
        deviation=np.sqrt(variance)[kept],
        scatter=np.sqrt(scatter)[kept],
        coherence=(signal / (signal + residual))[kept],
        path=(x.mean(axis=0) / order)[kept],
        noise=np.sqrt(2 * residual / (samples * rate_hz))[kept],
        distortion=np.zeros((0, 0)),
        level_gain=level_gain.astype(np.complex128),
    )


def _gain(H: ComplexArray, smaller: ComplexArray, coherence: FloatArray) -> complex:
    """Gain from a response to another (lines,), by the lines that follow the drive in both.

    A machine that runs during one play is a few lines of large ratios, whose power would outweigh all others.
    """
    ratio, weight = smaller / H, np.abs(coherence * H) ** 2
    middle = complex(_middle(ratio.real, weight), _middle(ratio.imag, weight))
    weight *= np.abs(ratio - middle) < _STRAYS * abs(middle)
    return complex(np.average(ratio, weights=weight)) if weight.any() else middle


def _middle(values: FloatArray, weight: FloatArray) -> float:
    """Weighted median."""
    order = np.argsort(values)
    reached = np.cumsum(weight[order])
    return float(values[order[np.searchsorted(reached, reached[-1] / 2)]])


def _left_in(removed: FloatArray, below: FloatArray) -> FloatArray:
    """Variance (lines,) by what `without_harmonics` leaves of the harmonics whose power it `removed`.

    `below` (lines,) is the distance from the sweep's end (Hz), near which the level falls.
    """
    return np.asarray(removed * (_LEFT + _AT_END * np.exp(-below / _END_HZ)) ** 2)


def _cut_off(
    velocity: FloatArray, rate_hz: float, length: int, lines: slice, noise: FloatArray
) -> FloatArray:
    """Power (lines,) of what still rings at the end of the records (samples,), whose spectra lack it.

    From one window to the next a mode decays by a factor q, and what follows the last window is that window
    times q / (1 - q). `noise` (lines,) is the power of the whole records' noise.
    """
    window = round(_WINDOW * rate_hz)
    floor = noise * window / len(velocity)
    smooth = max(1, round(length / window))
    before, last = (
        scipy.ndimage.uniform_filter1d(np.abs(np.fft.rfft(part - part.mean(), length)[lines]) ** 2, smooth)
        for part in (velocity[-2 * window : -window], velocity[-window:])
    )
    decay = np.sqrt(last / np.maximum(before, 1e-300))
    rings = (last > _SIGNIFICANT * floor) & (decay < _SLOWEST)
    decay = np.where(rings, decay, 0.0)
    return np.asarray(last * (decay / (1 - decay)) ** 2)


def _drift(
    H: ComplexArray, f: FloatArray, repeated: ComplexArray, variance: FloatArray, plays: int
) -> FloatArray:
    """Variance (lines,) because the table's resonances drift, from the mean of the repeats to the last play.

    `repeated` is (repeats, lines), each with `variance` (lines,). A relative drift e of a frequency changes
    the response by -e f dH/df; e is estimated around each line from the first and the last repeat, less
    what noise explains.
    """
    slope = f * np.gradient(H, f)
    change = repeated[-1] - repeated[0]
    size, seen, noise = (
        scipy.ndimage.uniform_filter1d(values, _SHIFT, mode="nearest")
        for values in (
            np.abs(slope) ** 2,
            (np.conj(slope) * change).real,
            np.abs(slope) ** 2 * variance / _SHIFT,
        )
    )
    shift = np.maximum(seen**2 - noise, 0.0) / np.maximum(size, 1e-300) ** 2
    repeats = len(repeated)
    further = (plays - 1 - (repeats - 1) / 2) / (repeats - 1)
    return np.asarray(further**2 * shift * np.abs(slope) ** 2)


def _of_shape(
    H: ComplexArray, smaller: list[ComplexArray], level_gain: ComplexArray, variances: list[FloatArray]
) -> FloatArray:
    """Variance (lines,) because the response changes with the level by more than a gain.

    A patch's hysteresis changes the gain alone; modes that soften change the shape as well, which no law of
    the patch explains. `smaller` are responses (lines,) at smaller levels, with their `variances`.
    """
    found = np.zeros(len(H))
    for one, gain, variance in zip(smaller, level_gain, variances, strict=True):
        changed = np.abs(one / gain - H) ** 2 - _CHANGED * variance / np.abs(gain) ** 2
        found = np.maximum(found, scipy.ndimage.uniform_filter1d(changed, _POOL, mode="nearest"))
    return _FURTHER**2 * found


def without_harmonics(H: ComplexArray, frequencies: FloatArray, speed: float) -> ComplexArray:
    """Remove the harmonics that the patch's hysteresis adds to a sweep's response.

    The sweep passes frequency f at the time f / speed (Hz, Hz/s). The n-th harmonic at f was excited at
    1/n of that time, so in the impulse response it lies before time zero, at (1/n - 1) f / speed, where
    a causal system has no response (Farina, AES 108th Convention, 2000, for a logarithmic sweep; with a
    linear one the position depends on f). The impulse response is gated in overlapping parts of the
    band; each gate begins half way to the second harmonic and ends where the last harmonic wraps.
    """
    # Beyond its ends the band is extended point-symmetrically and faded, because an edge would ring.
    step = float(frequencies[1] - frequencies[0])
    more = round(_PART / 2 / step)
    f = frequencies[0] + step * np.arange(-more, len(H) + more)
    longer = np.pad(H, more, mode="reflect", reflect_type="odd") * fade(len(f), more, more)
    time = np.arange(len(f)) / (len(f) * step)
    gated = np.zeros(len(f), dtype=np.complex128)
    for centre in np.arange(f[0], f[-1] + _PART, _PART):
        weight = np.clip(1 - np.abs(f - centre) / _PART, 0, 1)
        begin = 1 / step - max((centre - _PART) / speed / 4, 0.1)
        end = 1 / step - (centre + _PART) / speed
        gate = np.interp(time, [end - 0.1, end, begin, begin + 0.05], [1, 0, 0, 1])
        gated += np.fft.fft(gate * np.fft.ifft(longer * weight))
    return gated[more : more + len(H)]


# The generator's linear sweep, as in the paper: measured by the DAQ and the laser, on a clock of its own.
#
# Nothing is played by the DAQ, so no sample of a drive is known beforehand: the drive monitor shows the volts
# at the patch, and the sweep is found in them. The generator starts when its trigger arrives, above 0 Hz,
# does not fade, and goes on at its first frequency until it is switched off. All of that is in the record of
# the drive as in that of the surface, from rest to rest, and the ratio of their spectra is free of leakage.
# What breaks it: a generator that plays another sweep than the one asked for, which is refused.

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
    alike = correlate_within(calm, wanted)
    start = int(np.argmax(alike))
    gain = float(alike[start] / (wanted @ wanted))
    size = np.linalg.norm(calm[start : start + len(wanted)]) * np.linalg.norm(wanted)
    return start if alike[start] > _ALIKE * size else -1, gain
