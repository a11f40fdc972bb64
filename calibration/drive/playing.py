"""Playing a drive and measuring the motion of the surface, up to the corner of the laser's filter.

What the laser still shows above its corner, up to the card's Nyquist frequency and folded down from beyond
it, is kept as well: its size is not known, because a filter is not, but that something moves there is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import ConfigurationError
from ...base.filters import fast_length
from ...base.progress import Progress, silent
from ...instruments import Capture, Rig
from ...instruments.vibrometer import DERIVATIVE
from ..background import Record, heard, rests, tones_in, tones_of
from ..response import overloaded, settle
from ..spectra import fade, resample
from .drive import Drive

_TAIL = 0.1
"""Recording time (s) after the drive, so that the vibrometer's delay truncates nothing."""
_RESOLVED = 0.25
"""Highest frequency that is judged, over the sample rate: a card without a filter folds what is above half of
that rate down, and up to here at least the laser's filter has weakened it."""
_SHOWN = 0.48
"""Highest frequency at which something is looked for, over the sample rate."""
_PASSED = 0.05
"""Share of a motion that laser and card pass at least where something is looked for."""
_EDGE = 0.03
"""Time (s) at a rest's beginning in which the record is faded in."""


@dataclass(frozen=True, eq=False)
class Played:
    """Measurements of several plays of one drive: `accelerations` is (plays, samples) m/s^2.

    The first sample is the drive's. All motion up to `judged_hz` is in it; nothing is filtered out below
    that.
    """

    accelerations: FloatArray
    rate_hz: float
    judged_hz: float
    peaks: tuple[float, ...]
    """Largest voltage (V) at each patch of the drive."""
    overload: str | None
    """Sentence about the signal that left its range, if any."""
    monitor_noise: float = 0.0
    """Standard deviation (V) at rest of the monitor of the patch that has most."""
    tones_hz: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(tones,) Hz: steady tones of the background that were taken out of every play."""
    tones_rms: float = 0.0
    """Rms (m/s^2) of what was taken out, in the mean play."""
    above_hz: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(lines,) frequencies above `judged_hz`."""
    above: ComplexArray = field(default_factory=lambda: np.zeros((0, 0), dtype=np.complex128))
    """(plays, lines) m/s^2 of what is shown there, by the filter that the laser declares; the sum of the
    squared magnitudes is the mean square."""

    @property
    def peak(self) -> float:
        """Largest voltage at any patch (V)."""
        return max(self.peaks)


def judged_to(rig: Rig, rate_hz: float) -> float:
    """Highest frequency (Hz) at which motion is judged, in plays of so many samples/s."""
    return min(rig.vibrometer.bandwidth_hz, _RESOLVED * rate_hz)


def play(rig: Rig, drive: Drive, plays: int, tail: float = 0.0, progress: Progress = silent) -> Played:
    """Settle the table, play a drive, and measure the surface on the drive's clock, for `tail` s longer."""
    return play_by_turns(rig, [drive], plays, tail, progress)[0]


def play_by_turns(
    rig: Rig, drives: Sequence[Drive], plays: int, tail: float = 0.0, progress: Progress = silent
) -> list[Played]:
    """Settle the table, and play drives of the same patches and length, each `plays` times, in turn.

    A drift of the table then affects all alike, and each drive has the same predecessor every time.
    """
    one = drives[0]
    settle(rig, one.patches)
    channels = (*dict.fromkeys(map(rig.monitor, one.patches)), rig.vibrometer.channel)
    top = judged_to(rig, one.rate_hz)
    factor, edge = int(one.rate_hz // (2 * top)), round(_EDGE * one.rate_hz)
    leads = rests(plays * len(drives), one.rate_hz, factor, (rig.name, one.button, one.point, *one.patches))
    records, above, peaks, calm, problems = [], [], [], [], []
    for number, lead in enumerate(leads):
        # Zero volts first: a rest of a length that no tone of the background is in step with.
        volts = {p: np.pad(own, (lead, 0)) for p, own in drives[number % len(drives)].by_patch.items()}
        capture = rig.excite_each(volts, channels, tail + _TAIL)
        acceleration, shown = _acceleration(rig, capture, top, factor, lead)
        above.append(shown[lead : lead + len(one.target)])
        records.append(Record(acceleration, (slice(edge // factor, lead // factor),)))
        monitored = _monitored(rig, capture, one.patches)
        peaks.append(np.abs(monitored).max(axis=1))
        calm.append(monitored[:, edge:lead].std(axis=1).max())
        problems.append(overloaded(rig, capture))
        progress("Play", number + 1, len(leads), "plays")
    rate_hz = one.rate_hz / factor
    samples = -(-(len(one.target) + round(tail * one.rate_hz)) // factor)
    tones = tones_in(records, rate_hz)
    above_hz, shares = _above(np.array(above), one.rate_hz, top)
    found = []
    for turn in range(len(drives)):
        own = slice(turn, None, len(drives))
        accelerations, kept, rms = _calmed(records[own], samples, tones, rate_hz)
        overload = next((p for p in problems[own] if p), None)
        found.append(
            Played(
                accelerations=accelerations,
                rate_hz=rate_hz,
                judged_hz=top,
                peaks=tuple(np.max(peaks[own], axis=0).tolist()),
                overload=overload,
                monitor_noise=float(np.median(calm[own])),
                tones_hz=kept,
                tones_rms=rms,
                above_hz=above_hz,
                above=shares[own],
            )
        )
    return found


def _calmed(
    records: Sequence[Record], samples: int, tones: FloatArray, rate_hz: float
) -> tuple[FloatArray, FloatArray, float]:
    """(plays, samples) without the background's tones, the tones taken out (Hz), and their rms.

    A tone is taken out if the plays then differ less from each other: one that is not steady would be added.
    """
    starts = [record.rests[0].stop for record in records]
    accelerations = np.array(
        [one.signal[start : start + samples] for one, start in zip(records, starts, strict=True)]
    )
    if not len(tones):
        return accelerations, tones, 0.0
    parts = np.array(
        [
            heard(tones_of(one, tones, rate_hz), tones, (start + np.arange(samples)) / rate_hz)
            for one, start in zip(records, starts, strict=True)
        ]
    )
    moved, apart = parts - parts.mean(axis=0), accelerations - accelerations.mean(axis=0)
    lessens = 2 * np.einsum("ptn,pn->t", moved, apart) > np.einsum("ptn,ptn->t", moved, moved)
    taken = parts[:, lessens].sum(axis=1)
    rms = float(np.sqrt(np.mean(taken**2))) if lessens.any() else 0.0
    return accelerations - taken, tones[lessens], rms


def targets_of(drive: Drive, rate_hz: float) -> FloatArray:
    """(points, samples) m/s^2: a drive's target at each of its points, at the sample rate of its plays."""
    factor = round(drive.rate_hz / rate_hz)
    samples = -(-len(drive.target) // factor)
    added = samples * factor - len(drive.target)
    targets = np.array([drive.target, *(one.target for one in drive.elsewhere)])
    return resample(np.pad(targets, ((0, 0), (0, added))), samples)


def refuse_foreign(rig: Rig, drive: Drive) -> None:
    """Raises ConfigurationError for a drive that was not computed for this rig and its amplifier."""
    if drive.rig != rig.name:
        raise ConfigurationError(
            f"The drive was computed from a calibration of the rig {drive.rig!r}, and this is {rig.name!r}: "
            "calibrate this rig and compute it again."
        )
    alone = [patch for patch in drive.patches if patch not in rig.amplifier.inputs]
    if alone and len(drive.patches) > 1:
        raise ConfigurationError(
            f"The drive is for patches {drive.patch} at once, and the amplifier of the rig {rig.name!r} has "
            f"no channel of its own for patch {alone[0]}: make the button for one patch, or give 'input' in "
            "[amplifier] a name for each patch."
        )
    if drive.rate_hz != rig.table.rate_hz:
        raise ConfigurationError(
            f"The drive has {drive.rate_hz:g} samples/s and the rig plays {rig.table.rate_hz:g}: "
            "calibrate on this rig and compute it again."
        )


def joined(first: Played, more: Played) -> Played:
    """The plays of one drive at one point, from two series."""
    return replace(
        first,
        accelerations=np.concatenate([first.accelerations, more.accelerations]),
        peaks=tuple(np.maximum(first.peaks, more.peaks).tolist()),
        overload=first.overload or more.overload,
        monitor_noise=max(first.monitor_noise, more.monitor_noise),
        tones_hz=max((first.tones_hz, more.tones_hz), key=len),
        tones_rms=max(first.tones_rms, more.tones_rms),
        above=np.concatenate([first.above, more.above]),
    )


def _acceleration(
    rig: Rig, capture: Capture, top: float, factor: int, rest: int
) -> tuple[FloatArray, FloatArray]:
    """(samples,) m/s^2 of one capture up to `top` (Hz), on the drive's clock, at its rate over `factor`.

    It begins with `rest` samples without a drive, from which the laser's offset is taken. Also (samples,)
    what is shown above `top`, at the capture's rate.
    """
    laser = capture.channels.index(rig.vibrometer.channel)
    velocity = rig.vibrometer.to_si(capture.volts[laser])
    velocity = velocity - velocity[:rest].mean()
    edge = round(_EDGE * capture.rate_hz)
    samples = fast_length(-(-len(velocity) // factor))
    f = np.asarray(np.fft.rfftfreq(samples * factor, 1 / capture.rate_hz), dtype=np.float64)
    late = np.exp(2j * np.pi * f * capture.delays[laser]) * rig.motion_response(f)
    spectrum = np.fft.rfft(velocity * fade(len(velocity), edge, edge), samples * factor)
    moved = spectrum * 2j * np.pi * f / late
    below = np.where(f < top, moved, 0.0)[: samples // 2 + 1]
    passed = np.abs(late) > _PASSED * (2 * np.pi * np.maximum(f, 1.0)) ** DERIVATIVE[rig.vibrometer.quantity]
    above = np.where((f >= top) & (f < _SHOWN * capture.rate_hz) & passed, moved, 0.0)
    return np.asarray(np.fft.irfft(below, samples) / factor), np.asarray(np.fft.irfft(above))


def _above(signals: FloatArray, rate_hz: float, top: float) -> tuple[FloatArray, ComplexArray]:
    """Frequencies (lines,) Hz above `top`, and (plays, lines) of signals (plays, samples): see `Played`."""
    f = np.asarray(np.fft.rfftfreq(signals.shape[1], 1 / rate_hz), dtype=np.float64)
    kept = (f >= top) & (f < _SHOWN * rate_hz)
    return f[kept], np.fft.rfft(signals)[:, kept] * (np.sqrt(2) / signals.shape[1])


def _monitored(rig: Rig, capture: Capture, patches: Sequence[str]) -> FloatArray:
    """(patches, samples) V at the patches, as their monitors show them."""
    assert rig.sensors.drive is not None
    monitors = [capture.channels.index(rig.monitor(patch)) for patch in patches]
    return np.asarray(rig.sensors.drive.to_si(capture.volts[monitors]))
