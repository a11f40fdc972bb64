"""Plans of drives: from actuation and targets to an inversion problem, and its solution for a trade."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, Protocol

import numpy as np
import scipy

from ...instruments import Limits
from ...instruments.arrays import ComplexArray, FloatArray
from ..model import Drift
from .actuation import Actuation
from .inversion import Plan, State, max_output, min_peak, within
from .trade import STEADY, Trade

Inversion = Literal["optimised", "regularised"]
_SPREAD = 0.6
"""Error of a drive over that which distortion would make if it were spread evenly over the band: part of it
stays near the drive's own lines, where the table moves little (measured on simulated tables)."""
_FALLS = 0.5
"""Distortion above the band that a calibration plays, over that within it. Simulated, up to 5 kHz: a quarter
of a multisine's; of drives a third to two fifths on seven tables, and all of it on a beam."""
_SETTLING = 3
"""Runs of the splitting for one limit, each from where the last one ended."""


class PlanGrid(Protocol):
    """The periodic grid of a plan."""

    @property
    def window(self) -> FloatArray:
        """See `Plan.window`."""

    @property
    def rate_hz(self) -> float:
        """Sample rate."""


def plan_for(
    table: Actuation,
    targets: FloatArray,
    grid: PlanGrid,
    band: tuple[float, float],
    limits: Limits,
    drift: Drift = STEADY,
) -> Plan:
    """The plan, in linear volts, for targets ((points, grid) m/s^2) within `band` (Hz).

    Motion that is not wanted counts wherever the response was measured, also outside the band.
    """
    f = scipy.fft.rfftfreq(targets.shape[1], 1 / grid.rate_hz)
    low, high = table.known
    known = (f >= low) & (f <= high)
    gain = np.where(known, table.gain(np.clip(f, low, high)), 0.0)
    power = (np.abs(gain[0]) ** 2).mean(axis=0)
    reach = table.reach(limits)
    # Above the grid there is no drive, and still a distortion.
    wide = np.arange(low, high, f[1])
    return Plan(
        target=scipy.fft.rfft(targets),
        gain=gain,
        known=known,
        covariance=table.covariance(f),
        window=grid.window,
        typical=float(np.median(power[(f >= band[0]) & (f <= band[1])])),
        reach=reach / reach.max(),
        drift=table.drifted(f, drift) if drift != STEADY else 0.0,
        slew=slew_of(limits, grid.rate_hz),
        spread=_moved_by_distortion(table, wide),
    )


def _moved_by_distortion(table: Actuation, f: FloatArray) -> FloatArray:
    """(points, patches): power of the gain, summed over lines (Hz), as distortion falls above the band."""
    # Without the noise of the gain, which no distortion moves.
    noise = np.einsum("qppl->qpl", table.covariance(f)).real
    played = min(one.model.band[1] for one in table.own)
    share = np.where(f <= played, 1.0, _FALLS**2)
    return np.asarray(np.maximum(((np.abs(table.gain(f)) ** 2 - noise) * share).sum(axis=2), 0.0))


def slew_of(limits: Limits, rate_hz: float) -> float:
    """`Plan.slew`: what the slew rate and the current into the load allow from one sample to the next."""
    slew = min(limits.slew, limits.current_peak / limits.capacitance if limits.capacitance else np.inf)
    return slew / rate_hz / limits.peak


def planned_by(plan: Plan, trade: Trade, budget: float, reach: float, inversion: Inversion) -> FloatArray:
    """(patches, grid) linear volts for the unscaled target. `reach` is the largest of any patch."""
    if trade.scale is None:
        return (max_output if inversion == "optimised" else min_peak)(plan, budget)[0]
    state: State | None = None
    for _ in range(_SETTLING):
        drive, state = within(plan, reach / trade.scale, state)
    return drive


def expected_errors(table: Actuation, plan: Plan, linear_volts: FloatArray) -> FloatArray:
    """(points, 2): rms error expected of each point, over its target's: as calibrated, and after the drift.

    At a point that is to be silent it is all the motion, over the first point's target.
    """
    V = scipy.fft.rfft(linear_volts)
    each = [replace(plan, drift=0.0).left_at(V), plan.left_at(V)]
    return np.sqrt(np.array(each).T / plan.wanted + distorted(table, plan, V)[:, None] ** 2)


def distorted(table: Actuation, plan: Plan, V: ComplexArray) -> FloatArray:
    """(points,): error expected from distortion, over the target's rms.

    Linear volts that the hysteresis model misses are spread over the band by it, and beyond; the table then
    moves as it does there, also where the drives themselves have no power.
    """
    target = np.abs(plan.target[0]) ** 2
    inside = target > 1e-6 * target.max()
    spread = (np.abs(V) ** 2).sum(axis=1) / inside.sum()
    own = np.array([c.distortion for c in table.own])
    return np.asarray(_SPREAD * np.sqrt(plan.weights * (plan.spread @ (own**2 * spread)) / target.sum()))
