"""Sensor health: tests of accelerometer and laser at rest, for unattended runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import welch

from haploop.calibration.drive import BAND
from haploop.instruments import Rest, Rig
from haploop.instruments.arrays import FloatArray

__all__ = ["laser_noise", "laser_or_patch", "loose_accelerometer"]

_NOISIER, _QUIETER = 4.0, 0.7
"""Noise of the laser at rest, over its usual noise, beyond which the laser is at fault: a blocked laser has
ten times; the DAQ alone, without a laser, half of a PDV-100's (measured on the simulated rig)."""
_SHAKING = 0.5
"""m/s^2 rms of an accelerometer at rest; its own noise is a fifth of this or less."""
_REST = 0.5
"""Recording time (s) of accelerometer or laser at rest."""


def loose_accelerometer(rig: Rig) -> str | None:
    """The fault of the accelerometer, as a sentence; None if it has none, or the rig has no accelerometer."""
    sensor = rig.sensors.acceleration
    if sensor is None:
        return None
    rig.operator.tell(Rest(_REST))
    volts = _captured(rig, sensor.channels, rig.file.rate_hz)
    problem = sensor.fault_at_rest(volts)
    if problem is None and float(sensor.to_si(volts).std(axis=1).max()) > _SHAKING:
        problem = "it shows vibration at rest: check its wires, and that nobody touches the rig."
    if problem is None:
        return None
    x, y, z = sensor.to_si(volts).mean(axis=1)
    rests = f"{x:.1f}, {y:.1f}, {z:.1f} m/s² along x, y, z"
    return f"The accelerometer is loose or turned: it rests at {rests}; {problem}"


def laser_noise(rig: Rig) -> float:
    """Noise of the laser at rest: m/s per sqrt(Hz), one-sided, median over the band."""
    rate_hz = rig.table.rate_hz
    volts = _captured(rig, (rig.vibrometer.channel,), rate_hz)[0]
    f, power = welch(rig.vibrometer.to_velocity(volts), rate_hz, nperseg=round(rate_hz / 10))
    inside = (f >= BAND[0]) & (f <= BAND[1])
    return float(np.sqrt(np.median(power[inside])))


def laser_or_patch(noise: float, usual: float | None) -> str:
    """Attribute a point that follows no drive to the laser or the patch, by the laser's noise at rest.

    `usual` is its noise in earlier, healthy runs; None if none is on record.
    """
    if usual is None:
        return "The laser or the patch has failed: there is no earlier noise of the laser to compare with."
    times = noise / usual
    evidence = f"at rest it shows {times:.1f} times its usual noise"
    if times > _NOISIER:
        return f"The laser does not see the surface, {evidence}: it is blocked or out of focus."
    if times < _QUIETER:
        return f"The laser is not connected, {evidence}: check its cable, and that it is on."
    return f"The laser is healthy, {evidence}, so that the patch is dead or its wires are off."


def _captured(rig: Rig, channels: Sequence[str], rate_hz: float) -> FloatArray:
    with rig.daq.stream(channels, rate_hz, round(rate_hz / 10), round(_REST * rate_hz)) as stream:
        return stream.capture().volts
