"""Plans of drives: from actuation and targets to an inversion problem, and its solution for a trade."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, Protocol

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray
from ...instruments import Limits
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
_ALIKE = 20
"""Neighbouring lines whose gains have one error: the local fits' windows overlap."""
_CLEAR = 3.0
"""Standard deviations of its noise from which the power of a gain counts."""
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
    )


def _moved_by_distortion(table: Actuation, step: float) -> FloatArray:
    """(points, patches): power that a distortion of one volt on each line moves, as it falls above the band.

    `step` (Hz) is the distance of the lines, which go on where a plan's grid ends: there is no drive there,
    and still a distortion.
    """
    f = np.arange(*table.known, step)
    played = min(one.model.band[1] for one in table.own)
    share = np.where(f <= played, 1.0, _FALLS**2)
    power, noise, _ = _by_bands(table, f, share)
    return np.asarray((power - noise).sum(axis=2))


def _by_bands(table: Actuation, f: FloatArray, share: FloatArray | float = 1.0) -> tuple[FloatArray, ...]:
    """(points, patches, bands): power of the gain in third octaves of lines (Hz), and that of its noise.

    Both are zero where the gain does not stand out of its noise: a resonance does, what is even does not.
    Also (bands,): the lowest frequency of each.
    """
    power = np.abs(table.gain(f)) ** 2 * share
    noise = np.einsum("qppl->qpl", table.covariance(f)).real * share
    starts = np.unique(np.floor(3 * np.log2(f / f[0])).astype(int), return_index=True)[1]
    spread = np.sqrt(_ALIKE * np.add.reduceat(noise**2, starts, axis=2))
    power, noise = (np.add.reduceat(one, starts, axis=2) for one in (power, noise))
    clear = power - noise > _CLEAR * spread
    return np.where(clear, power, 0.0), np.where(clear, noise, 0.0), f[starts]


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


def expected_errors(table: Actuation, plan: Plan, linear_volts: FloatArray, rate_hz: float) -> FloatArray:
    """(points, 2): rms error expected of each point, over its target's: as calibrated, and after the drift.

    At a point that is to be silent it is all the motion, over the first point's target.
    """
    V = scipy.fft.rfft(linear_volts)
    each = [replace(plan, drift=0.0).left_at(V), plan.left_at(V)]
    return np.sqrt(
        np.array(each).T / plan.wanted
        + _distorted(table, plan, V, rate_hz / linear_volts.shape[1])[:, None] ** 2
    )


def expected_above(table: Actuation, plan: Plan, linear_volts: FloatArray, rate_hz: float) -> FloatArray:
    """(2, edges): frequencies (Hz), and the most that the first point may err above each, over its target.

    It is the motion by the drive's own spectrum and the measured response, and by twice the distortion that
    the calibration left, as strong above its band as within: more than any simulated table showed. A third
    octave in which the response does not stand out of its noise counts as still.
    """
    V = scipy.fft.rfft(linear_volts)
    f = scipy.fft.rfftfreq(linear_volts.shape[1], 1 / rate_hz)
    left = np.abs(plan.missed(V)[0]) ** 2 + np.einsum("pl,ppl->l", np.abs(V) ** 2, plan.covariance[0]).real
    left[~plan.known] = 0.0
    power, _, edges = _by_bands(table, np.arange(*table.known, f[1]))
    own = np.array([c.distortion for c in table.own])
    moved = (2 * own) ** 2 * _per_line(plan, V) @ power[0]
    each = [left[f >= edge].sum() + moved[edges >= edge].sum() for edge in edges]
    return np.array([edges, np.sqrt(np.array(each) / plan.wanted)])


def _per_line(plan: Plan, V: ComplexArray) -> FloatArray:
    """(patches,): squared linear volts on each of the target's lines, if they were spread evenly."""
    target = np.abs(plan.target[0]) ** 2
    return np.asarray((np.abs(V) ** 2).sum(axis=1) / (target > 1e-6 * target.max()).sum())


def _distorted(table: Actuation, plan: Plan, V: ComplexArray, step: float) -> FloatArray:
    """(points,): error expected from distortion, over the target's rms.

    Linear volts that the hysteresis model misses are spread over the band by it, and beyond; the table then
    moves as it does there, also where the drives themselves have no power.
    """
    power = np.array([c.distortion for c in table.own]) ** 2 * _per_line(plan, V)
    moved = _moved_by_distortion(table, step) @ power
    return np.asarray(_SPREAD * np.sqrt(plan.weights * moved / plan.wanted))
