"""A surface whose modes soften with amplitude, as glued and clamped panes do: bounded Duffing springs.

The spring of each mode loses the share c x^2 / (1 + x^2) of its stiffness, where x is the displacement over
`amplitude`: cubic for small motion (Duffing), and never unstable. The lost force is found step by step, by
iteration, and then drives the modes, which are exact, as a staircase of its own: its error is that of one
step (0.4 % of this small force at 2.5 kHz and 50 kS/s), not the motion's. Modes soften on their own, without
coupling to each other; while an output is held between two plays, they ring on as for small motion.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray
from .modal import ModalPoles, Modes
from .modal_surface import ModalSurface
from .poles import Course
from .touched import TouchedPoles

_STEPS = 256
"""Steps that are iterated together: within them the phase of a softened mode turns by little."""
_ITERATIONS, _SMALL = 8, 1e-7
"""Most iterations, and the change of the force, relative to the largest, at which they end."""
_LONGEST = 1e-4
"""Longest step (s) whose force is computed; a longer one holds an output."""


class SofteningSurface(ModalSurface):
    """See the module. At `amplitude` (m, of a mode's own coordinate) a mode's frequency is lower by `shift`.

    `shift` is relative, and below 0.2.
    """

    _forced = True

    def __init__(
        self,
        modes: Modes | Callable[[float], Modes],
        shift: float,
        amplitude: float,
        every: float = np.inf,
    ) -> None:
        super().__init__(modes, every)
        # The describing function of x^3 / (1 + x^2) at an amplitude of 1 is sqrt(2) - 1; a frequency falls by
        # half of what its stiffness loses.
        self._share = 2 * shift / (np.sqrt(2) - 1)
        self._amplitude = amplitude
        count, patches = len(self.modes(0.0).natural_hz), len(self.patches)
        self._state: ComplexArray = np.zeros(count, dtype=np.complex128)
        self._volts, self._held = np.zeros(patches), np.zeros(patches)
        self._end = 0.0

    def _add(
        self,
        course: Course[ModalPoles | TouchedPoles],
        poles: ModalPoles,
        start: float,
        period: float,
        levels: FloatArray,
    ) -> None:
        count = len(self._state)
        own = poles.poles.poles[:count]
        coupling = poles.poles.inputs[:count, : len(levels)].real
        self._rest_until(start, own, coupling, poles.amplifier)
        forces = np.zeros((count, levels.shape[1]))
        if period > _LONGEST:
            course.step(poles, poles.poles, start, period, np.vstack([levels, forces]))
            self._held = levels[:, -1]
            return
        for first in range(0, levels.shape[1], _STEPS):
            block = slice(first, first + _STEPS)
            forces[:, block] = self._forces(own, coupling, poles.amplifier, period, levels[:, block])
        course.step(poles, poles.poles, start, period, np.vstack([levels, forces]))
        self._held, self._end = levels[:, -1], start + levels.shape[1] * period
        # A force is not held with the output: it belongs to the motion.
        rest = np.concatenate([self._held, np.zeros(count)])[:, None]
        course.step(poles, poles.poles, self._end, np.inf, rest)

    def _rest_until(self, time: float, own: ComplexArray, coupling: FloatArray, amplifier: float) -> None:
        """Bring the states to a time (s), during which the outputs are held."""
        gap = time - self._end
        if gap <= 1e-9:
            return
        steady = -(coupling @ self._held) / own
        # What the amplifier still settles drives each mode for a fraction of a millisecond.
        settling = (coupling @ (self._volts - self._held)) / (-amplifier - own)
        decay = np.exp(own * gap)
        self._state = steady + (self._state - steady - settling) * decay + settling * np.exp(-amplifier * gap)
        self._volts = self._held + (self._volts - self._held) * np.exp(-amplifier * gap)
        self._end = time

    def _forces(
        self, own: ComplexArray, coupling: FloatArray, amplifier: float, period: float, levels: FloatArray
    ) -> FloatArray:
        """Return the lost force of each mode, (modes, steps), and bring the states to the last one's end."""
        decay = np.exp(-amplifier * period)
        behind, _ = scipy.signal.lfilter([0.0, 1 - decay], [1.0, -decay], levels, zi=self._volts[:, None])
        after = levels[:, -1] + (behind[:, -1] - levels[:, -1]) * decay
        mean = levels + (behind - levels) * (1 - decay) / (amplifier * period)
        driven = coupling @ mean
        stiffness = np.abs(own)[:, None] ** 2
        # A state is its decay times the sum of what was pushed in, each push freed of its own decay.
        turned = np.exp(own[:, None] * period * np.arange(levels.shape[1] + 1))
        gain = ((turned[:, 1] - 1) / own)[:, None] / turned[:, 1:]
        states, force = np.empty(turned.shape, dtype=np.complex128), np.zeros(driven.shape)
        for _ in range(_ITERATIONS):
            states[:, 0] = self._state
            states[:, 1:] = np.cumsum(gain * (driven + force), axis=1) + self._state[:, None]
            states[:, 1:] *= turned[:, 1:]
            motion = states.imag / own.imag[:, None]
            middle = (motion[:, 1:] + motion[:, :-1]) / 2
            x2 = (middle / self._amplitude) ** 2
            found = self._share * stiffness * middle * x2 / (1 + x2)
            change = np.abs(found - force).max()
            force = found
            if change <= _SMALL * max(float(np.abs(driven).max()), float(np.abs(found).max())):
                break
        self._state, self._volts = states[:, -1], after
        return force
