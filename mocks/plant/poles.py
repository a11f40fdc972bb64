"""Exact response of a set of poles to staircases: x' = poles x + inputs levels.

Within a step the state has a closed form. Over many steps only the state at the start of each block is
computed; the output in between is a matrix product: the blocks' initial states times their decay, plus the
blocks' levels times the impulse response. The blocks' states follow from one another by doubling: each takes
in the sum of the 1, 2, 4... blocks before it. Both together take a 30th of the time of a recursion for each
pole. What depends on the period and the lateness of the samples only is kept from block to block.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...base.arrays import ComplexArray, FloatArray

Owner = TypeVar("Owner")

_BLOCK = 64
"""Steps per block: fewer make more blocks, more make longer products."""
_EVEN = 1e-9
"""Tolerance for treating samples as evenly spaced (s)."""
_SAME = 1e-12
"""Difference (s) below which two latenesses of samples are one."""
_KEPT = 8
"""Number of latenesses and weights that are kept with their matrices."""
_FRESH = 8
"""Number of the last stretches that keep what can be found again: earlier ones are rarely asked for."""
_DEAD = 1e-18
"""Share that is left of a state from which on it adds less than a rounding error."""
_GONE = 1e-30
"""Magnitude below which a state is set to zero: denormal numbers would take a hundred times as long."""


@dataclass(frozen=True, eq=False)
class Poles:
    """Poles, (poles,) rad/s in the left half plane, and their `inputs`, (poles, channels)."""

    poles: ComplexArray
    inputs: FloatArray | ComplexArray
    _steps: dict[float, _Steps] = field(default_factory=dict)

    @cached_property
    def settled(self) -> ComplexArray:
        """States that a level of minus one settles at, (poles, channels)."""
        return self.inputs / self.poles[:, None]

    def rest(self) -> None:
        """Forget the steps until they are asked for again."""
        self._steps.clear()

    def steps(self, period: float) -> _Steps:
        """Return what happens within a block of steps of `period` (s)."""
        if period not in self._steps:
            self._steps.clear()
            powers = np.exp(np.arange(_BLOCK + 1)[:, None] * period * self.poles)
            self._steps[period] = _Steps(self, powers)
        return self._steps[period]


@dataclass(frozen=True, eq=False)
class _Steps:
    """Steps of one period within a block."""

    of: Poles
    powers: ComplexArray
    """Decay of each state after 0 to `_BLOCK` steps, (steps, poles)."""
    _views: dict[tuple[int, int], _View] = field(default_factory=dict)
    _pushed: dict[int, FloatArray] = field(default_factory=dict)

    @cached_property
    def pushes(self) -> ComplexArray:
        """State at a block's end of a unit force in each of its steps, (steps, poles)."""
        return np.asarray((self.powers[1] - 1) / self.of.poles * self.powers[:_BLOCK][::-1])

    def pushed(self, channel: int) -> FloatArray:
        """`pushes` of a channel's level, (steps, 2 poles): real and imaginary parts."""
        if channel not in self._pushed:
            self._pushed[channel] = _as_real(self.pushes * self.of.inputs[:, channel])
        return self._pushed[channel]

    def view(self, late: float, weights: ComplexArray) -> _View:
        """Return how the states are seen `late` s after the start of each step."""
        key = round(late / _SAME), id(weights)
        if key not in self._views:
            while len(self._views) >= _KEPT:
                del self._views[next(iter(self._views))]
            self._views[key] = _View(self, weights, np.exp(self.of.poles * late))
        return self._views[key]


@dataclass(frozen=True, eq=False)
class _View:
    """The weighted output at one time within each of a block's steps, as matrices."""

    steps: _Steps
    weights: ComplexArray
    """Kept, because another array could get the number of one that is freed."""
    kept: ComplexArray
    """Decay of each state since the start of a step."""
    _forced: dict[int, FloatArray | None] = field(default_factory=dict)

    @cached_property
    def onward(self) -> ComplexArray:
        """Share of the state at the block's start, (steps, poles)."""
        return np.asarray(self.weights * self.kept * self.steps.powers[:_BLOCK])

    @cached_property
    def begun(self) -> FloatArray:
        """From the parts of the state at the block's start, (parts, steps)."""
        return np.ascontiguousarray(_as_real(self.onward.conj()).T)

    def forced(self, channel: int) -> FloatArray | None:
        """From a channel's levels in the block, (steps, steps); None for a channel that is not seen."""
        if channel not in self._forced:
            of, powers = self.steps.of, self.steps.powers
            own, impulse = of.inputs[:, channel], np.zeros(2 * _BLOCK - 1)
            impulse[_BLOCK - 1] = (self.weights * own * (self.kept - 1) / of.poles).sum().real
            impulse[_BLOCK:] = (self.onward[:-1] @ (own * (powers[1] - 1) / of.poles)).real
            seen = np.any(own * self.weights)
            self._forced[channel] = (
                np.ascontiguousarray(sliding_window_view(impulse, _BLOCK)[::-1]) if seen else None
            )
        return self._forced[channel]


class Stretch:
    """Levels (channels, steps) from `start` on, each held for `period` (s), the last until the next stretch.

    It continues from the state of `before` at `start`; without `before` it starts from rest. `anew` converts
    that state to these poles'; without it, poles that have moved a little keep their distance from rest.
    """

    def __init__(
        self,
        of: Poles,
        start: float,
        period: float,
        levels: FloatArray,
        before: Stretch | None = None,
        anew: Callable[[ComplexArray], ComplexArray] | None = None,
    ) -> None:
        self.start = start
        self._of, self._period = of, period
        self._moving = np.flatnonzero(np.ptp(levels, axis=1))
        # Constant levels count as a single step.
        self._steps = levels.shape[1] if len(self._moving) else 1
        self._held = levels[:, 0].copy()
        self._held[self._moving] = 0.0
        blocks = -(-self._steps // _BLOCK)
        self._levels = np.zeros((len(self._moving), blocks * _BLOCK))
        """Levels of the channels that change, (channels, steps); zero beyond the end."""
        self._levels[:, : self._steps] = levels[self._moving, : self._steps]
        # States are relative to the steady state at the constant levels.
        state = np.zeros(len(of.poles), dtype=np.complex128)
        if before is not None:
            found, late = before._since(np.array([start]))
            step = int(found[0])
            state = before._leaning(step) * np.exp(before._of.poles * late[0])
            held = before._at(step)
            if anew is not None:
                state = anew(state - before._of.settled @ held) + of.settled @ self._held
            else:
                state -= of.inputs @ (held - self._held) / of.poles
        self._first = state
        self._alive = self._begins.any(axis=0) | of.inputs[:, self._moving].any(axis=1)
        """(poles,): True where a state is, or becomes, other than the steady one."""

    @cached_property
    def _begins(self) -> ComplexArray:
        """State at each block's first step, (blocks, poles)."""
        begins = self._blocks(self._first)
        begins[np.abs(begins) < _GONE] = 0.0
        return begins

    def rest(self) -> None:
        """Forget the states between, of which there are many, until they are asked for again."""
        self.__dict__.pop("_begins", None)

    def seen(self, times: FloatArray, weights: ComplexArray) -> FloatArray:
        """Return the real part of the sum of states times `weights` (poles,), (times,), at rising times (s).

        Times lie within the stretch, or after it until the next one begins.
        """
        of, last = self._of, self._steps - 1
        gains = -(weights @ of.settled).real
        out = np.full(len(times), gains @ self._held)
        if not weights[self._alive].any():
            return out
        step, since = self._since(times)
        if last and np.ptp(since) < _EVEN:
            first = int(step[0])
            along = self._along(first, int(step[-1]) + 1, float(since[0]), weights)
            return out + along[step - first]
        moved = int(np.searchsorted(step, last))
        if moved:
            out[:moved] += self._between(step[:moved], since[:moved], weights)
        if moved < len(times):
            level = gains[self._moving] @ self._levels[:, last]
            out[moved:] += level + ringing(of.poles, weights * self._leaning(last), since[moved:])
        return out

    def _since(self, times: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Return the step that contains each time, and the time since that step began (s)."""
        if self._steps == 1:
            return np.zeros(len(times), dtype=np.intp), np.maximum(times - self.start, 0.0)
        # The tolerance assigns a sample at the start of a step to that step, in spite of rounding.
        position = (times - self.start) / self._period + 1e-3
        step = position.astype(np.intp)
        if len(step) and (step[0] < 0 or step[-1] >= self._steps):
            step = np.clip(step, 0, self._steps - 1)
        return step, np.maximum(times - self.start - step * self._period, 0.0)

    def _at(self, step: int) -> FloatArray:
        """Return the levels at a step, (channels,)."""
        levels = self._held.copy()
        levels[self._moving] = self._levels[:, step]
        return levels

    def _leaning(self, step: int) -> ComplexArray:
        """Return the state at the start of a step, relative to the steady state at its levels, (poles,)."""
        block, more = divmod(step, _BLOCK)
        state = self._begins[block]
        if len(self._moving):
            of, steps = self._of, self._of.steps(self._period)
            own = of.inputs[:, self._moving]
            within = self._levels[:, block * _BLOCK : step]
            pushed = (within @ steps.pushes[_BLOCK - more :] * own.T).sum(axis=0)
            state = steps.powers[more] * state + pushed + own @ self._levels[:, step] / of.poles
        return np.asarray(state)

    def _blocks(self, state: ComplexArray) -> ComplexArray:
        begins = np.empty((self._levels.shape[1] // _BLOCK, len(state)), dtype=np.complex128)
        begins[0] = state
        if len(begins) > 1:
            steps = self._of.steps(self._period)
            begins[1:] = 0.0
            for levels, channel in zip(self._levels, self._moving.tolist(), strict=True):
                by_block = levels.reshape(-1, _BLOCK)[:-1]
                begins[1:] += (by_block @ steps.pushed(channel)).view(np.complex128)
            _doubled(begins, steps.powers[_BLOCK])
        return begins

    def _along(self, first: int, stop: int, late: float, weights: ComplexArray) -> FloatArray:
        """Return the weighted output `late` s after the start of each of consecutive steps, (steps,)."""
        blocks = slice(first // _BLOCK, -(-stop // _BLOCK))
        view = self._of.steps(self._period).view(late, weights)
        out = _as_real(self._begins[blocks]) @ view.begun
        for levels, channel in zip(self._levels, self._moving.tolist(), strict=True):
            forced = view.forced(channel)
            if forced is not None:
                out += levels.reshape(-1, _BLOCK)[blocks] @ forced
        from_first = blocks.start * _BLOCK
        return np.asarray(out.ravel()[first - from_first : stop - from_first])

    def _between(self, step: NDArray[np.intp], since: FloatArray, weights: ComplexArray) -> FloatArray:
        """Return the weighted output at arbitrary times, by a recursion for each pole, (times,)."""
        of, block = self._of, int(step[0]) // _BLOCK
        first, stop = block * _BLOCK, int(step[-1]) + 1
        out = np.zeros(len(step))
        for k in np.flatnonzero(weights):
            pole, state = of.poles[k], self._begins[block, k]
            force = of.inputs[k, self._moving] @ self._levels[:, first:stop]
            decay = np.exp(pole * self._period)
            states = np.empty(stop - first, dtype=np.complex128)
            states[0] = state
            states[1:], _ = scipy.signal.lfilter(
                [(decay - 1) / pole], [1.0, -decay], force[:-1], zi=[decay * state]
            )
            kept = np.exp(pole * since)
            now = kept * states[step - first] + (kept - 1) / pole * force[step - first]
            out += (weights[k] * now).real
        return out


class Course(Generic[Owner]):
    """The stretches of the last `remembered` seconds; each has an owner, which knows the poles' weights.

    `rest` is called with an owner whose last stretch was long ago, to forget what it can find again.
    """

    def __init__(
        self, owner: Owner, poles: Poles, remembered: float, rest: Callable[[Owner], None] | None = None
    ) -> None:
        self._rest = rest
        still = np.zeros((poles.inputs.shape[1], 1))
        self._stretches = deque([(owner, Stretch(poles, 0.0, np.inf, still))])
        self._remembered = remembered

    @property
    def begin(self) -> float:
        """Earliest time that is remembered (s)."""
        return self._stretches[0][1].start

    @property
    def owner(self) -> Owner:
        """The owner of the last stretch."""
        return self._stretches[-1][0]

    def step(
        self,
        owner: Owner,
        poles: Poles,
        start: float,
        period: float,
        levels: FloatArray,
        anew: Callable[[ComplexArray], ComplexArray] | None = None,
    ) -> None:
        """Add levels (channels, steps), each held for `period` (s), from `start` (s) on, with these poles.

        `anew` converts the states of the last stretch's poles to these poles': see `Stretch`.
        """
        stretch = Stretch(poles, start, period, levels, self._stretches[-1][1], anew)
        self._stretches.append((owner, stretch))
        if len(self._stretches) > _FRESH:
            left, old = self._stretches[-_FRESH - 1]
            old.rest()
            if self._rest is not None and left is not self._stretches[-_FRESH][0]:
                self._rest(left)
        while len(self._stretches) > 1 and self._stretches[1][1].start < start - self._remembered:
            self._stretches.popleft()

    def seen(self, times: FloatArray, weights: Callable[[Owner], ComplexArray]) -> FloatArray:
        """Return the weighted output, (times,), at rising times (s); `weights` of an owner are (poles,)."""
        out, end = np.zeros(len(times)), len(times)
        for owner, stretch in reversed(self._stretches):
            first = int(np.searchsorted(times, stretch.start - 1e-9))
            if stretch is self._stretches[0][1]:
                first = 0
            if first < end:
                out[first:end] = stretch.seen(times[first:end], weights(owner))
                end = first
            if not end:
                break
        return out


def _doubled(begins: ComplexArray, decay: ComplexArray) -> None:
    """Add to the states at each block's start what is left of all blocks before, in place.

    `begins` is (blocks, poles), `decay` (poles,) what is left after a block. Poles that have died out are
    left behind, and of the many at high frequencies most soon have.
    """
    before, alive, held = 1, np.arange(len(decay)), begins
    while before < len(begins):
        held[before:] += decay * held[:-before]
        decay, before = decay * decay, 2 * before
        kept = np.abs(decay) > _DEAD
        if 2 * kept.sum() < len(kept):
            if held is not begins:
                begins[:, alive] = held
            alive, decay = alive[kept], decay[kept]
            held = begins[:, alive]
    if held is not begins:
        begins[:, alive] = held


def ringing(poles: ComplexArray, amplitudes: ComplexArray, since: FloatArray) -> FloatArray:
    """Return the real part of the summed free decay from `amplitudes` (poles,), (times,).

    `poles` are (poles,) rad/s. At times since its begin (s) that rise evenly it takes a 30th of the time.
    """
    used = np.abs(amplitudes) > _GONE
    poles, a = poles[used], amplitudes[used]
    count = len(since)
    if not len(poles):
        return np.zeros(count)
    if count < 2 * _BLOCK or np.ptp(np.diff(since)) > _EVEN:
        return np.asarray((a * np.exp(since[:, None] * poles)).sum(axis=1).real)
    period = (since[-1] - since[0]) / (count - 1)
    begins = a * np.exp(since[::_BLOCK, None] * poles)
    begins[np.abs(begins) < _GONE] = 0.0
    onward = np.exp(np.arange(_BLOCK)[:, None] * period * poles)
    return np.asarray((_as_real(begins) @ _as_real(onward.conj()).T).ravel()[:count])


def _as_real(values: ComplexArray) -> FloatArray:
    """View (rows, columns) complex as (rows, 2 columns) real and imaginary parts: BLAS is faster on these."""
    return np.ascontiguousarray(values).view(np.float64)
