"""What an accelerometer shows at rest: gravity along its vertical axis, or nothing when AC-coupled.

Of an AC-coupled force the constant part is restored, which a charge amplifier lets fade (`Restorer`). A
high-pass of first order is undone by y = x + (w1 - w2) * I, where I is x integrated with the leak w2: the
corner moves from w1 down to w2. With w2 = 0 the sum would drift for ever with the offset of x; with w2 an
offset is enlarged by w1 / w2, slowly, as a drift of the rest, which is tracked between presses.
"""

from __future__ import annotations

import numpy as np

from ...base.arrays import FloatArray
from .sensor import LinearSensor
from .units import G

_TILT = 0.35 * G
"""The zero-g tolerance of an ADXL335 is 0.3 g on z (estimate; docs/hardware.md, "Accelerometer"), and a
little more is allowed."""


def fault_at_rest(sensor: LinearSensor, volts: FloatArray) -> str | None:
    """Describe the fault of an accelerometer that shows (channels, samples) V at rest; None without."""
    if not sensor.gravity:
        return None
    if wrong := fault_along_vertical(sensor, volts):
        return f"{wrong}."
    level = np.delete(sensor.to_si(volts).mean(axis=1), sensor.row)
    if np.abs(level).max(initial=0.0) > _TILT:
        others = " and ".join(axis for axis in sensor.axes if axis != sensor.axes[sensor.row])
        return f"{others} must show nothing: mount it level, or check its wires."
    return None


def fault_along_vertical(sensor: LinearSensor, volts: FloatArray) -> str | None:
    """Describe, as a clause, the fault of the vertical axis at rest, (channels, samples) V; None without."""
    if not sensor.gravity:
        return None
    axis = sensor.axes[sensor.row]
    if upside_down(sensor, volts):
        way = "up" if sensor.sign > 0 else "down"
        return f"it is mounted upside down, {axis} must point {way}: turn it over"
    if abs(float(sensor.along(volts).mean()) - G) > _TILT:
        return (
            f"{axis} must show {sensor.sign * G:.1f}: check how it is mounted, its supply, and sensitivity "
            "and zero in the rig file"
        )
    return None


def upside_down(sensor: LinearSensor, volts: FloatArray) -> bool:
    """True when (channels, samples) V at rest show gravity along the wrong side of the vertical axis."""
    return sensor.gravity and abs(float(sensor.along(volts).mean()) + G) < _TILT


def loss(sensor: LinearSensor, frequency_hz: float) -> str | None:
    """Describe what a sensor's response takes from a frequency (Hz); None when it is less than 3 dB."""
    gain = complex(sensor.response(np.array([frequency_hz]))[0])
    if abs(gain) >= np.sqrt(0.5):
        return None
    level, late = 20 * np.log10(max(abs(gain), 1e-6)), -np.degrees(np.angle(gain))
    what = "accelerometer" if sensor.measures == "acceleration" else f"sensor of {sensor.measures}"
    remedy = "Change its filter capacitors." if "capacitor" in sensor.stated else "Use one that is faster."
    return (
        f"The {what} passes {sensor.bandwidth_hz:.0f} Hz: of a vibration at {frequency_hz:.1f} Hz it records "
        f"{abs(gain):.0%} ({level:.1f} dB), {late:.0f} degrees late, and what is recorded is what is "
        "rendered. " + remedy
    )


_LOWEST_HZ = 0.005
"""Corner that remains: a press of half a second fades by 2 %."""
_CHUNK = 4096


class Restorer:
    """Undoes the high-pass corners of a sensor's signal, block by block; leaves a DC-coupled one as it is."""

    def __init__(self, sensor: LinearSensor, rate_hz: float) -> None:
        corners = [hz for hz in sensor.transfer.high_pass_hz if hz > _LOWEST_HZ]
        self._stages = [_Stage(hz, rate_hz) for hz in corners]

    def __call__(self, signal: FloatArray) -> FloatArray:
        """Restore the next (samples,) of the signal, which is 0 at rest."""
        for stage in self._stages:
            signal = stage(signal)
        return signal


class _Stage:
    def __init__(self, corner_hz: float, rate_hz: float) -> None:
        leak = np.pi * _LOWEST_HZ / rate_hz
        self._keep = (1 - leak) / (1 + leak)
        self._add = 0.5 / rate_hz / (1 + leak)
        self._gain = 2 * np.pi * (corner_hz - _LOWEST_HZ)
        self._held = self._last = 0.0

    def __call__(self, signal: FloatArray) -> FloatArray:
        restored = np.empty(len(signal))
        for at in range(0, len(signal), _CHUNK):
            part = signal[at : at + _CHUNK]
            pairs = part + np.concatenate([[self._last], part[:-1]])
            # The recursion held = keep * held + add * pair, solved for all samples at once.
            powers = self._keep ** np.arange(1, len(part) + 1)
            held = powers * (self._held + self._add * np.cumsum(pairs / powers))
            restored[at : at + len(part)] = part + self._gain * held
            self._held, self._last = float(held[-1]), float(part[-1])
        return restored
