"""Calibrations of a grid point from a map, for points at which no patch was calibrated.

A map has the response of each patch at each point as a sum over the table's modes, per linear volt of the law
of hysteresis that it was fitted with. What is missing for a drive, the patch's own law, its path from the
converter and the frequencies of the modes as they are now, is known from calibrations elsewhere: the response
is brought to their level, and each of the map's modes is moved to where they have it. The residues stay, as
in `calibration.model.drift`.

Assumptions: a patch has one law wherever the laser looks; since the map only frequencies and dampings have
changed. What breaks them: a table that was remounted, a patch that came loose, a finger on the table during
the map; then its modes are not found again, or the response is wrong by more than is stated, which the check
sees at the point.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from ...base.arrays import ComplexArray, FloatArray, IntArray
from ...base.errors import ConfigurationError
from ..model import Calibration, fit
from ..response import Modes
from .map import VibrationMap

_FAR = 0.02
"""Relative change of the table's frequencies since a map from which it is not used."""
_LEAST_FOUND = 0.7
"""Share of the calibrations' resonances that a map of the same table has, at least."""
_APART = 1.5
"""Distance of poles, over the sum of their half-widths, from which each has a resonance of its own."""
_DAMPED = 0.3
"""Damping ratio beyond which a pole makes no peak."""
_CHANGED = 0.02
"""Error of a response over what moving its modes changed (measured on simulated tables)."""
_LAW = 2e-3
"""Relative error of a map's gains from the law of hysteresis (see `HALF_WIDTHS`)."""


def with_map(
    calibrations: Sequence[Calibration], vibration_map: VibrationMap, points: Collection[str]
) -> tuple[Calibration, ...]:
    """Add, for each of `points` without a calibration, one of every patch, taken from a map.

    The calibrations are of all patches at another point. Raises ConfigurationError for a map of another rig,
    of another table than the calibrated one, or without a point or patch that is needed.
    """
    there = {c.response.point for c in calibrations}
    needed = [point for point in points if point not in there]
    by_patch: dict[str, Calibration] = {}
    for calibration in calibrations:
        by_patch.setdefault(calibration.response.patch, calibration)
    plan = vibration_map.plan
    for calibration in calibrations:
        if (calibration.response.rig, calibration.response.simulated) != (plan.rig, plan.simulated):
            raise ConfigurationError(
                f"The map is of the rig {plan.rig!r}{', simulated' if plan.simulated else ''}, and the "
                f"calibration of {calibration.response.rig!r}: measure a map of this rig."
            )
    for kind, names, known in (("point", needed, vibration_map.points), ("patch", by_patch, plan.patches)):
        if missing := [name for name in names if name not in known]:
            raise ConfigurationError(
                f"The map has no {kind} {missing[0]}: measure it (haploop map), or calibrate there."
            )
    if not needed:
        return tuple(calibrations)
    moved = _moved(vibration_map.modes, list(by_patch.values()))
    with threadpool_limits(1):
        found = [_taken(vibration_map, moved, own, point) for point in needed for own in by_patch.values()]
    return (*calibrations, *found)


def _taken(found: VibrationMap, moved: Modes, own: Calibration, point: str) -> Calibration:
    """A patch at a point of a map, with the modes where they are now, at the level of its own calibration."""
    plan, response, law = found.plan, own.response, own.hysteresis
    row = found.points.index(point)
    samples = plan.parallel.samples(plan.rate_hz)
    f = np.arange(samples // 2 + 1) * plan.rate_hz / samples
    f = f[(f >= plan.low) & (f <= plan.high)]
    brought = law.gain(response.level) / law.gain(plan.level)
    then, now = (
        brought * replace(found, modes=modes).velocity(response.patch, f)[row]
        for modes in (found.modes, moved)
    )
    made = replace(
        response,
        point=point,
        frequencies=f,
        velocity=now,
        deviation=np.hypot(_deviation(found, now, row), _CHANGED * np.abs(now - then)),
        scatter=np.zeros(len(f)),
        coherence=np.zeros(0),
        noise=np.zeros(0),
        distortion=np.zeros((0, 0)),
        path=np.interp(f, response.frequencies, response.path),
        excitation=f"Vibration map of {len(found.points)} points, {plan.period:g} s each.",
        source=f"map, SHA-256 {found.content[:16]}",
        created=found.created,
    )
    return replace(own, response=made, model=fit(made), above=None)


def _deviation(found: VibrationMap, velocity: ComplexArray, row: int) -> FloatArray:
    """(lines,) m/s per V: what the fit of the modes averages of the residual, and the error of the law.

    The residual is that of single lines, over the response's rms.
    """
    unknowns = 2 * len(found.modes.poles) + 2
    share = np.sqrt(len(found.plan.patches) * unknowns / (2 * len(velocity)))
    noise = found.residual[row] * min(1.0, float(share)) * np.sqrt(np.mean(np.abs(velocity) ** 2))
    return np.asarray(np.hypot(noise, _LAW * np.abs(velocity)))


def _moved(modes: Modes, calibrations: Sequence[Calibration]) -> Modes:
    """The modes of a map where calibrations have them now.

    A mode apart from the others is where the median of the calibrations has it. Poles that overlap describe
    one response together, in parts that cancel: they keep their distances, and change as the whole table
    does. What is no resonance of any calibration stays where it is: it stands for what is far away.
    """
    current = np.concatenate([c.model.poles[c.model.resonant] for c in calibrations])
    factor = 1.0
    for _ in range(2):
        # Once more after the common drift is taken out: then the nearest is the right one.
        nearest = _nearest(modes.poles * factor, current)
        factor = float(np.median(np.abs(current) / np.abs(modes.poles[nearest])))
    poles = modes.poles * factor
    found = np.abs(current - poles[nearest]) < -(current.real + poles[nearest].real)
    if abs(factor - 1) > _FAR or found.mean() < _LEAST_FOUND:
        raise ConfigurationError(
            f"The map does not fit the calibrations: {found.mean():.0%} of their resonances are among the "
            f"map's, at {factor - 1:+z.1%} in frequency. Measure a new map."
        )
    alike = np.abs(poles[:, None] - poles) < -_APART * (poles[:, None].real + poles.real)
    peaks = -poles.real < _DAMPED * np.abs(poles)
    alike &= peaks[:, None] & peaks
    now = modes.poles.copy()
    for k, group in enumerate(alike):
        own = current[found & (nearest == k)]
        if len(own) and group.sum() == 1:
            now[k] = complex(np.median(own.real), np.median(own.imag))
        elif (found & group[nearest]).any():
            now[k] = poles[k]
    return Modes(now, modes.weights)


def _nearest(poles: ComplexArray, current: ComplexArray) -> IntArray:
    """Index of the pole nearest to each of `current`, by the logarithm of the frequency."""
    return np.asarray(np.argmin(np.abs(np.log(np.abs(current[:, None]) / np.abs(poles))), axis=1))
