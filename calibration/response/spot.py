"""A patch of a rig and the point at which the laser sees what it does; and what captures of both say.

`Channels` correct two sampled channels to the volts at the patch and the velocity of the surface.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import InstrumentError
from ...instruments.vibrometer import shown
from .response import LINEAR, Response

if TYPE_CHECKING:
    from ...instruments import Capture, Rig
    from .response import FrfEstimate


_FITS = 0.005
"""Relative rms misfit up to which the path from command to monitor counts as a hold and one pole."""
_CORNERS = (300.0, 3e5)
"""Search range of the amplifier's corner (Hz)."""


@dataclass(frozen=True, eq=False)
class Channels:
    """Sampling delays (s) of drive monitor and laser after the clock's edge, and the laser's response.

    `laser` returns the response (lines,) from the surface's velocity to what the vibrometer shows, at
    frequencies (Hz), delay included.
    """

    rate_hz: float
    drive_delay: float
    laser_delay: float
    laser: Callable[[FloatArray], ComplexArray]
    staircase: bool = True
    """False where the drive is no output of the converter, whose samples are steps: a generator's."""

    def drive(self, sampled: ComplexArray, commanded: ComplexArray, f: FloatArray) -> ComplexArray:
        """Factors (lines,) from the monitor's samples to the volts at the patch at the clock's edges.

        A drive is a staircase, smoothed by the amplifier only. Its images around the sample rate alias
        into the monitor, which has no anti-alias filter, but not into the surface, which does not
        move at 50 kHz. With a 5 kHz amplifier that is an error of 4 mrad at 600 Hz, as much as all others
        together. Where the path from command to monitor is that of a zero-order hold and one pole, the
        images are corrected; otherwise only the delay is.
        `sampled` (plays, lines) and `commanded` (lines,) are spectra at `f` (lines,) Hz: of the
        monitor's volts and of the commanded samples.
        """
        late = np.exp(-2j * np.pi * f * self.drive_delay)
        if not self.staircase:
            return np.asarray(late)
        strong = np.abs(commanded) > 0.1 * np.abs(commanded).max()
        path = sampled.mean(axis=0)[strong] / commanded[strong]

        def misfit(log_corner: float) -> float:
            shape = self._sampled(f[strong], float(np.exp(log_corner)))
            gain = np.vdot(shape, path).real / np.vdot(shape, shape).real
            return float(np.linalg.norm(path - gain * shape))

        low, high = np.log(_CORNERS)
        found = scipy.optimize.minimize_scalar(
            misfit, bounds=(low, high), method="bounded", options={"xatol": 1e-4}
        )
        if found.fun <= _FITS * np.linalg.norm(path):
            corner = float(np.exp(found.x))
            stairs = np.sinc(f / self.rate_hz) * np.exp(-1j * np.pi * f / self.rate_hz)
            late = stairs / (1 + 1j * f / corner) / self._sampled(f, corner)
        return np.asarray(late)

    def velocity(self, sampled: ComplexArray, f: FloatArray) -> ComplexArray:
        """Spectrum of the surface's velocity at the clock's edges; arrays (..., lines), `f` (lines,) Hz."""
        return np.asarray(sampled * np.exp(-2j * np.pi * f * self.laser_delay) / self.laser(f))

    def _sampled(self, f: FloatArray, corner: float) -> ComplexArray:
        """Response of one pole (Hz) to a staircase, sampled `drive_delay` after each step begins."""
        decay = np.exp(-2 * np.pi * corner / self.rate_hz)
        since = np.exp(-2 * np.pi * corner * self.drive_delay)
        back = np.exp(-2j * np.pi * f / self.rate_hz)
        return np.asarray((1 - since) + since * (1 - decay) * back / (1 - decay * back))


@dataclass(frozen=True, eq=False)
class Spot:
    """A patch of a rig, and the point at which the laser sees what it does."""

    rig: Rig
    patch: str
    point: str

    def __str__(self) -> str:
        return f"patch {self.patch} at the {self.point} point"


def overloaded(rig: Rig, capture: Capture) -> str | None:
    """Sentence on a signal out of range in a capture of drive monitor and laser, with a remedy; or None."""
    laser = capture.channels.index(rig.vibrometer.channel)
    fastest = float(np.abs(rig.vibrometer.to_si(capture.volts[laser])).max())
    if capture.overload[laser] or fastest > rig.vibrometer.range:
        return (
            f"The laser left its range of {shown(rig.vibrometer.quantity, rig.vibrometer.range)}: "
            "choose a larger range, or a lower level."
        )
    if capture.overload.any():
        name = capture.channels[int(np.flatnonzero(capture.overload)[0])]
        return f"The channel {name!r} left its input range: widen the range in the rig file."
    return None


def refuse_overload(rig: Rig, capture: Capture) -> None:
    """Raise InstrumentError for what `overloaded` says."""
    problem = overloaded(rig, capture)
    if problem:
        raise InstrumentError(problem)


def response_of(spot: Spot, found: FrfEstimate, excitation: str, repeats: int, peak: float) -> Response:
    """The response to an excitation of `peak` volts as commanded, of a patch without hysteresis."""
    rig = spot.rig
    return Response(
        patch=spot.patch,
        point=spot.point,
        frequencies=found.frequencies,
        velocity=found.velocity,
        deviation=found.deviation,
        scatter=found.scatter,
        coherence=found.coherence,
        path=found.path,
        noise=found.noise,
        distortion=found.distortion,
        repeats=repeats,
        level=float(np.median(np.abs(found.path))) * peak,
        levels=np.zeros(0),
        level_gain=found.level_gain,
        pickup_range=rig.vibrometer.range,
        pickup=rig.vibrometer.quantity,
        excitation=excitation,
        source="measured",
        rig=rig.name,
        rig_file=rig.file.model_dump_json(),
        simulated=rig.simulated,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        hysteresis=LINEAR,
    )


def signals_of(
    rig: Rig, capture: Capture, patch: str, *, staircase: bool = True
) -> tuple[FloatArray, FloatArray, Channels]:
    """(samples,) V at a patch, (samples,) SI of the laser's output, and how they were sampled.

    `staircase` tells that the drive is a converter's output (see `Channels`).
    """
    drive = capture.channels.index(rig.monitor(patch))
    laser = capture.channels.index(rig.vibrometer.channel)
    divider = rig.sensors.drive
    assert divider is not None

    def laser_response(f: FloatArray) -> ComplexArray:
        # What the monitor's channel loses of the drive counts as if the laser showed more.
        return np.asarray(rig.motion_response(f) / rig.monitor_response(patch, f))

    channels = Channels(
        capture.rate_hz, float(capture.delays[drive]), float(capture.delays[laser]), laser_response, staircase
    )
    volts = divider.to_si(capture.volts[[drive]])[0]
    return volts, rig.vibrometer.to_si(capture.volts[laser]), channels
