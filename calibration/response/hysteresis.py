"""Hysteresis of a piezo patch: volts to linear volts, and the inverse that compensates it.

Linear volts are the volts that would produce the same motion without hysteresis. A piezo patch expands
more per volt the larger the amplitude, and with more lag: at 10 to 15 % of loop width
(docs/hardware.md, "Patches") a small vibration is a third weaker than a sweep at full voltage says. A
Prandtl-Ishlinskii sum of play operators describes that and has an exact inverse (Kuhnen, European
Journal of Control 9, 2003). It is fitted to sweeps at several levels, or found together with the
table's modes in a single multisine, so nothing has to be added to the rig.

A patch whose expansion differs from its shrinking adds an even order: a part of the linear volts that does
not change sign with the volts. Play operators are odd and have none. It is a kink and a square of what the
play operators make, and its inverse is a quadratic equation on either side of zero.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ...base.arrays import ComplexArray, FloatArray

HALF_WIDTHS = np.array([0.0, 0.02, 0.05, 0.09, 0.14, 0.2, 0.28, 0.38, 0.5, 0.65, 0.82])
"""Half-widths of the operators fitted to multisines, over the level; 0 is the volts themselves. Seven
up to 0.65 of the level made an error of 0.2 % in a map's gains (measured)."""


@dataclass(frozen=True, eq=False)
class Hysteresis:
    """Weights (radii,) of play operators with half-widths `radii` (V), rising from 0.

    `level` is the amplitude at which the gain has magnitude one; the phase there is the lag already
    contained in the response, which was measured at that level. `even` (2,) are the parts of the even order:
    with x the sum of the play operators, even[0] |x| + even[1] x^2 / level is added to x.
    """

    radii: FloatArray
    weights: FloatArray
    level: float
    even: FloatArray = field(default_factory=lambda: np.zeros(2))

    def gain(self, amplitude: float) -> complex:
        """Linear volts per volt of a sine of `amplitude` volts: its first harmonic."""
        return complex(first_harmonic(self.radii, amplitude) @ self.weights)

    def reach(self, volts: float) -> float:
        """Largest linear voltage (V) that a peak of `volts` reaches in either direction."""
        odd = self._odd_reach(volts)
        return odd - abs(float(self.even @ even_terms(np.array([odd]), self.level)[:, 0]))

    def to_linear_volts(self, volts: FloatArray) -> FloatArray:
        """(samples,) linear volts produced by (samples,) V, from rest."""
        odd = self.odd(volts)
        return np.asarray(odd + self.even @ even_terms(odd, self.level)) if self.even.any() else odd

    def odd(self, volts: FloatArray) -> FloatArray:
        """(samples,) linear volts of the play operators alone, without the even order."""
        return _weighted(volts, self.radii, self.weights)

    def from_linear_volts(self, linear_volts: FloatArray) -> FloatArray:
        """(samples,) V that produce (samples,) linear volts from rest: the inverse of `to_linear_volts`."""
        slope = np.cumsum(self.weights)
        # Radii of the inverse are the linear volts at which each operator begins to move.
        radii = np.array([self._odd_reach(r) for r in self.radii])
        return _weighted(self._straightened(linear_volts), radii, np.diff(1 / slope, prepend=0.0))

    def _odd_reach(self, volts: float) -> float:
        return float(self.weights @ np.maximum(volts - self.radii, 0.0))

    def _straightened(self, linear_volts: FloatArray) -> FloatArray:
        """(samples,) sums of the play operators that make (samples,) linear volts with the even order.

        Beyond where the curve turns, which no patch's does within its volts, it goes on straight.
        """
        if not self.even.any():
            return linear_volts
        slope = 1 + self.even[0] * np.sign(linear_volts)
        bend = 4 * self.even[1] / self.level * linear_volts
        return np.asarray(2 * linear_volts / (slope + np.sqrt(np.maximum(slope**2 + bend, 0.0))))


def even_terms(odd: FloatArray, level: float) -> FloatArray:
    """(2, samples): a kink and a square, of the sum (samples,) of the play operators (V)."""
    return np.array([np.abs(odd), odd**2 / level])


def operators(volts: FloatArray, level: float) -> FloatArray:
    """(operators, samples): components of the linear volts: the volts, their plays at `level`, their square.

    The square models the asymmetry of a piezo, which expands more in one direction. Left out, it is taken
    for vibration, because even distortion falls between a patch's lines, or on other patches'.
    """
    plays = _play(volts, HALF_WIDTHS[1:] * level)
    return np.array([volts, *plays, volts**2 / level])


def first_harmonic(radii: FloatArray, amplitude: float) -> ComplexArray:
    """Describing function of play operators (Gelb and Vander Velde, 1968, appendix B: backlash)."""
    share = np.minimum(radii / amplitude, 1.0)
    x = 1 - 2 * share
    real = (np.pi / 2 + np.arcsin(x) + x * np.sqrt(1 - x**2)) / np.pi
    return np.asarray(real - 1j * (4 / np.pi) * share * (1 - share))


def _play(signal: FloatArray, radii: FloatArray) -> Iterator[FloatArray]:
    """Output (samples,) of the play operator of each half-width for a signal, from rest.

    Exact between turning points at any sample rate.
    """
    steps = np.sign(np.diff(signal, prepend=0.0))
    moving = np.flatnonzero(steps)
    turns = moving[1:][np.diff(steps[moving]) != 0] if len(moving) else moving
    lengths = np.diff(turns, prepend=0, append=len(signal))
    # Between two turning points the state at the first determines the output.
    states = np.zeros((len(turns) + 1, len(radii)))
    for state, last, moved in zip(states, signal[turns - 1], states[1:], strict=False):
        np.minimum(np.maximum(state, last - radii), last + radii, out=moved)
    for radius, begins in zip(radii, states.T, strict=True):
        yield np.clip(np.repeat(begins, lengths), signal - radius, signal + radius)


def _weighted(signal: FloatArray, radii: FloatArray, weights: FloatArray) -> FloatArray:
    out = np.zeros(len(signal))
    for weight, moved in zip(weights, _play(signal, radii), strict=True):
        out += weight * moved
    return out
