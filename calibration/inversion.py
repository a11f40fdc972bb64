"""The drive that makes a table do what is wanted, as well as it can within a voltage limit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, rfft

from instruments.arrays import ComplexArray, FloatArray

__all__ = ["Plan", "loudest", "quiet", "within"]

_ITERATIONS = 60
_SPLITTING, _RELAXATION = 1e-3, 1.7
"""Weight of the splitting over the median power of the gain, and how far each step goes beyond its
target. Drives that were planned with 30 to 240 iterations differ by 2 % in loudness at one error, and by
no trend; a weight of 0.05 without relaxation needs more than 600."""
_STEPS = 6
"""Bisections of the voltage allowed per unit of target; each begins where the last one ended."""
_REGULARISATIONS = 10.0 ** np.arange(-4.0, 0.5, 0.5)
"""Over the median power of the gain."""


@dataclass(frozen=True, eq=False)
class Plan:
    """What is wanted, on one periodic grid that is long enough for the ringing to die out.

    `wanted` is the spectrum (lines,) of the target, `gain` (lines,) target per volt, `weight`
    (lines,) what each line's error counts, `doubt` (lines,) the standard deviation of `gain`,
    `window` (samples,) the share of the limit that the drive may use over time: zero where it must
    be silent. `noise` is the error that measuring adds, for each volt of the drive's peak: the
    more volts per unit of target, the smaller the target that the limit allows. `steepest` is the
    largest step from one sample to the next, over the limit. `doubt` counts for what differs from
    `around` (lines,), the spectrum of a drive whose outcome is known: nothing, before any was played.
    """

    wanted: ComplexArray
    gain: ComplexArray
    weight: FloatArray
    doubt: FloatArray
    window: FloatArray
    noise: float
    steepest: float = np.inf
    around: ComplexArray | float = 0.0
    ridge: float = 5e-6
    """What a difference from `around` costs on every line, over the median power of the gain: what lies
    outside the band helps nobody."""

    def error(self, drive: FloatArray) -> float:
        """Expected rms error of `drive` over the target's rms, noise and doubt included."""
        V = rfft(drive)
        missed = np.abs(self.wanted - self.gain * V) ** 2 + (self.doubt * np.abs(V - self.around)) ** 2
        share = (self.weight * missed).sum() / (np.abs(self.wanted) ** 2).sum()
        return float(np.sqrt(share + (self.noise * np.abs(drive).max()) ** 2))

    @property
    def typical(self) -> float:
        """Median power of the gain within the band."""
        return float(np.median(np.abs(self.gain[self.weight > 0.5]) ** 2))


def quiet(plan: Plan, budget: float) -> tuple[FloatArray, float]:
    """The regularised inverse with the smallest peak that stays within an error budget.

    The one with the least expected error if none does. The doubt about the response is part of the
    regularisation: a line that is not known is not inverted. Returns (samples,) V for the target as
    it is, and the expected error.
    """
    power = plan.weight * (np.abs(plan.gain) ** 2 + plan.doubt**2)
    found = []
    for share in _REGULARISATIONS:
        V = plan.weight * np.conj(plan.gain) * plan.wanted / (power + share * plan.typical)
        drive = irfft(V, len(plan.window)) * (plan.window > 0)
        found.append((drive, plan.error(drive)))
    within = [candidate for candidate in found if candidate[1] <= budget]
    if within:
        return min(within, key=lambda candidate: float(np.abs(candidate[0]).max()))
    return min(found, key=lambda candidate: candidate[1])


def loudest(plan: Plan, budget: float) -> tuple[FloatArray, float]:
    """The drive of the loudest target that stays within an error budget, for the target as it is.

    Where a peak of the regularised inverse is cut off, a better drive for the same limit exists; it
    is found by splitting (ADMM; Boyd et al., Foundations and Trends in Machine Learning 3, 2011,
    section 5). The less voltage a unit of the target may have, the louder the target can be: the
    least is taken whose expected error is within `budget`, or the one that errs least if none is.

    Returns (samples,) V, and the expected error.
    """
    best, least = quiet(plan, budget)
    high = max(float(np.abs(best).max()), _steepest(best) / plan.steepest)
    low = high / 4
    state: State | None = None
    for _ in range(_STEPS):
        limit = float(np.sqrt(high * low))
        drive, state = within(plan, limit, state)
        error = plan.error(drive)
        if error <= max(budget, least):
            best, least, high = drive, min(error, least), limit
        else:
            low = limit
    return best, plan.error(best)


State = tuple[FloatArray, FloatArray]
"""Of the splitting: the parts that keep the limits, and what they still differ from the drive by."""


def within(plan: Plan, limit: float, state: State | None = None) -> tuple[FloatArray, State]:
    """The drive of least expected error with |drive| <= limit x window, and no step above its share.

    Returns (samples,) V and the state that warms the start of the next, similar plan. The level is
    kept exactly at the samples; between them, and by the steps, as well as the splitting converged.
    """
    n = len(plan.window)
    omega = 2j * np.pi * np.arange(n // 2 + 1) / n
    # Half way between samples as well: what is clipped at samples only swings a tenth beyond.
    between = np.minimum(plan.window, np.roll(plan.window, -1))
    rows, bounds = [np.ones_like(omega), np.exp(omega / 2)], [plan.window * limit, between * limit]
    # A step is never larger than twice the limit: a wider bound is none.
    if plan.steepest < 2:
        rows.append((1 - np.exp(-omega)) / plan.steepest)
        bounds.append(np.full(n, limit))
    ways, bound = np.array(rows), np.array(bounds)
    power = plan.weight * (np.abs(plan.gain) ** 2 + plan.doubt**2)
    ridge = plan.ridge * plan.typical
    known = (plan.weight * plan.doubt**2 + ridge) * plan.around
    towards = plan.weight * np.conj(plan.gain) * plan.wanted + known
    rho = _SPLITTING * plan.typical
    inverse = 1 / (power + rho * (np.abs(ways) ** 2).sum(axis=0) + ridge)
    begin = np.clip(irfft(ways * plan.around, n), -bound, bound)
    z, u = state or (begin, np.zeros(bound.shape))
    for _ in range(_ITERATIONS):
        V = (towards + rho * (np.conj(ways) * rfft(z - u)).sum(axis=0)) * inverse
        v = _RELAXATION * irfft(ways * V, n) + (1 - _RELAXATION) * z
        z = np.clip(v + u, -bound, bound)
        u = u + v - z
    return z[0], (z, u)


def _steepest(drive: FloatArray) -> float:
    return float(np.abs(np.diff(drive, prepend=drive[-1])).max())
