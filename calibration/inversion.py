"""The drive that makes a table do what is wanted, as well as it can within a voltage limit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, rfft

from instruments.arrays import ComplexArray, FloatArray

__all__ = ["Plan", "loudest", "quiet"]

_ITERATIONS = 80
_SPLITTING = 0.05
"""Weight of the splitting over the median power of the gain: found to converge fastest."""
_STEPS = 9
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
    more volts per unit of target, the smaller the target that the limit allows.
    """

    wanted: ComplexArray
    gain: ComplexArray
    weight: FloatArray
    doubt: FloatArray
    window: FloatArray
    noise: float

    def error(self, drive: FloatArray) -> float:
        """Expected rms error of `drive` over the target's rms, noise and doubt included."""
        V = rfft(drive)
        squared = self.weight * (np.abs(self.wanted - self.gain * V) ** 2 + (self.doubt * np.abs(V)) ** 2)
        missed = squared.sum() / (np.abs(self.wanted) ** 2).sum()
        return float(np.sqrt(missed + (self.noise * np.abs(drive).max()) ** 2))

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
    high = float(np.abs(best).max())
    low = high / 8
    state = np.zeros(len(best)), np.zeros(len(best))
    for _ in range(_STEPS):
        limit = float(np.sqrt(high * low))
        drive, state = _within(plan, limit, state)
        error = plan.error(drive)
        if error <= max(budget, least):
            best, least, high = drive, min(error, least), limit
        else:
            low = limit
    return best, plan.error(best)


State = tuple[FloatArray, FloatArray]


def _within(plan: Plan, limit: float, state: State) -> tuple[FloatArray, State]:
    """The drive of least expected error with |drive| <= limit x window; `state` warms the start."""
    n = len(plan.window)
    power = plan.weight * (np.abs(plan.gain) ** 2 + plan.doubt**2)
    towards = plan.weight * np.conj(plan.gain) * plan.wanted
    bound = plan.window * limit
    rho = _SPLITTING * plan.typical
    # What lies outside the band helps nobody, and costs as much as the weakest line within it.
    inverse = 1 / (power + rho * (1 + 1e-3))
    z, u = state
    for _ in range(_ITERATIONS):
        v = irfft((towards + rho * rfft(z - u)) * inverse, n)
        z = np.clip(v + u, -bound, bound)
        u = u + v - z
    return z, (z, u)
