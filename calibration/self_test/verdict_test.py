"""Tell beforehand which error of a button the laser can decide, from its noise, and which band sensors pass.

A check passes when the upper end of its error's interval is within the tolerance. Of a drive without error,
noise alone makes that end: the root of the reach of products of its spectra, line by line (see
`drive.agreement`). It falls with the root of plays x (plays - 1), and with the size of the motion.

Assumptions: the noise is as at rest, the same in each play, and without tones, which a check takes out. What
breaks them: spikes, speckle that moves with the surface; then a check needs more plays than are said here.

What sensors pass is compared with half the sample rate, and with the band that is felt. A converter without a
filter folds what lies above half its rate back into the record (aliasing). Good sensors pass more than that,
so it is told and not refused. A pick-up of motion that passes less than the skin feels best records a dull
press, and the button made of it is dull. A force is not compared with the skin: it times presses, and its
snap is slow.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from ...base.arrays import FloatArray
from ...instruments import Rest, Rig
from .. import sizes
from ..drive import TOLERANCE, Drive, judged_to, resolved, told_by_noise
from .finding import Finding, Status

_SECONDS = 2.0
"""Length of the record at rest (s)."""
_LENGTH = 1.1
"""Length of a drive (s), of the demo's presses."""
_PLAYS = 8
_LOWEST_HZ = 20.0


def check_verdicts(rig: Rig, drives: Mapping[str, Drive]) -> Iterator[Finding]:
    """Tell which error this laser, in this range, decides in 8 and in 64 plays, also of `drives` by name."""
    rig.operator.tell(Rest(_SECONDS))
    rate_hz, channel = rig.table.rate_hz, rig.vibrometer.channel
    shown = rig.vibrometer.to_si(rig.daq.captured((channel,), rate_hz, _SECONDS).volts[0])
    f, power = _density(shown, rate_hz)
    kept = (f >= _LOWEST_HZ) & (f < judged_to(rig, rate_hz))
    f, power = f[kept], power[kept] * np.abs(2 * np.pi * f[kept] / rig.motion_response(f[kept])) ** 2

    def told(size: float, plays: int, seconds: float, edge: float) -> float:
        """Error at the upper end of the interval for a target of `size` (m/s^2 rms), up to `edge` (Hz)."""
        squares = float(np.sum(power[f < edge] ** 2)) * (f[1] - f[0]) / seconds
        return float(np.sqrt(told_by_noise(squares, plays))) / size

    most = sizes.MORE_PLAYS * _PLAYS
    top = judged_to(rig, rate_hz)
    few, many = (told(1.0, plays, _LENGTH, top) for plays in (_PLAYS, most))
    yield Finding(
        "Verdicts",
        "vibrometer",
        "green",
        f"Up to {top:.0f} Hz, {_PLAYS} plays tell {TOLERANCE:.0%} of error of a target of "
        f"{few / TOLERANCE:.2g} m/s² rms or more, {most} plays of one of {many / TOLERANCE:.2g} or more: "
        "half of that error takes twice that motion.",
    )
    for name, drive in drives.items():
        size, seconds = float(np.sqrt(np.mean(drive.target**2))), len(drive.target) / drive.rate_hz
        edge = resolved(drive, top, partial(told, size, most, seconds))
        few, many = (told(size, plays, seconds, edge) for plays in (_PLAYS, most))
        decides = (
            f"Up to {edge:.0f} Hz, of its {size:.2g} m/s² rms, {_PLAYS} plays tell {few:.1%} of error, "
            f"{most} plays {many:.1%}"
        )
        if many > TOLERANCE:
            decides += (
                f", and {TOLERANCE:.0%} is to be told: choose a smaller range or filter of the vibrometer, "
                "or make the button louder"
            )
        status: Status = "red" if many > TOLERANCE else "green"
        yield Finding(f"Verdict on {name}", "vibrometer", status, f"{decides}.")


def _density(signal: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Lines (Hz), and the one-sided power spectral density: the mean of Hann windows of 0.1 s that overlap.

    scipy.signal has it (`welch`), and would load scipy.stats, half a second in a command of three.
    """
    size = round(rate_hz / 10)
    window = np.hanning(size + 1)[:-1]
    parts = np.lib.stride_tricks.sliding_window_view(signal, size)[:: size // 2]
    parts = (parts - parts.mean(axis=1, keepdims=True)) * window
    power = np.mean(np.abs(np.fft.rfft(parts)) ** 2, axis=0) / (rate_hz * np.sum(window**2))
    power[1 : (size + 1) // 2] *= 2
    return np.asarray(np.fft.rfftfreq(size, 1 / rate_hz), np.float64), np.asarray(power, np.float64)


_FELT_HZ = 250.0
"""Where the skin of a finger is most sensitive to displacement (Pacinian corpuscles; a textbook's figure)."""


def check_bands(rig: Rig) -> Iterator[Finding]:
    """Tell which pick-ups pass more than half the rate into a card without a filter, or less than is felt."""
    rate_hz = rig.file.rate_hz
    for name, sensor in rig.sensors.linear.items():
        yield from _folded(rig, (name, sensor.channels), (sensor.bandwidth_hz, rate_hz, "rate_hz"))
        if name != "force" and sensor.bandwidth_hz < _FELT_HZ:
            yield Finding(
                f"Bandwidth of {name}",
                name,
                "green",  # as the rig file says, and the paper's own
                f"It passes {sensor.bandwidth_hz:.0f} Hz, and the skin is most sensitive near "
                f"{_FELT_HZ:.0f} Hz: a recorded press, and the button made of it, is dull. Use a smaller "
                "filter capacitor, or a sensor of 500 Hz or more.",
            )
    if rig.file.vibrometer is not None and rig.file.table is not None:
        own = rig.vibrometer
        passes = (own.bandwidth_hz, rig.file.table.rate_hz, "rate_hz in [table]")
        yield from _folded(rig, ("vibrometer", (own.channel,)), passes)


def _folded(rig: Rig, of: tuple[str, Sequence[str]], passes: tuple[float, float, str]) -> Iterator[Finding]:
    (name, channels), (bandwidth_hz, rate_hz, key) = of, passes
    unfiltered = [channel for channel in channels if not rig.daq.filtered(channel)]
    if not unfiltered or not rate_hz / 2 < bandwidth_hz < math.inf:
        return
    yield Finding(
        f"Bandwidth of {name}",
        name,
        "yellow",
        f"It passes {bandwidth_hz:.0f} Hz, and {rate_hz / 2:.0f} Hz, half the sample rate, is recorded: what "
        "lies between folds back into the record, unless a filter stands before the card. Write "
        f"{key} = {2 * bandwidth_hz:.0f} or more, or put a low-pass filter there and state low_pass_hz.",
    )
