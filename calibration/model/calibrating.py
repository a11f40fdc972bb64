"""Measure a calibration: the response, the patch's even order, what is left, and the response above."""

from __future__ import annotations

from dataclasses import replace

from ...base.progress import Progress, silent
from ...instruments import Rig
from ..response import (
    SWEEP,
    Excitation,
    Waveforms,
    beyond,
    distortion,
    measure_above,
    measure_both_signs,
    measure_response,
)
from .calibration import Calibration
from .even_order import even_order


def calibrate(
    rig: Rig,
    patch: str = "A",
    point: str = "button",
    progress: Progress = silent,
    *,
    excitation: Excitation = SWEEP,
) -> Calibration:
    """Measure the response of a patch at a point, fit a model to it, and measure the response above its band.

    Both kinds of excitation measure the patch's hysteresis as well.

    `progress` is called with the seconds measured. Raises what `measure_response` and `fit` raise.
    """
    found = Calibration.of(measure_response(rig, patch, point, progress, excitation=excitation))
    return examined(rig, found, progress)


def calibrate_keeping(
    rig: Rig,
    patch: str = "A",
    point: str = "button",
    progress: Progress = silent,
    *,
    excitation: Excitation = SWEEP,
) -> tuple[Calibration, Waveforms]:
    """`calibrate`, and the volts of every play that it was computed from, of which it can be computed again.

    Raises what `calibrate` raises.
    """
    with rig.captures() as captures:
        found = calibrate(rig, patch, point, progress, excitation=excitation)
    return found, Waveforms.of(rig, captures, found.digest, patch, point)


def examined(rig: Rig, calibration: Calibration, progress: Progress = silent) -> Calibration:
    """Add to a calibration the patch's even order, the distortion left, and the response above its band.

    To be called after its response was measured, with the laser still at the point. Raises what
    `measure_response` raises. A generator plays nothing but sweeps, which show none of that: then nothing is
    added.
    """
    if rig.feeds_amplifier("generator"):
        return calibration
    patch, point = calibration.response.patch, calibration.response.point
    both = measure_both_signs(rig, patch, point, progress)
    law = replace(calibration.hysteresis, even=even_order(calibration, both))
    above = measure_above(rig, patch, point, law, progress)
    found = replace(calibration, hysteresis=law, above=above, distortion=distortion(both, law))
    return found if above is None else replace(found, beyond=beyond(both, law, above))
