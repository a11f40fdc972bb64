"""Settling before a play: erases a patch's memory of earlier volts, and waits until the surface is at rest.

A play right after another waveform is 40 to 60 % wrong, because the hysteresis of a patch remembers its last
turning points (measured). A sine whose amplitude falls slowly to zero erases them, as for a magnet; the
decay of the surface is then measured, not assumed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ...base.arrays import FloatArray
from ...base.errors import InstrumentError
from ...base.progress import Progress, silent

if TYPE_CHECKING:
    from ...instruments import Capture, Rig

_HZ, _CYCLES = 40.0, 16
"""Frequency (Hz) and number of cycles of the run-down, below a table's first mode. After it the first play
differs from the fifth by 0.4 % of its target; with half the cycles by 0.7 % (measured)."""
_MARGIN = 0.999
"""Level of the run-down over the limit: a player's own rate may overshoot by some millionths."""
_ALLOWED = 0.98
"""Share that is played of what a limit other than that of the volts allows."""
_TAIL = 0.5
"""Time (s) recorded after the run-down, at first."""
_LONGEST = 16.0
"""Longest time (s) recorded after a run-down."""
_LONG, _STAYS = 4.0, 0.7
"""Recording time (s) from which what has not fallen by this factor since the last time is no ringing: one
that falls so slowly has a time constant above ten seconds."""
_CLEAR = 4.0
"""Fall of a line's amplitude, over the noise around it, from which it rings."""
_AROUND, _HIGHEST = 60.0, 2000.0
"""Width (Hz) over which noise is compared, and the highest frequency that is looked at."""
RESOLVED = 1e-4
"""Rms velocity that still rings, over the vibrometer's range, below which a surface is at rest: half a
12-bit card's step, and some percent of a button's motion at the lowest modes."""


def run_down(rate_hz: float, peak: float) -> FloatArray:
    """(samples,) V of a sine that falls linearly from `peak` to zero, with zero mean and zero ends."""
    t = np.arange(round(_CYCLES / _HZ * rate_hz)) / rate_hz
    envelope = np.minimum(t * _HZ, 1.0) * (1 - t * _HZ / _CYCLES)
    volts = envelope * np.sin(2 * np.pi * _HZ * t)
    volts -= envelope * (volts.sum() / envelope.sum())
    return np.asarray(volts * (peak / np.abs(volts).max()))


def full_level(rig: Rig, shape: Callable[[float], FloatArray]) -> float:
    """Largest peak (V) that the rig's limits allow for a waveform, whose volts `shape` makes for a peak.

    The volts bind on most rigs; a coil's heat, or the amplifier's current, may bind before.
    """
    peak = rig.limits.peak
    factor, _ = rig.limits.headroom(shape(peak), rig.table.rate_hz)
    return float(peak * (1.0 if factor > 1 - 1e-6 else _ALLOWED * factor))


def settle(rig: Rig, patches: Sequence[str], progress: Progress = silent) -> float:
    """Erase the memory of patches and wait until the surface is at rest; returns the time that took (s).

    Raises InstrumentError when the drive monitor does not show the volts that erase it, when the surface does
    not come to rest, and what `Rig.excite` raises.
    """
    rate_hz = rig.table.rate_hz
    peak = full_level(rig, lambda peak: run_down(rate_hz, peak))
    volts, tail, waited = run_down(rate_hz, _MARGIN * peak), _TAIL, 0.0
    before = np.inf
    while tail <= _LONGEST:
        monitors = dict.fromkeys(map(rig.monitor, patches))
        capture = rig.excite(volts, patches, (rig.vibrometer.channel, *monitors), tail)
        waited += len(volts) / rate_hz + tail
        progress("Settle", waited, waited, "s")
        if volts.any():
            for patch in patches:
                refuse_silent_drive(_gain(rig, capture, volts, rig.monitor(patch)), patch)
        ringing = ringing_of(rig.vibrometer.to_si(capture.volts[0])[len(volts) :], rate_hz)
        # Written so that NaN passes: what follows the settling judges it. So does what goes on and on, such
        # as a fan whose speed wanders: it is no ringing.
        if not ringing > RESOLVED * rig.vibrometer.range or (tail >= _LONG and ringing > _STAYS * before):
            return waited
        # The memory is erased already: from here on only the surface's own ringing has to decay.
        volts, tail, before = np.zeros(1), 2 * tail, ringing
    raise InstrumentError(
        f"The surface did not come to rest within {waited:.0f} s after patch {', '.join(patches)} was "
        "played: make sure that nothing shakes the table, and that nobody touches it."
    )


def refuse_silent_drive(gain: float, patch: str) -> None:
    """Raise InstrumentError for volts at a patch, over those that it was to get, that are not near 1."""
    if not 0.7 < gain < 1.4:
        raise InstrumentError(
            f"The drive monitor shows {gain:.2g} V for each volt that patch {patch} was to get: check the "
            "amplifier (is it on?), the relay, and the gain and divider in the rig file."
        )


def _gain(rig: Rig, capture: Capture, volts: FloatArray, monitor: str) -> float:
    """Rms volts of a drive monitor over those of a drive."""
    divider = rig.sensors.drive
    assert divider is not None
    shown = divider.to_si(capture.volts[[capture.channels.index(monitor)]])[0][: len(volts)]
    return float(np.std(shown) / np.std(volts))


def ringing_of(velocity: FloatArray, rate_hz: float) -> float:
    """Rms velocity that still rings at the end of a record in which nothing is driven.

    What rings has less amplitude in the record's second half than in its first; hum, a fan and noise have as
    much. A slow ringing looks as steady as they do for a moment: only its fall tells it from them.
    """
    half = len(velocity) // 2
    window = np.hanning(half)
    before, after = (
        np.abs(np.fft.rfft((part - part.mean()) * window))[: round(_HIGHEST * half / rate_hz)]
        for part in (velocity[:half], velocity[len(velocity) - half :])
    )
    near = max(3, round(_AROUND * half / rate_hz))
    floor = np.sqrt(scipy.ndimage.median_filter(np.minimum(before, after) ** 2, near, mode="nearest"))
    falls = before - after > _CLEAR * floor
    # From the middle of the second half to its end it falls once more by the root of the ratio.
    at_end = after[falls] * np.sqrt(after[falls] / np.maximum(before[falls], 1e-300))
    # Of a windowed tone, a few lines hold the power: Parseval.
    return float(np.sqrt(2 * np.sum(at_end**2) / (half * np.sum(window**2))))
