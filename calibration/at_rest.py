"""What sensors show while nothing moves, when something is wrong and nobody is there to look."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import welch

from calibration.drive import BAND
from instruments import Rest, Rig
from instruments.arrays import FloatArray

__all__ = ["laser_noise", "laser_or_patch", "loose_accelerometer"]

_NOISIER, _QUIETER = 4.0, 0.7
"""Noise of the laser at rest, over its usual noise, beyond which it is the laser that fails: a blocked one
has ten times; a DAQ's own, without a laser, is half of a PDV-100's (measured on the simulated rig)."""
_SHAKING = 0.5
"""m/s^2 rms of an accelerometer at rest; its own noise is a fifth of this or less."""
_REST = 0.5
"""Seconds in which an accelerometer, or the laser, is looked at while nothing moves."""


def loose_accelerometer(rig: Rig) -> str | None:
    """What speaks against the accelerometer; None if nothing, or for a rig that has none."""
    sensor = rig.sensors.acceleration
    if sensor is None:
        return None
    rig.operator.tell(Rest(_REST))
    volts = _captured(rig, sensor.channels, rig.file.rate_hz)
    what = sensor.fault_at_rest(volts)
    if what is None and float(sensor.to_si(volts).std(axis=1).max()) > _SHAKING:
        what = "it shakes while nothing moves: check its wires, and that nobody touches the rig."
    if what is None:
        return None
    x, y, z = sensor.to_si(volts).mean(axis=1)
    rests = f"{x:.1f}, {y:.1f}, {z:.1f} m/s² along x, y, z"
    return f"The accelerometer is loose or turned: it rests at {rests}; {what}"


def laser_noise(rig: Rig) -> float:
    """What the laser shows while nothing is played: m/s per sqrt(Hz), one-sided, median over the band."""
    rate_hz = rig.table.rate_hz
    volts = _captured(rig, (rig.vibrometer.channel,), rate_hz)[0]
    f, power = welch(rig.vibrometer.to_velocity(volts), rate_hz, nperseg=round(rate_hz / 10))
    inside = (f >= BAND[0]) & (f <= BAND[1])
    return float(np.sqrt(np.median(power[inside])))


def laser_or_patch(noise: float, usual: float | None) -> str:
    """Of a point that follows no drive: is it the laser or the patch? By the laser's noise at rest.

    `usual` is what it was when all was well; None if that is not known.
    """
    if usual is None:
        return "Whether it is the laser or the patch is not known: the laser's usual noise was never noted."
    times = noise / usual
    told = f"with nothing played it shows {times:.1f} times its usual noise"
    if times > _NOISIER:
        return f"The laser does not see the surface, {told}: it is blocked or out of focus."
    if times < _QUIETER:
        return f"The laser is not connected, {told}: check its cable, and that it is on."
    return f"The laser sees, {told}, so that the patch is dead or its wires are off."


def _captured(rig: Rig, channels: Sequence[str], rate_hz: float) -> FloatArray:
    with rig.daq.stream(channels, rate_hz, round(rate_hz / 10), round(_REST * rate_hz)) as stream:
        return stream.capture().volts
