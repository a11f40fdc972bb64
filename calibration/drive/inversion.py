"""Inversion of the response: the drives of one or several patches that make points follow their targets.

Model: on a periodic grid point q moves by the sum over patches of G_qp V_p, with V_p the spectrum of patch
p's drive. G is a random number about its estimate on each line: it was measured, and the table drifts. With
E the covariance of the measurement, which counts from V0, a drive whose outcome was measured, and D that of
the drift, which counts from zero, the expected squared error is the sum over the lines of

    sum over q of w_q^2 (|target_q - sum over p of G_qp V_p|^2 + (V - V0)* E_q (V - V0) + V* D_q V).

A point that is to be silent has the target zero and the weight of the first point, which is one; a point with
a target of its own is weighted so that its error counts over that target as the first one's over its own.

The covariances regularise: where G is uncertain the drives stay what they were, and of all drives that move
the points alike those are taken whose motion a drift changes least. One patch leaves no such choice, several
do. Voltage and slew rate are bounds on the samples of each patch. Error and bounds are convex, so splitting
(ADMM; Boyd et al., Foundations and Trends in Machine Learning 3, 2011, section 5) approaches the least error
within a bound, and the lowest bound within the error budget is looked for: the lower the voltage per unit of
target, the larger the output within the limits.

Assumptions: the table is linear (hysteresis is compensated elsewhere) and is what it was when G was
measured, but for the drift; the errors of G are independent from line to line; the grid is longer than the
ringing. What breaks them: a larger drift, a patch that does not follow its compensation, plates that ring
beyond the grid; then the error is larger than expected, which a check measures and nothing here can know.
Lines that were not measured get no drive.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...base.arrays import BoolArray, ComplexArray, FloatArray

_ITERATIONS = 60
_SPLITTING, _RELAXATION = 0.1, 1.7
"""Weight of the splitting over the median power of the gain and the error that is left, and over-relaxation.
Of six weights, the one that came within 2 % of the least error in fewest iterations rose with that error:
on most of 19 plans of 1 and 4 patches 0.001 at 1 %, 0.003 at 3 %, 0.005 to 0.01 at 8 %, 0.02 at 18 %."""
_STEPS, _NEAR = 8, 3e-3
"""Largest number of voltages tried per unit of target, each beginning where the last one ended; and how far
below the budget the error is aimed at, relative to it."""
_REGULARISATIONS = 10.0 ** np.arange(-4.0, 0.5, 0.5)
"""Regularisations to try, over the median power of the gain."""


@dataclass(frozen=True, eq=False)
class Plan:
    """An inversion problem on one periodic grid that is long enough for the ringing to die out.

    `target` is (points, lines), the targets' spectra: zero at a point that is to be silent. `gain` is
    (points, patches, lines), target per volt; `known` (lines,) True where it was measured: elsewhere no drive
    has power. `covariance` and `drift` are (points, patches, patches, lines) as in the module. `window`
    (samples,) is the share of the limit available to the drives over time: zero where they must be zero.
    """

    target: ComplexArray
    gain: ComplexArray
    known: BoolArray
    covariance: ComplexArray
    window: FloatArray
    typical: float
    """Median power of the gain within the target's band: the mean over the patches."""
    reach: FloatArray
    """(patches,): the limit of each patch, over the largest of them."""
    drift: ComplexArray | float = 0.0
    slew: float = np.inf
    """Largest allowed step from one sample to the next, over the limit."""
    operating_point: ComplexArray | float = 0.0
    """(patches, lines): spectra of drives whose outcome was measured; zero before any was played."""
    beside: ComplexArray | float = 0.0
    """(points, lines): motion measured there that `gain` does not describe, and that stays as it is."""
    ridge: float = 5e-6
    """Penalty for a difference from `operating_point` on every line, over `typical`: it limits the drive
    where the table hardly moves."""

    @cached_property
    def weights(self) -> FloatArray:
        """(points,): w^2 of the module."""
        power = (np.abs(self.target) ** 2).sum(axis=1)
        return np.asarray(power[0] / np.where(power > 0, power, power[0]))

    @cached_property
    def power(self) -> ComplexArray:
        """(lines, patches, patches): expected power of the motion that drives make, without `ridge`."""
        own = np.einsum("q,qpl,qrl->lpr", self.weights, self.gain.conj(), self.gain)
        return np.asarray(own + np.moveaxis(self.uncertain + self._summed(self.drift), 2, 0))

    @cached_property
    def uncertain(self) -> ComplexArray:
        """(patches, patches, lines): `covariance` of all points, weighted."""
        return np.asarray(self._summed(self.covariance))

    @cached_property
    def pull(self) -> ComplexArray:
        """(patches, lines): the right side of the normal equations, without the operating point."""
        return np.asarray(
            np.einsum("q,qpl,ql->pl", self.weights, self.gain.conj(), self.target - self.beside)
        )

    def _summed(self, matrices: ComplexArray | float) -> ComplexArray | float:
        if isinstance(matrices, float):
            return matrices
        return np.asarray(np.einsum("q,qprl->prl", self.weights, matrices))

    def left_at(self, V: ComplexArray) -> FloatArray:
        """(points,): expected squared error of spectra (patches, lines), weighted, over all known lines.

        Uncertainty and drift are included.
        """
        missed = np.abs(self.missed(V)) ** 2 + spread(self.covariance, V - self.operating_point)
        if not isinstance(self.drift, float):
            missed = missed + spread(self.drift, V)
        return np.asarray(self.weights * missed[:, self.known].sum(axis=1))

    def left(self, V: ComplexArray) -> float:
        """`left_at`, summed over the points."""
        return float(self.left_at(V).sum())

    def at(self, row: int) -> Plan:
        """The plan of one of its points alone."""
        own = slice(row, row + 1)
        drift = self.drift if isinstance(self.drift, float) else self.drift[own]
        return replace(
            self, target=self.target[own], gain=self.gain[own], covariance=self.covariance[own], drift=drift
        )

    def missed(self, V: ComplexArray) -> ComplexArray:
        """(points, lines): target less expected motion."""
        return np.asarray(self.target - self.beside - self.moved(V))

    def moved(self, V: ComplexArray) -> ComplexArray:
        """(points, lines): expected motion."""
        return np.asarray(np.einsum("qpl,pl->ql", self.gain, V))

    @property
    def wanted(self) -> float:
        """Squared target of the first point, summed over the lines."""
        return float((np.abs(self.target[0]) ** 2).sum())

    def error(self, drive: FloatArray) -> float:
        """Expected rms error of drives (patches, samples) over the target's rms, uncertainty included.

        Of several points it is the root of the sum of their squares: none has more.
        """
        return float(np.sqrt(self.left(np.fft.rfft(drive)) / self.wanted))


def min_peak(plan: Plan, budget: float) -> tuple[FloatArray, float]:
    """The regularised inverse with the smallest peak that stays within an error budget.

    If none does, the one with the least expected error. The response's uncertainty is part of the
    regularisation: a line of unknown gain is not inverted. Returns (patches, samples) V for the unscaled
    target, and the expected error.
    """
    found = []
    for share in _REGULARISATIONS:
        inverse = np.linalg.inv(plan.power + share * plan.typical * np.eye(len(plan.reach)))
        V = plan.known * np.einsum("lpr,rl->pl", inverse, plan.pull)
        drive = np.fft.irfft(V, len(plan.window)) * (plan.window > 0)
        found.append((drive, plan.error(drive)))
    within = [candidate for candidate in found if candidate[1] <= budget]
    if within:
        return min(within, key=lambda candidate: _peak(plan, candidate[0]))
    return min(found, key=lambda candidate: candidate[1])


def max_output(plan: Plan, budget: float) -> tuple[FloatArray, float]:
    """The drives that permit the largest output within an error budget, for the target unscaled.

    Where a peak of the regularised inverse is cut off, a better drive for the same limit exists; it
    is found by splitting (see the module). The lower the voltage per unit of target, the larger the target
    can be scaled: the result has the lowest voltage with an expected error within `budget`, or the least
    error if none is within.

    Returns (patches, samples) V, and the expected error.
    """
    best, least = min_peak(plan, budget)
    high = max(_peak(plan, best), _peak(plan, np.diff(best, prepend=best[:, -1:])) / plan.slew)
    low, limit = high / 4, high / 2
    # Logarithms of the errors at both ends, over the budget, once they are known.
    over = under = 0.0
    state: State | None = None
    settled = False
    for _ in range(_STEPS):
        drive, state = within(plan, limit, state, max(budget, least))
        error = plan.error(drive)
        if error <= max(budget, least):
            best, least, high, under = drive, min(error, least), limit, float(np.log(error / budget))
        else:
            low, over = limit, float(np.log(error / budget))
        close = (1 - 2 * _NEAR) * budget < error <= budget
        # Once may be chance: the splitting goes on from voltage to voltage.
        if close and settled:
            break
        settled = close
        share = 0.5
        if under < 0 < over:
            share = float(np.clip((over + _NEAR) / (over - under), 0.05, 0.95))
        limit = float(low * (high / low) ** share)
    return best, plan.error(best)


State = tuple[FloatArray, FloatArray]
"""State of the splitting: the variables within the limits, and their scaled differences from the drive."""


def within(
    plan: Plan, limit: float, state: State | None = None, error: float = 0.01
) -> tuple[FloatArray, State]:
    """The drives of least expected error with |drive| <= limit x reach x window, steps <= that x slew.

    `error` is about what will be left, over the target: the closer it is, the fewer iterations are needed.
    Returns (patches, samples) V and the state for a warm start of the next, similar plan. The level is
    kept exactly at the samples; between samples, and for steps, as far as the splitting converged.
    """
    n, own = len(plan.window), limit * plan.reach[:, None]
    omega = 2j * np.pi * np.arange(n // 2 + 1) / n
    # Half way between samples as well: a drive limited at the samples alone overshoots by a tenth.
    between = np.minimum(plan.window, np.roll(plan.window, -1))
    rows, bounds = [np.ones_like(omega), np.exp(omega / 2)], [plan.window * own, between * own]
    # A step never exceeds twice the limit, so a wider bound has no effect.
    if plan.slew < 2:
        rows.append((1 - np.exp(-omega)) / plan.slew)
        bounds.append(np.ones(n) * own)
    constraints, bound = np.array(rows)[:, None], np.array(bounds)
    ridge = plan.ridge * plan.typical
    right_side = plan.pull + ridge * plan.operating_point
    if not isinstance(plan.operating_point, float):
        right_side = right_side + np.einsum("prl,rl->pl", plan.uncertain, plan.operating_point)
    rho = _SPLITTING * error * plan.typical
    added = rho * (np.abs(constraints[:, 0]) ** 2).sum(axis=0) + ridge
    inverse = np.linalg.inv(plan.power + added[:, None, None] * np.eye(len(plan.reach)))
    # Where nothing is known, the drive has no power.
    inverse = np.ascontiguousarray(np.moveaxis(inverse, 0, 2)) * plan.known
    begin = np.clip(np.fft.irfft(constraints * plan.operating_point, n), -bound, bound)
    z, u = state or (begin, np.zeros(bound.shape))
    shares, relaxed, low = rho * np.conj(constraints), _RELAXATION * constraints, -bound
    for _ in range(_ITERATIONS):
        pulled = right_side + (shares * np.fft.rfft(z - u)).sum(axis=0)
        V = (inverse * pulled).sum(axis=1)
        v = np.fft.irfft(relaxed * V, n)
        v += (1 - _RELAXATION) * z
        v += u
        z = np.clip(v, low, bound)
        u = v - z
    return z[0], (z, u)


def spread(matrix: ComplexArray, V: ComplexArray) -> FloatArray:
    """(points, lines): V* M V, the variance of the motion that V (patches, lines) makes.

    M is (points, patches, patches, lines), a covariance of the response.
    """
    return np.asarray(np.einsum("pl,qprl,rl->ql", V.conj(), matrix, V).real)


def _peak(plan: Plan, drive: FloatArray) -> float:
    """Largest voltage, over the patch's reach."""
    return float((np.abs(drive) / plan.reach[:, None]).max())
