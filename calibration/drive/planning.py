"""Plans of drives: from actuation and targets to an inversion problem, and its solution for a trade."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, Protocol

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray
from ...instruments import Limits
from ..model import Calibration, Drift
from ..spectra import third_octave
from .actuation import Actuation
from .inversion import Plan, State, max_output, min_peak, within
from .trade import STEADY, Trade

Inversion = Literal["optimised", "regularised"]
_SPREAD = 0.6
"""Error of a drive over that which distortion would make if it were spread evenly over the band: part of it
stays near the drive's own lines, where the table moves little (measured on simulated tables)."""
_FALLS = 0.5
"""Distortion above the frequencies that a calibration plays, over that within them, at most, as is expected
where noise hides it: simulated, a quarter to two fifths, but all of it on a beam."""
_LARGEST = 2.0
"""The same, for a bound."""
_MORE = 1.3
"""What a drive moves above the frequencies played, over what a multisine of as many squared volts was
measured to move, at most: 0.3 to 0.8 on four simulated tables, up to 1.1 on a beam."""
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


def _by_distortion(
    table: Actuation, plan: Plan, V: ComplexArray, step: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Squared motion by what the law misses of spectra (patches, lines) of linear volts.

    That is spread over the band, and beyond: the table moves as it does there, also where the drive itself
    has no power. `step` (Hz) is the distance of the lines, which go on where the plan's grid ends. Above the
    frequencies that a calibration plays it measured what a multisine moves.

    Returns what is expected, (points, bands), the most that it may be, likewise, and (bands,) Hz, the lowest
    frequency of each.
    """
    target, volts = np.abs(plan.target[0]) ** 2, (np.abs(V) ** 2).sum(axis=1)
    own = np.array([c.distortion for c in table.own])[:, None] ** 2
    on_line = own / (target > 1e-6 * target.max()).sum()
    f, played = np.arange(*table.known, step), min(one.model.band[1] for one in table.own)
    within, noise, hz = _by_bands(table, f[f <= played])
    above, lost, above_hz = _by_bands(table, f[f > played])
    value, deviation = np.array([[_measured(c, above_hz) for c in row] for row in table.rows]).T.swapaxes(
        1, 3
    )
    value = np.maximum(value, 0.0)
    falls = np.minimum(value + deviation, (_SPREAD * _FALLS) ** 2 * on_line * (above - lost))
    most = np.minimum(_MORE**2 * (value + 2 * deviation), _LARGEST**2 * on_line * above)
    expected = np.concatenate([_SPREAD**2 * on_line * (within - noise), falls], axis=2)
    bound = np.concatenate([_LARGEST**2 * on_line * within, most], axis=2)
    return volts @ expected, volts @ bound, np.concatenate([hz, above_hz])


def _measured(calibration: Calibration, hz: FloatArray) -> FloatArray:
    """(bands, 2): `Calibration.beyond` of the third octaves that begin at `hz`; infinite where unknown."""
    bands, values = calibration.beyond[0], calibration.beyond[1:].T
    at = dict(zip(third_octave(bands).tolist(), values.tolist(), strict=True))
    found = [at.get(number, (np.inf, np.inf)) for number in third_octave(hz).tolist()]
    return np.array(found, dtype=np.float64).reshape(-1, 2)


def _by_bands(table: Actuation, f: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(points, patches, bands): power of the gain in third octaves of lines (Hz), and that of its noise.

    Both are zero where the gain does not stand out of its noise: a resonance does, what is even does not.
    Also (bands,): the lowest frequency of each.
    """
    power = np.abs(table.gain(f)) ** 2
    noise = np.einsum("qppl->qpl", table.covariance(f)).real
    if not len(f):
        return power, noise, f
    starts = np.unique(third_octave(f), return_index=True)[1]
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


def expected(
    table: Actuation, plan: Plan, linear_volts: FloatArray, rate_hz: float
) -> tuple[FloatArray, FloatArray]:
    """What a drive is expected to err, over the targets.

    First (points, 2), rms: of each point, as calibrated and after the plan's drift; at a point that is to be
    silent it is all the motion, over the first point's target. Then (2, edges): frequencies (Hz), and the
    most that the first point may err above each, by the drive's own spectrum and the measured response, and
    by the most that distortion may move (`_by_distortion`). A third octave in which the response does not
    stand out of its noise counts as still.
    """
    V = scipy.fft.rfft(linear_volts)
    f = scipy.fft.rfftfreq(linear_volts.shape[1], 1 / rate_hz)
    moved, most, edges = _by_distortion(table, plan, V, f[1])
    steady = replace(plan, drift=0.0)
    each = np.array([steady.left_at(V), plan.left_at(V)]).T + (plan.weights * moved.sum(axis=1))[:, None]
    left = np.abs(plan.missed(V)[0]) ** 2 + np.einsum("pl,ppl->l", np.abs(V) ** 2, plan.covariance[0]).real
    left[~plan.known] = 0.0
    above = [left[f >= edge].sum() + most[0, edges >= edge].sum() for edge in edges]
    return np.sqrt(each / plan.wanted), np.array([edges, np.sqrt(np.array(above) / plan.wanted)])
