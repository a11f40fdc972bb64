"""A map's plays by the generator: one linear sweep of a patch, or of all in parallel, as in the paper.

A map is fitted to spectra on the lines of a period (`PointMeasurement`), with the law of a patch. A sweep of
one level shows the patch as a gain, which is in the response that it measures; so the response, harmonics
removed, is written as if a chirp of one period had been played, at the level of the sweep, into a patch
without hysteresis. That each point is swept at its own time does not matter then.
"""

from __future__ import annotations

from datetime import UTC, datetime
from math import ceil

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray
from ...instruments import Rig
from ..response import Spot, Swept, play_sweep, refuse_silent_drive, without_harmonics
from .folder import MapPlan, PointMeasurement, Step

_RINGS, _LATER = 1.0, (2.0, 4.0)
"""Time (s) in which a surface answers a blow, and one in which there is noise alone."""
_FOLLOWS = 4.0
"""Power of the answer over that of the noise, below which a point follows no patch."""
_MORE_HZ = 10.0
"""Band (Hz) beyond the map's that is computed, for what needs neighbouring lines."""


class Sweeper:
    """Plays the steps of a plan by the generator."""

    def __init__(self, rig: Rig, plan: MapPlan) -> None:
        self._rig, self._plan = rig, plan
        self._samples = plan.parallel.samples(plan.rate_hz)
        t = np.arange(self._samples) / plan.rate_hz
        pace = (plan.high - plan.low) / plan.period
        chirp = plan.level * np.sin(2 * np.pi * (plan.low + pace * t / 2) * t)
        lines = np.arange(self._samples // 2 + 1)
        f = lines * plan.rate_hz / self._samples
        self._lines = lines[(f >= plan.low) & (f <= plan.high)]
        self._chirp = np.asarray(scipy.fft.rfft(chirp)[self._lines])

    def play(self, step: Step, light: float) -> PointMeasurement | str:
        """Play a step: its measurement, or the reason to try it again."""
        rig, plan, begun = self._rig, self._plan, datetime.now(UTC)
        before = rig.clock.now()
        responses: list[ComplexArray] = []
        rows: list[tuple[int, str]] = []
        for number, name in enumerate(step.plays):
            patches = plan.patches if name == "all" else (name,)
            spot = Spot(rig, patches[0], step.point)
            swept = play_sweep(spot, plan.sweep, plan.level, beside=patches[1:])
            if swept.problem:
                return swept.problem
            refuse_silent_drive(swept.gain, name)
            found = self._response(swept)
            if found is None:
                return f"Point {step.point} does not follow {spot}: check the laser's focus and aim."
            responses.append(found)
            rows += [(number, patch) for patch in patches]
        return PointMeasurement(
            plan=plan.digest,
            step=step.name,
            point=step.point,
            plays=step.plays,
            rows=tuple(rows),
            drives=np.array([self._chirp] * len(rows)),
            velocity=np.array(responses) * self._chirp,
            light=light,
            seconds=rig.clock.now() - before,
            created=begun.isoformat(timespec="seconds"),
        )

    def _response(self, swept: Swept) -> ComplexArray | None:
        """(lines,) m/s per V at the patch; None where the point does not follow it."""
        plan = self._plan
        periods = ceil(len(swept.volts) / self._samples) + 1
        length = periods * self._samples
        first = round(periods * self._lines[0] - _MORE_HZ * length / plan.rate_hz)
        last = round(periods * self._lines[-1] + _MORE_HZ * length / plan.rate_hz)
        f = np.arange(first, last + 1) * plan.rate_hz / length

        def spectrum(signal: FloatArray) -> ComplexArray:
            return np.asarray(scipy.fft.rfft(signal - np.median(signal), length)[first : last + 1])

        volts = spectrum(swept.volts)
        volts = volts * swept.channels.drive(volts[None], volts, f)
        H = swept.channels.velocity(spectrum(swept.velocity), f) / volts
        answer = np.abs(scipy.fft.ifft(H)) ** 2
        step = 1 / (len(H) * (f[1] - f[0]))
        rings, early, late = (round(seconds / step) for seconds in (_RINGS, *_LATER))
        if not answer[:rings].mean() > _FOLLOWS * answer[early:late].mean():
            return None
        H = without_harmonics(H, f, plan.sweep.stop_hz / plan.sweep.seconds)
        return np.asarray(H[periods * self._lines - first])
