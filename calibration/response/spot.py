"""A patch of a rig and the point at which the laser sees what it does; and what captures of both say."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import InstrumentError
from ...instruments import Capture, Rig
from ...instruments.vibrometer import shown
from .channels import Channels
from .response import LINEAR, Response

if TYPE_CHECKING:
    from .estimate import FrfEstimate


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
        capture.rate_hz,
        float(capture.delays[drive]),
        float(capture.delays[laser]),
        laser_response,
        staircase,
    )
    volts = divider.to_si(capture.volts[[drive]])[0]
    return volts, rig.vibrometer.to_si(capture.volts[laser]), channels
