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
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

from instruments.arrays import ComplexArray, FloatArray
from mocks.hysteresis import Hysteresis

__all__ = ["Plate", "Table", "make_plate"]

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


@dataclass(eq=False)
class _Stretch:
    """Steps at `start + k * period`; per patch the voltage before and after hysteresis."""

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
        w = 2 * np.pi * plate.natural_hz
        modes = w * (-plate.damping + 1j * np.sqrt(1 - plate.damping**2))
        self._amplifier = 2 * np.pi * AMPLIFIER_POLE_HZ
        self._poles = np.concatenate([modes, [-self._amplifier, 0.0, -self._amplifier]])
        self.laser_pole_hz = laser_pole_hz
        self._hysteresis = {patch: Hysteresis(hysteresis) for patch in plate.patches}
        zero = np.zeros(1)
        rest = dict.fromkeys(plate.patches, zero)
        begin = {patch: np.zeros(len(self._poles), complex) for patch in plate.patches}
        self._stretches = deque([_Stretch(0.0, np.inf, rest, rest, begin)])

    @property
    def laser_pole_hz(self) -> float:
        """The pole of the laser's output; to be set before the table has moved."""
        return self._laser / 2 / np.pi

    @laser_pole_hz.setter
    def laser_pole_hz(self, value: float) -> None:
        # Two equal poles would need another formula; a ten-thousandth apart they do not.
        self._laser = 2 * np.pi * value * (1.0001 if value == AMPLIFIER_POLE_HZ else 1.0)
        self._poles[-2] = -self._laser

    def step(self, start: float, period: float, volts: Mapping[str, FloatArray]) -> None:
        """From `start` on, the amplifier's output at each patch ((steps,) V, all alike in length).

        Each step is held for `period`, the last until the next call; `start` never goes back.
        """
        before, at = self._stretches[-1], np.array([start])
        rest = np.zeros(len(self._poles), complex)
        begin = {
            p: _settled(self._state_at(before, p, at)[:, 0]) if self._moving(before, p) else rest
            for p in self.plate.patches
        }
        strain = {p: self._hysteresis[p].follow(v) for p, v in volts.items()}
        self._stretches.append(_Stretch(start, period, dict(volts), strain, begin))
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
                    state = self._state_at(stretch, patch, times[part])
                    out[part] += (self._residues(patch, place)[:, None] * state).real.sum(axis=0)
        return out

    def voltage(self, patch: str, times: FloatArray) -> FloatArray:
        """(times,) V across a patch at rising times (s)."""
        out = np.zeros(len(times))
        for stretch, part in self._parts(times):
            if self._moving(stretch, patch):
                out[part] = self._amplifier * self._state_at(stretch, patch, times[part])[-1].real
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

    def _residues(self, patch: str, place: tuple[float, float]) -> ComplexArray:
        """(poles,): partial fractions of amplifier x plate x laser; doubled where a pole has a
        conjugate, so that the real part of the sum is the velocity.
        """
        a, c = self._amplifier, self._laser
        strength = self.plate.shape(place) * self.plate.coupling(patch)
        w, zeta = 2 * np.pi * self.plate.natural_hz, self.plate.damping

        def plate(s: float) -> float:
            return float((strength * s / (s**2 + 2 * zeta * w * s + w**2)).sum())

        s = self._poles[: len(w)]
        modal = strength * s / (1j * s.imag) * a / (s + a) * c / (s + c)
        return np.concatenate([modal, [a * plate(-a) * c / (c - a), c * plate(-c) * a / (a - c), 0.0]])

    def _input(self, stretch: _Stretch, patch: str) -> FloatArray:
        """(poles, steps): strain moves the plate, the voltage itself moves the last pole."""
        both = np.broadcast_to(stretch.strain[patch], (len(self._poles), stretch.steps)).copy()
        both[-1] = stretch.volts[patch]
        return both

    def _state_at(self, stretch: _Stretch, patch: str, times: FloatArray) -> ComplexArray:
        """(poles, times): the state at times within or after a stretch."""
        held = self._input(stretch, patch)
        index = np.zeros(len(times), dtype=np.intp)
        if stretch.steps > 1:
            # A sample on the very edge of a step belongs to it, whatever rounding says.
            position = (times - stretch.start) / stretch.period + 1e-3
            index = np.clip(position.astype(np.intp), 0, stretch.steps - 1)
            since = np.maximum(times - stretch.start - index * stretch.period, 0.0)
        else:
            since = np.maximum(times - stretch.start, 0.0)
        states = self._states(stretch, patch, held)
        if len(since) > 1 and np.ptp(since) < 1e-9:
            since = since[:1]
        decay = np.exp(self._poles[:, None] * since)
        return np.asarray(decay * states[:, index] + (decay - 1) / self._poles[:, None] * held[:, index])

    def _states(self, stretch: _Stretch, patch: str, held: FloatArray) -> ComplexArray:
        """(poles, steps): the state at each step of a stretch."""
        if patch not in stretch.states:
            begin = stretch.begin[patch]
            states = np.empty((len(self._poles), stretch.steps), complex)
            states[:, 0] = begin
            if stretch.steps > 1:
                decay = np.exp(self._poles * stretch.period)
                push = ((decay - 1) / self._poles)[:, None] * held[:, :-1]
                for k, d in enumerate(decay):
                    states[k, 1:], _ = lfilter([1.0], [1.0, -d], push[k], zi=[d * begin[k]])
            stretch.states[patch] = states
        return stretch.states[patch]


def _settled(state: ComplexArray) -> ComplexArray:
    """A state that has died away is rest: denormal numbers would cost a hundred times the time."""
    return state if np.abs(state).max() > 1e-30 else np.zeros_like(state)
