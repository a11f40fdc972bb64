"""The touch table: a plate as a sum of modes, moved by piezo patches, seen by a laser.

Exact between samples: every drive is a staircase, so that the state of each pole at any instant
follows in closed form from its state at the last step. Nothing is integrated numerically, no step
size has to be chosen, and a channel that a multiplexed card samples 14 us late is simply evaluated
14 us later.

Geometry and damping are estimates (hardware.md, section 8): a simply supported pane of soda-lime
glass, 0.50 x 0.35 m, of the thickness that puts its (2, 2) mode at the paper's 263.5 Hz.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from instruments.arrays import ComplexArray, FloatArray
from mocks.hysteresis import Hysteresis

__all__ = ["Plate", "Table", "make_plate", "warmed"]

WIDTH, HEIGHT = 0.50, 0.35
PATCH_WIDTH, PATCH_HEIGHT = 0.050, 0.030
"""The ceramic of a P-876.A12 (found; hardware.md, section 3)."""
MAIN_HZ = 263.5
_HIGHEST = 3.2
"""Modes are kept up to this multiple of the main one: those above the band stiffen what is in it."""


def _curvature(m: int, n: int) -> float:
    return (m / WIDTH) ** 2 + (n / HEIGHT) ** 2


MODES = sorted(
    ((m, n) for m in range(1, 9) for n in range(1, 9) if _curvature(m, n) < _HIGHEST * _curvature(2, 2)),
    key=lambda mode: _curvature(*mode),
)
MAIN = MODES.index((2, 2))
PATCHES = {"A": (0.20, 0.15), "B": (0.62, 0.93), "C": (0.08, 0.45), "D": (0.92, 0.55)}
"""Centres, as fractions of width and height, near the edges. A drives the main mode best."""
MAIN_VELOCITY = 5.0e-3 / 50
"""m/s per V at the main mode's antinode: 3 um of displacement at 50 V, an estimate."""
AMPLIFIER_POLE_HZ = 5000.0
_REMEMBERED = 30.0
_CACHED = 16
_GONE = 1e-30
_DAY = 86_400.0
_STEP_EVERY, _STEP = 3 * 3600.0, 0.1
"""A door, a window, a heater: as often (s), and of this share of the day's course at most (estimates)."""


@dataclass(frozen=True, eq=False)
class Plate:
    """Modes of one pane: `natural_hz` and `damping` are (modes,), shapes are functions of place."""

    natural_hz: FloatArray
    damping: FloatArray
    gain: float
    patches: Mapping[str, tuple[float, float]]

    def shape(self, place: tuple[float, float]) -> FloatArray:
        """(modes,) deflection at a place (fractions of width and height), 1 at an antinode."""
        m, n = np.array(MODES).T
        return np.asarray(np.sin(np.pi * m * place[0]) * np.sin(np.pi * n * place[1]))

    def coupling(self, patch: str) -> FloatArray:
        """(modes,) modal force per volt: a patch bends the pane, so it couples to the curvature
        averaged over its area.
        """
        m, n = np.array(MODES).T
        curvature = (m / WIDTH) ** 2 + (n / HEIGHT) ** 2
        average = np.sinc(m * PATCH_WIDTH / WIDTH / 2) * np.sinc(n * PATCH_HEIGHT / HEIGHT / 2)
        return np.asarray(self.gain * curvature * average * self.shape(self.patches[patch]))

    def velocity(self, patch: str, place: tuple[float, float], frequencies: FloatArray) -> ComplexArray:
        """m/s per V at the patch at `frequencies` (Hz), (frequencies,): the truth."""
        s = 2j * np.pi * np.asarray(frequencies)[:, None]
        w = 2 * np.pi * self.natural_hz
        strength = self.shape(place) * self.coupling(patch)
        return np.asarray((strength * s / (s**2 + 2 * self.damping * w * s + w**2)).sum(axis=1))


def make_plate(
    rng: np.random.Generator,
    drift: float = 0.0,
    damping_scale: float = 1.0,
    collocated_at: tuple[float, float] | None = None,
) -> Plate:
    """One table of many: frequencies and damping scatter with `rng` as mounting and glass do."""
    m, n = np.array(MODES).T
    curvature = (m / WIDTH) ** 2 + (n / HEIGHT) ** 2
    scatter = rng.normal(0, 0.02, len(MODES)).clip(-0.05, 0.05)
    scatter[MAIN] = rng.normal(0, 0.0015)
    natural = MAIN_HZ * curvature / curvature[MAIN] * (1 + scatter) * (1 + drift)
    damping = (0.004 + 0.000025 * natural) * rng.uniform(0.9, 1.1, len(MODES))
    patches = dict(PATCHES)
    # The gain is set at the nominal damping and place: a damped table moves less.
    nominal = Plate(natural, damping, 1.0, patches)
    strength = np.abs(nominal.coupling("A")[MAIN]) / (4 * np.pi * damping[MAIN] * natural[MAIN])
    if collocated_at is not None:
        patches["A"] = collocated_at
    return Plate(natural, np.minimum(damping * damping_scale, 0.3), MAIN_VELOCITY / strength, patches)


def warmed(plate: Plate, time: float, daily: float, seed: int) -> Plate:
    """The plate at a time (s): every frequency follows the day's warmth, by +-`daily` (relative) and steps.

    A day is a sine that begins at the middle; damping ratios and forces stay.
    """
    step = np.random.default_rng([seed, 0xDA1, int(max(time, 0.0) / _STEP_EVERY)]).uniform(-_STEP, _STEP)
    shift = daily * (np.sin(2 * np.pi * time / _DAY) + step)
    return replace(plate, natural_hz=plate.natural_hz * (1 + shift))


@dataclass(eq=False)
class _Stretch:
    """Steps at `start + k * period`; per patch the voltage before and after hysteresis."""

    plate: Plate
    poles: ComplexArray
    """(poles,) of the plate, the laser and the amplifier."""

    start: float
    period: float
    volts: dict[str, FloatArray]
    strain: dict[str, FloatArray]
    begin: dict[str, ComplexArray]
    """Per patch, the state (poles,) at `start`; the last pole is the amplifier's, fed by `volts`."""
    states: dict[str, ComplexArray] = field(default_factory=dict)
    """Per patch (poles, steps), computed when asked for and dropped when old."""

    @property
    def steps(self) -> int:
        return len(next(iter(self.volts.values())))


class Table:
    """A plate with its patches, between the relay's contacts and the laser.

    Patches are fed staircases of the amplifier's output; each is smoothed by the amplifier's pole.
    The laser's own pole is part of the transfer function, its delay is not: ask for earlier times.
    """

    def __init__(self, plate: Plate, hysteresis: float, laser_pole_hz: float = 5000.0) -> None:
        self.plate = plate
        self._amplifier = 2 * np.pi * AMPLIFIER_POLE_HZ
        self._poles = np.concatenate([_poles(plate), [-self._amplifier, 0.0, -self._amplifier]])
        self.laser_pole_hz = laser_pole_hz
        self._hysteresis = {patch: Hysteresis(hysteresis) for patch in plate.patches}
        zero = np.zeros(1)
        rest = dict.fromkeys(plate.patches, zero)
        begin = {patch: np.zeros(len(self._poles), complex) for patch in plate.patches}
        self._decays = (np.zeros(0, complex), np.zeros((0, 0), complex))
        """What `_left` gave last, and poles times period that it is for."""
        self._stretches = deque([_Stretch(plate, self._poles, 0.0, np.inf, rest, rest, begin)])

    @property
    def laser_pole_hz(self) -> float:
        """The pole of the laser's output; to be set before the table has moved."""
        return self._laser / 2 / np.pi

    @laser_pole_hz.setter
    def laser_pole_hz(self, value: float) -> None:
        # Two equal poles would need another formula; a ten-thousandth apart they do not.
        self._laser = 2 * np.pi * value * (1.0001 if value == AMPLIFIER_POLE_HZ else 1.0)
        self._poles[-2] = -self._laser

    def tune(self, plate: Plate) -> None:
        """From the next step on the pane has the modes of this one."""
        self.plate = plate
        self._poles = np.concatenate([_poles(plate), self._poles[-3:]])

    def step(self, start: float, period: float, volts: Mapping[str, FloatArray]) -> None:
        """From `start` on, the amplifier's output at each patch ((steps,) V, all alike in length).

        Each step is held for `period`, the last until the next call; `start` never goes back.
        """
        before = self._stretches[-1]
        rest = np.zeros(len(self._poles), complex)
        begin = {
            p: _settled(self._entering(before, p, start)) if self._moving(before, p) else rest
            for p in self.plate.patches
        }
        strain = {p: self._hysteresis[p].follow(v) for p, v in volts.items()}
        self._stretches.append(_Stretch(self.plate, self._poles, start, period, dict(volts), strain, begin))
        if len(self._stretches) > _CACHED:
            self._stretches[-_CACHED].states.clear()
        while len(self._stretches) > 1 and self._stretches[1].start < start - _REMEMBERED:
            self._stretches.popleft()

    def velocity(self, place: tuple[float, float], times: FloatArray) -> FloatArray:
        """(times,) m/s at a place through the laser's pole, at rising times (s)."""
        out = np.zeros(len(times))
        for stretch, part in self._parts(times):
            for patch in self.plate.patches:
                if self._moving(stretch, patch):
                    residues = self._residues(stretch, patch, place)
                    out[part] += self._seen(stretch, patch, times[part], slice(None, -1), residues)
        return out

    def voltage(self, patch: str, times: FloatArray) -> FloatArray:
        """(times,) V across a patch at rising times (s)."""
        out = np.zeros(len(times))
        own = np.array([self._amplifier], dtype=np.complex128)
        for stretch, part in self._parts(times):
            if self._moving(stretch, patch):
                out[part] = self._seen(stretch, patch, times[part], slice(-1, None), own)
        return out

    def _parts(self, times: FloatArray) -> list[tuple[_Stretch, slice]]:
        starts = np.array([s.start for s in self._stretches])
        starts[0] = -np.inf
        cuts = np.searchsorted(times, starts - 1e-9)
        ends = np.append(cuts[1:], len(times))
        return [(s, slice(a, b)) for s, a, b in zip(self._stretches, cuts, ends, strict=True) if b > a]

    @staticmethod
    def _moving(stretch: _Stretch, patch: str) -> bool:
        return bool(np.any(stretch.begin[patch]) or np.any(stretch.volts[patch]))

    def _residues(self, stretch: _Stretch, patch: str, place: tuple[float, float]) -> ComplexArray:
        """(poles but the last,): partial fractions of amplifier x plate x laser; doubled where a pole has a
        conjugate, so that the real part of the sum is the velocity.
        """
        a, c = self._amplifier, self._laser
        pane = stretch.plate
        strength = pane.shape(place) * pane.coupling(patch)
        w, zeta = 2 * np.pi * pane.natural_hz, pane.damping

        def plate(s: float) -> float:
            return float((strength * s / (s**2 + 2 * zeta * w * s + w**2)).sum())

        s = stretch.poles[: len(w)]
        modal = strength * s / (1j * s.imag) * a / (s + a) * c / (s + c)
        return np.concatenate([modal, [a * plate(-a) * c / (c - a), c * plate(-c) * a / (a - c)]])

    def _since(self, stretch: _Stretch, times: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """The step of a stretch that each time is in, and the seconds since it began."""
        if stretch.steps == 1:
            return np.zeros(len(times), dtype=np.intp), np.maximum(times - stretch.start, 0.0)
        # A sample on the very edge of a step belongs to it, whatever rounding says.
        position = (times - stretch.start) / stretch.period + 1e-3
        index = np.clip(position.astype(np.intp), 0, stretch.steps - 1)
        return index, np.maximum(times - stretch.start - index * stretch.period, 0.0)

    def _entering(self, before: _Stretch, patch: str, start: float) -> ComplexArray:
        """(poles,): the state in which a stretch begins that follows `before`."""
        index, since = self._since(before, np.array([start]))
        poles = before.poles
        decay = np.exp(poles * since)
        held = np.full(len(poles), before.strain[patch][index])
        held[-1] = before.volts[patch][index[0]]
        state = decay * self._states(before, patch)[:, index[0]] + (decay - 1) / poles * held
        if poles is not self._poles:
            # Under the strain that a patch keeps, a pane at rest stays at rest while its modes change.
            state += held / poles - held / self._poles
        return np.asarray(state)

    def _seen(
        self, stretch: _Stretch, patch: str, times: FloatArray, part: slice, weights: ComplexArray
    ) -> FloatArray:
        """(times,): the weighted sum of a part of the states, at times within or after a stretch."""
        index, since = self._since(stretch, times)
        states, poles = self._states(stretch, patch)[part], stretch.poles[part]
        held = (stretch.volts if part.start == -1 else stretch.strain)[patch]
        if np.ptp(since) < 1e-9 and index[-1] - index[0] == len(index) - 1:
            # One sample a step, always as late: the usual case.
            steps = slice(int(index[0]), int(index[-1]) + 1)
            decay = np.exp(poles * since[0])
            push = (weights * (decay - 1) / poles).sum().real
            # As real numbers: BLAS is a hundred times slower at a complex row times a matrix.
            seen = weights * decay
            both = np.array([seen.real, seen.imag]) @ states[:, steps].view(np.float64)
            return np.asarray(both[0, ::2] - both[1, 1::2] + push * held[steps])
        decay = np.exp(poles[:, None] * since)
        push = (weights @ ((decay - 1) / poles[:, None])).real
        return np.asarray((weights @ (decay * states[:, index])).real + push * held[index])

    def _states(self, stretch: _Stretch, patch: str) -> ComplexArray:
        """(poles, steps): the state at each step of a stretch."""
        if patch not in stretch.states:
            begin, poles = stretch.begin[patch], stretch.poles
            states = np.empty((len(poles), stretch.steps), complex)
            states[:, 0] = begin
            strain, volts = stretch.strain[patch], stretch.volts[patch]
            if stretch.steps > 1 and not (np.ptp(strain) or np.ptp(volts)):
                # Nothing changes: it rings out to where these hold it.
                end = -np.append(np.full(len(poles) - 1, strain[0]), volts[0]) / poles
                states[:, :] = end[:, None] + (begin - end)[:, None] * self._left(stretch)
            elif stretch.steps > 1:
                decay = np.exp(poles * stretch.period)
                push = (decay - 1) / poles
                for k, (d, p) in enumerate(zip(decay, push, strict=True)):
                    held = volts if k == len(decay) - 1 else strain
                    states[k, 1:], _ = lfilter([p], [1.0, -d], held[:-1], zi=[d * begin[k]])
            stretch.states[patch] = states
        return stretch.states[patch]

    def _left(self, stretch: _Stretch) -> ComplexArray:
        """(poles, steps): the share of a state that is left at each step, were nothing to hold it."""
        by_step, found = self._decays
        own = stretch.poles * stretch.period
        if found.shape[1] != stretch.steps or not np.array_equal(own, by_step):
            found = np.exp(own[:, None] * np.arange(stretch.steps))
            found[np.abs(found) < _GONE] = 0.0
            self._decays = (own, found)
        return found


def _poles(plate: Plate) -> ComplexArray:
    """(modes,): one of each pair."""
    w = 2 * np.pi * plate.natural_hz
    return np.asarray(w * (-plate.damping + 1j * np.sqrt(1 - plate.damping**2)))


def _settled(state: ComplexArray) -> ComplexArray:
    """A state that has died away is rest: denormal numbers would cost a hundred times the time."""
    return state if np.abs(state).max() > _GONE else np.zeros_like(state)
