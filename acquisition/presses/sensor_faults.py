"""What is wrong with the sensors, and why a force is not at rest, seen in the samples of a press.

With hands off a DC-coupled accelerometer shows gravity: +9.8 m/s^2 along its vertical axis. -9.8 is a sensor
upside down, of which all that is recorded is the negative of the truth; another value is a tilt, a wrong
zero, or a wire that is off.
Hum stands in the rest as lines at the mains' harmonics, and so in the press: its rms over that of the press's
motion is the relative error of one press. No warp removes it, and an average only slowly, because it has
another phase in each press. A fan, a motor and a shaken table have no lines that are known: they are all that
the accelerometer shows at rest, and presses are aligned by them. A sensor of bandwidth B cannot come and go
within 1 / (4 B): what does so in one or two samples is a spike of the electronics, where samples are close
enough that a click's own ringing does not look like one. A load along z strains all gauges that have a weight
in Fz: the wire of one that does not move is off, and the force is short by its part. A strain gauge creeps: a
part of the load is still read after the finger has left, and fades.

Assumed: no motor starts between a press and its rest, z is vertical, the finger presses within the circle of
the gauges. The polarity is not told by the motion: a click may start up or down.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from ...base.arrays import FloatArray
from ...instruments.mains import mains_hum
from ...instruments.sensors import fault_along_vertical, fault_at_rest
from ...instruments.sensors import upside_down as turned_over
from ..recording import Recording
from .filtering import running_mean

_NAMES = {
    "force": "force sensor",
    "acceleration": "accelerometer",
    "velocity": "velocity sensor",
    "displacement": "displacement sensor",
}
_LOUD = 0.15
"""Hum over a press's motion (rms) from which the press is refused: with 0.25, r of a representative press was
0.96 to 0.99, and with 0.08 it was 0.993 or more (on five simulated rigs)."""
_SHAKEN, _RESTLESS = 0.3, 0.2
"""The same of whatever else is shown at rest, from which the press is refused, and told: the noise of the
simulated accelerometer is up to 0.14 of a press. With a fan of 0.6 to 1.0, r was 0.5 to 0.84."""
_SLOW = 0.05
"""s: a motion slower than this is no click, nor gravity's change as the cap tilts."""
_SPIKE, _ABOVE = 10.0, 0.5
"""Height of a spike over the noise's standard deviation, and over the motion within `_NEAR` samples."""
_NEAR = 5
_RINGS, _TIMES = 400.0, 12
"""Hz at which clicks ring at most (an estimate), and samples of its period from which spikes are looked for.
Of right presses that ring at 250 Hz, 8 samples a period behind a low-pass of 50 Hz, 4 % had a "spike"."""
_STILL, _WEIGHT = 0.01, 0.1
"""A gauge is still when its share of the force is below the first, though its weight in Fz, over the largest
one's, is above the second; of a press at the centre it has a third."""
_CREPT, _LEAVES = 0.01, 0.05
"""Part of a press's force that is left once the finger has left (s), from which the sensor creeps."""


def left_range(quantities: Sequence[str]) -> str:
    """A clause on sensors, by what they measure, that were at the end of their range."""
    names = [f"the {_NAMES[one]}" for one in quantities]
    whose = "its range" if len(names) == 1 else "their ranges"
    return f"{' and '.join(names)} left {whose}"


def upside_down(recording: Recording, rest: slice) -> bool:
    """True when the accelerometer shows gravity along -z in the samples `rest`."""
    sensor = recording.sensors.acceleration
    return sensor is not None and turned_over(sensor, recording.volts_in(sensor.channels, rest))


def axis_fault(recording: Recording, rest: slice) -> str:
    """A clause on an accelerometer that shows at rest what gravity cannot be; empty for a right one."""
    sensor = recording.sensors.acceleration
    if sensor is None:
        return ""
    volts = recording.volts_in(sensor.channels, rest)
    shown = sensor.to_si(volts).mean(axis=1)
    if wrong := fault_along_vertical(sensor, volts):
        axis = sensor.axes[sensor.row]
        return f"the accelerometer shows {shown[sensor.row]:.1f} m/s² along {axis} at rest: {wrong}"
    limits = sensor.range or (np.inf,) * len(shown)
    for axis, value, limit in zip(sensor.axes, shown, limits, strict=True):
        if axis != sensor.axes[sensor.row] and abs(value) >= limit:
            return f"the accelerometer shows {value:.1f} m/s² along {axis} at rest: check its wires"
    return ""


def signal_fault(recording: Recording, rest: slice, press: slice, still: FloatArray) -> str:
    """A clause on why a press's signals are wrong, and what to do; empty when they are right.

    `rest` and `press` are samples with hands off before the press, and those of the press; `still` is the
    vertical acceleration (samples,) of a rest of 0.4 s or more, in which hum can be told.
    """
    if source := recording.motion:
        sensor, motion = recording.sensors.linear[source], recording.vertical[press]
        called = _NAMES[source]
        hum = _hum(still, motion, recording.rate_hz)
        if hum and hum[0] > _LOUD:
            return (
                f"the {called} has {hum[1]}, {hum[0]:.0%} of the press's motion; check its ground and cable"
            )
        shaken = _shaken((still, recording.vertical[rest]), motion, recording.rate_hz)
        # What was differentiated has noise of its own, and is told only (`doubt`).
        if source == "acceleration" and shaken and shaken[0] > _SHAKEN:
            return (
                f"the {called} shows {shaken[1]}, {shaken[0]:.0%} of the press's motion; look for a fan or "
                "a motor nearby, and check its cable"
            )
        slow = source == "acceleration" and sensor.bandwidth_hz < recording.rate_hz / 4
        slow = slow and recording.rate_hz >= _RINGS * _TIMES
        if slow and (count := _spikes(still, motion)):
            return (
                f"the {called}'s signal has {count} spike{'s' * (count > 1)}; check its wires and its supply"
            )
    force = recording.sensors.force
    if force is None or len(force.channels) == 1:
        return ""
    weights = force.weights
    pressed, before = (recording.volts_in(force.channels, part).mean(axis=1) for part in (press, rest))
    shares = weights * (pressed - before)
    heavy = np.abs(weights) > _WEIGHT * np.abs(weights).max()
    deaf = heavy & (np.abs(shares) < _STILL * np.abs(shares).sum())
    if deaf.any() and not deaf[heavy].all():
        name = force.channels[int(np.argmax(deaf))]
        return f"the channel {name} does not follow the force; check its wire and the sensor's supply"
    return ""


def doubt(recording: Recording, rest: slice, press: slice, still: FloatArray) -> str:
    """A clause on what is doubtful in a press that counts: hum, noise, x and y, creep; empty without.

    The recording ends with hands off, after this press.
    """
    sensor = recording.sensors.acceleration
    doubts: list[str] = []
    if sensor and (wrong := fault_at_rest(sensor, recording.volts_in(sensor.channels, rest))):
        doubts.append(f"accelerometer: {wrong.removesuffix('.')}")
    if recording.motion:
        called, motion = _NAMES[recording.motion], recording.vertical[press]
        if hum := _hum(still, motion, recording.rate_hz):
            doubts.append(f"the {called} has {hum[1]}, {hum[0]:.0%} of the press")
        shaken = _shaken((still, recording.vertical[rest]), motion, recording.rate_hz)
        if shaken and shaken[0] > _RESTLESS:
            doubts.append(f"the {called} shows {shaken[1]}, {shaken[0]:.0%} of the press")
    force = recording.sensors.force
    if force is None or force.ac_coupled:
        return "; ".join(doubts)
    late = recording.force[press.stop :][round(_LEAVES * recording.rate_hz) :]
    if len(late) >= _LEAVES * recording.rate_hz:
        left = float(late.mean() - recording.force[rest].mean()) / float(recording.force[press].max())
        if left > _CREPT:
            doubts.append(f"the force sensor creeps: {left:.1%} of the force is left after the press")
    return "; ".join(doubts)


def _hum(still: FloatArray, motion: FloatArray, rate_hz: float) -> tuple[float, str] | None:
    """Hum in an acceleration at rest, relative to the motion of a press; and in words."""
    hum = mains_hum(still, rate_hz)
    if hum is None:
        return None
    return _over(hum.rms, motion, rate_hz), f"mains hum, {hum.rms:.2g} m/s² rms at {hum.mains_hz:g} Hz"


def _shaken(rests: Sequence[FloatArray], motion: FloatArray, rate_hz: float) -> tuple[float, str] | None:
    """As `_hum`, for all that an acceleration shows in the loudest of rests; None for rests too short."""
    edge = round(_SLOW * rate_hz)
    found = [_fast(rest, rate_hz)[edge:-edge] for rest in rests if len(rest) > 4 * edge > 0]
    if not found:
        return None
    rms = max(float(np.sqrt(np.mean(fast**2))) for fast in found)
    return _over(rms, motion, rate_hz), f"{rms:.2g} m/s² rms at rest"


def _over(rms: float, motion: FloatArray, rate_hz: float) -> float:
    """An rms (m/s^2) at rest over that of a press's own motion."""
    power = float(np.mean(_fast(motion, rate_hz) ** 2)) - rms**2
    return rms / float(np.sqrt(max(power, rms**2 / 100))) if rms else 0.0


def _fast(signal: FloatArray, rate_hz: float) -> FloatArray:
    return np.asarray(signal - running_mean(signal, max(1, round(_SLOW * rate_hz))))


def _spikes(still: FloatArray, motion: FloatArray) -> int:
    """Count what comes and goes within two samples of a press."""
    # Half of the rest's samples at most can be spikes themselves.
    noise = 1.4826 * float(np.median(np.abs(still - np.median(still))))
    smooth = scipy.ndimage.median_filter(motion, 5)
    near = 2 * _NEAR + 1
    moves = scipy.ndimage.maximum_filter1d(smooth, near) - scipy.ndimage.minimum_filter1d(smooth, near)
    return int(np.sum(np.abs(motion - smooth) > np.maximum(_SPIKE * noise, _ABOVE * moves)))


# The cause of a force that is not at rest, where it is not a hand: mains hum, or creep.

_HUM_SHARE = 0.5
"""Smallest share of a restless force's power in mains hum at which that is the cause."""
_STEADY = 0.9
"""Smallest share of the variation that a straight line explains in a sensor that drifts."""
_BLOCK = 0.025
"""Averaging time (s) that suppresses noise."""
_CREPT_OF_PEAK = 0.15
"""Largest force after a press, over its peak, that counts as creep: a sensor creeps by some percent."""
_NOISE = 0.02
"""N by which the mean of a block may rise by noise."""


def restlessness(force: FloatArray, rate_hz: float) -> str:
    """Cause of a restless force (samples,) N and its remedy, as a clause; empty when it may be a hand."""
    hum = hum_of(force, rate_hz)
    if hum:
        return hum
    means = _means(force, rate_hz)
    t = np.arange(len(means)) * _BLOCK
    if len(means) < 5 or not np.ptp(means):
        return ""
    slope, start = np.polyfit(t, means, 1)
    steady = 1 - np.var(means - start - slope * t) / np.var(means)
    if steady < _STEADY:
        return ""
    return (
        f"it drifts by {slope:+.2g} N/s, steadily, as a sensor does that warms up or creeps after a load; "
        "wait until it has settled"
    )


def hum_of(force: FloatArray, rate_hz: float) -> str:
    """A clause on mains hum that makes most of a force's (samples,) variation; empty without."""
    hum = mains_hum(force, rate_hz)
    if hum is None or hum.share < _HUM_SHARE:
        return ""
    return (
        f"the force sensor has mains hum, {hum.rms:.2g} N rms at {hum.mains_hz:g} Hz; check the grounding "
        "and the shield of its cable"
    )


def crept(force: FloatArray, peak: float, rate_hz: float) -> bool:
    """True when a force (samples,) N after a press of `peak` N fades as a sensor creeps.

    Creep is small, only falls, and falls ever more slowly; a finger that rests on the button takes its force
    away at the end.
    """
    means = _means(force, rate_hz)
    if len(means) < 4 or means.max() > _CREPT_OF_PEAK * peak:
        return False
    half = len(means) // 2
    early, late = means[0] - means[half], means[half] - means[-1]
    return bool((np.diff(means) < _NOISE).all() and early > late)


def _means(force: FloatArray, rate_hz: float) -> FloatArray:
    block = max(1, round(_BLOCK * rate_hz))
    count = len(force) // block
    return np.asarray(force[: count * block].reshape(count, block).mean(axis=1))
