"""What tells that a button is pressed: the force, else the cap's travel, else the vibration of its clicks.

Force and travel rise above their rest for as long as a press lasts. An acceleration, or a velocity
differentiated, shows clicks only: high-passed above a hand's motion, its magnitude rises at each click, and
clicks closer than `Segmentation.shaken_quiet` are one press. So without force and travel, a press begins at
its first click and ends with its last, and a finger that only touches the cap is not seen.

What breaks it: a button held for longer than `Segmentation.shaken_quiet` is two presses to a motion alone; a
latch whose cap stays down keeps its travel above its rest, and a press told by travel does not end.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import DataError
from ...base.filters import recursion
from ...base.parts import Parted, carried
from ...instruments import LinearSensor, Sensors
from ...instruments.sensors import Restorer
from ..recording import Recording
from .segmentation_settings import Segmentation

_ORDER = ("force", "displacement", "acceleration", "velocity")
NAMES = {"force": "force", "displacement": "travel", "acceleration": "acceleration", "velocity": "velocity"}
"""What each is called in sentences."""
_NOISE = 5.0
"""A click begins at this multiple of the mean magnitude at rest, at least."""
_WARM = 0.1
"""s of samples before a block in which its high-pass settles."""


@dataclass(frozen=True)
class Levels:
    """Thresholds of the quantity that tells presses, in its unit, above its rest (see `Segmentation`)."""

    pressed: float
    released: float
    least_peak: float
    onset: float
    spread: float
    """Largest peak-to-peak value at rest."""
    quiet: float
    """s."""

    def above(self, noise: float) -> Levels:
        """These levels, all of them above a noise's mean magnitude."""
        more = max(1.0, _NOISE * noise / self.pressed)
        return replace(
            self,
            pressed=more * self.pressed,
            released=more * self.released,
            least_peak=more * self.least_peak,
            onset=more * self.onset,
            spread=more * self.spread,
        )


def press_quantity(sensors: Sensors) -> str | None:
    """The quantity that tells presses: the first there is of force, displacement, acceleration, velocity."""
    return next((quantity for quantity in _ORDER if quantity in sensors.linear), None)


def levels_of(quantity: str, p: Segmentation, spread: float = 0.15) -> Levels:
    """Thresholds for a quantity; `spread` is the force's."""
    if quantity == "force":
        return Levels(p.pressed, p.released, p.least_peak, p.onset, spread, p.quiet)
    if quantity == "displacement":
        return Levels(
            p.travel_pressed, p.travel_released, p.travel_peak, p.travel_onset, p.travel_released, p.quiet
        )
    quiet = max(p.quiet, p.shaken_quiet)
    return Levels(
        p.shaken_pressed, p.shaken_released, p.shaken_peak, p.shaken_released, p.shaken_released, quiet
    )


def pressing(recording: Recording, p: Segmentation, still: slice) -> tuple[str, Parted, Levels]:
    """The quantity that tells presses, its (samples,), and the levels for it; hands are off in `still`.

    Raises DataError for a recording without such a sensor.
    """
    quantity = press_quantity(recording.sensors)
    if quantity is None:
        raise DataError(
            f"{recording.path} shows no press: it was recorded without a sensor for force, displacement, "
            "acceleration or velocity."
        )
    levels = levels_of(quantity, p)
    if quantity == "force":
        return quantity, recording.in_parts("force"), levels
    if quantity == "displacement":
        return quantity, recording.in_parts("travel"), levels
    signal = shaken(recording.in_parts("vertical"), recording.rate_hz, p.stage_high_pass)
    quiet = signal[still]
    return quantity, signal, levels.above(float(quiet.mean()) if len(quiet) else 0.0)


def shaken(vertical: Parted, rate_hz: float, high_pass_hz: float) -> Parted:
    """Magnitude (samples,) of the vertical acceleration without the hand's motion (`Shaken`)."""
    return carried(vertical, Shaken(rate_hz, high_pass_hz))


class Shaken:
    """Magnitude of the vertical acceleration without the hand's motion, part by part.

    The high-pass filter is causal, so that no click appears before its instant: a Butterworth filter of
    second order by the bilinear transform (Oppenheim and Schafer, Discrete-Time Signal Processing, 3rd ed.,
    7.2.2), settled at the first sample.
    """

    def __init__(self, rate_hz: float, high_pass_hz: float) -> None:
        k = np.tan(np.pi * min(high_pass_hz / rate_hz, 0.45))
        self._scale = 1 / (1 + np.sqrt(2) * k + k**2)
        self._last, self._before = 2 * (k**2 - 1) * self._scale, (1 - np.sqrt(2) * k + k**2) * self._scale
        self._first: FloatArray = np.zeros(0)
        self._moved: FloatArray = np.zeros(0)
        self._found: FloatArray = np.zeros(2)
        """The last two samples of the part before."""

    def __call__(self, vertical: FloatArray) -> FloatArray:
        """(samples,) of the next part."""
        if not len(vertical):
            return vertical
        if not len(self._first):
            self._first = vertical[:1].copy()
        earlier = len(self._moved)
        moved = np.concatenate([self._moved, vertical - self._first])
        forced = self._scale * np.convolve(moved, [1.0, -2.0, 1.0])[earlier : len(moved)]
        found = recursion(forced, self._last, self._before, self._found)
        self._moved, self._found = moved[-2:].copy(), np.concatenate([self._found, found[-2:]])[-2:]
        return np.asarray(np.abs(found))


class LivePressing:
    """The quantity that tells presses, block by block, from the volts of its sensor's channels."""

    def __init__(self, sensor: LinearSensor, rate_hz: float, p: Segmentation, spread: float) -> None:
        self.sensor, self.quantity = sensor, sensor.measures
        self._rate_hz, self._high_pass_hz = rate_hz, p.stage_high_pass
        self.levels = levels_of(self.quantity, p, spread)
        self.rest: FloatArray | None = None
        """(channels,) V at rest, once it is known."""
        self._restorer = Restorer(sensor, rate_hz)
        self._before: FloatArray = np.zeros(0)

    def settle(self, volts: FloatArray) -> None:
        """Take (channels, samples) V for the rest."""
        self.rest = np.asarray(volts.mean(axis=1))
        if not self.sensor.tared:
            self.levels = self.levels.above(float(self.at_rest(volts).mean()))

    def at_rest(self, volts: FloatArray) -> FloatArray:
        """(samples,) of volts that are looked at for the first time, before there is a rest."""
        signal = self.sensor.along(volts)
        return signal if self.sensor.tared else self._magnitude(signal)

    def __call__(self, volts: FloatArray) -> FloatArray:
        """(samples,) of the next (channels, samples) V."""
        if self.sensor.tared:
            return self._restorer(self.sensor.along(volts, self.rest))
        signal = np.concatenate([self._before, self.sensor.along(volts)])
        self._before = signal[-round(_WARM * self._rate_hz) :]
        return self._magnitude(signal)[len(signal) - volts.shape[1] :]

    def _magnitude(self, signal: FloatArray) -> FloatArray:
        if self.quantity == "velocity" and len(signal):
            signal = np.diff(signal, prepend=signal[0]) * self._rate_hz
        return Shaken(self._rate_hz, self._high_pass_hz)(signal)
