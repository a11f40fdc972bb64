"""Playing a drive and measuring the whole motion of the surface, up to what laser and card resolve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from ...instruments import Capture, ConfigurationError, Rig
from ...instruments.arrays import FloatArray
from ...instruments.progress import Progress, silent
from ..response import overloaded, settle
from ..spectra import fade, resample
from .drive import Drive

__all__ = ["Played", "play", "refuse_foreign", "target_of"]

_TAIL = 0.1
"""Recording time (s) after the drive, so that the vibrometer's delay truncates nothing."""
_BEFORE = 0.05
"""Time (s) at the beginning of a play in which the drive is nearly zero, for the laser's offset."""


@dataclass(frozen=True, eq=False)
class Played:
    """Measurements of several plays of one drive: `accelerations` is (plays, samples) m/s^2.

    The first sample is the drive's. All motion up to `judged_hz` is in it; nothing is filtered out below
    that.
    """

    accelerations: FloatArray
    rate_hz: float
    judged_hz: float
    peak: float
    """Largest voltage at the patch (V)."""
    overload: str | None
    """Sentence about the signal that left its range, if any."""


def play(
    rig: Rig,
    drive: Drive,
    plays: int,
    tail: float = 0.0,
    progress: Progress = silent,
    *,
    settled: bool = False,
) -> Played:
    """Settle the table, play a drive, and measure the surface on the drive's clock, for `tail` s longer.

    `settled` leaves the settling out, for plays that follow others of the same kind.
    """
    if not settled:
        settle(rig, drive.patch)
    channels = (rig.monitor(drive.patch), rig.vibrometer.channel)
    top = min(rig.vibrometer.resolved_hz, drive.rate_hz / 4)
    factor = int(drive.rate_hz // (2 * top))
    samples = -(-(len(drive.volts) + round(tail * drive.rate_hz)) // factor)
    accelerations, peaks, problems = [], [], []
    for number in range(plays):
        capture = rig.excite(drive.volts, (drive.patch,), channels, tail + _TAIL)
        accelerations.append(_acceleration(rig, capture, top, factor)[:samples])
        peaks.append(_peak(rig, capture))
        problems.append(overloaded(rig, capture))
        progress("Play", number + 1, plays, "plays")
    overload = next((p for p in problems if p), None)
    return Played(np.array(accelerations), drive.rate_hz / factor, top, max(peaks), overload)


def target_of(drive: Drive, rate_hz: float) -> FloatArray:
    """(samples,) m/s^2: a drive's target at the sample rate of its plays."""
    factor = round(drive.rate_hz / rate_hz)
    samples = -(-len(drive.target) // factor)
    return resample(np.pad(drive.target, (0, samples * factor - len(drive.target))), samples)


def refuse_foreign(rig: Rig, drive: Drive) -> None:
    """Raises ConfigurationError for a drive that was not computed for this rig."""
    if drive.rig != rig.name:
        raise ConfigurationError(
            f"The drive was computed from a calibration of the rig {drive.rig!r}, and this is {rig.name!r}: "
            "calibrate this rig and compute it again."
        )
    if drive.rate_hz != rig.table.rate_hz:
        raise ConfigurationError(
            f"The drive has {drive.rate_hz:g} samples/s and the rig plays {rig.table.rate_hz:g}: "
            "calibrate on this rig and compute it again."
        )


def _acceleration(rig: Rig, capture: Capture, top: float, factor: int) -> FloatArray:
    """(samples,) m/s^2 of one capture up to `top` (Hz), on the drive's clock, at its rate over `factor`."""
    laser = capture.channels.index(rig.vibrometer.channel)
    velocity = rig.vibrometer.to_velocity(capture.volts[laser])
    velocity = velocity - velocity[: max(1, round(_BEFORE * capture.rate_hz))].mean()
    edge = round(_TAIL / 4 * capture.rate_hz)
    samples = scipy.fft.next_fast_len(-(-len(velocity) // factor), real=True)
    f = scipy.fft.rfftfreq(samples * factor, 1 / capture.rate_hz)
    kept = f < top
    late = np.exp(2j * np.pi * f * capture.delays[laser]) * rig.vibrometer.response(f)
    spectrum = scipy.fft.rfft(velocity * fade(len(velocity), 0, edge), samples * factor)
    moved = np.where(kept, spectrum * 2j * np.pi * f / late, 0.0)[: samples // 2 + 1]
    return np.asarray(scipy.fft.irfft(moved, samples) / factor)


def _peak(rig: Rig, capture: Capture) -> float:
    assert rig.sensors.drive is not None
    monitor = capture.channels.index(rig.sensors.drive.channels[0])
    return float(np.abs(rig.sensors.drive.to_si(capture.volts[[monitor]])).max())
