"""The touch table: a plate as a sum of modes, driven by piezo patches and measured by a laser.

The solution is exact at any time: every drive is a staircase, so the state of each pole has a closed form
from its state at the last step. There is no numerical integration and no step size to choose, and a
channel that a multiplexed card samples 14 us late is evaluated 14 us later.

Geometry and damping are estimates (docs/hardware.md, "Touch table"): a simply supported pane of soda-lime
glass, 0.50 x 0.35 m, of the thickness that puts its (2, 2) mode at the paper's 263.5 Hz.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from haploop.instruments.arrays import ComplexArray, FloatArray
from haploop.mocks.plant.hysteresis import Hysteresis
from haploop.mocks.plant.poles import Poles, Stretch

__all__ = ["Plate", "TouchTable", "make_plate", "warmed"]

WIDTH, HEIGHT = 0.50, 0.35
PATCH_WIDTH, PATCH_HEIGHT = 0.050, 0.030
"""Size of the ceramic of a P-876.A12 (m; found; docs/hardware.md, "Patches")."""
MAIN_HZ = 263.5
_HIGHEST = 3.2
"""Highest mode, as a multiple of the main mode: modes above the band add stiffness within it."""


def _curvature(m: int, n: int) -> float:
    return (m / WIDTH) ** 2 + (n / HEIGHT) ** 2


MODES = sorted(
    ((m, n) for m in range(1, 9) for n in range(1, 9) if _curvature(m, n) < _HIGHEST * _curvature(2, 2)),
    key=lambda mode: _curvature(*mode),
)
MAIN = MODES.index((2, 2))
PATCHES = {"A": (0.20, 0.15), "B": (0.62, 0.93), "C": (0.08, 0.45), "D": (0.92, 0.55)}
"""Centres of the patches, as fractions of width and height, near the edges; A drives the main mode best
(docs/hardware.md, "Touch table")."""
MAIN_VELOCITY = 5.0e-3 / 50
"""Velocity at the main mode's antinode (m/s per V): 3 um of displacement at 50 V (estimate;
docs/hardware.md, "Touch table")."""
AMPLIFIER_POLE_HZ = 5000.0
"""Bandwidth of the amplifier (docs/hardware.md, "Amplifier")."""
_REMEMBERED = 30.0
"""Past for which the table can be read (s)."""
_DAY = 86_400.0
_STEP_EVERY, _STEP = 3 * 3600.0, 0.1
"""Interval (s) of temperature steps (a door, a window, a heater), and the largest step as a fraction of the
daily amplitude (estimates)."""


@dataclass(frozen=True, eq=False)
class Plate:
    """Modes of one pane: `natural_hz` and `damping` are (modes,); mode shapes are functions of position."""

    natural_hz: FloatArray
    damping: FloatArray
    gain: float
    patches: Mapping[str, tuple[float, float]]

    def shape(self, place: tuple[float, float]) -> FloatArray:
        """Return the mode shapes at a position (fractions of width and height), (modes,): 1 at antinodes."""
        m, n = np.array(MODES).T
        return np.asarray(np.sin(np.pi * m * place[0]) * np.sin(np.pi * n * place[1]))

    def coupling(self, patch: str) -> FloatArray:
        """Return the modal force per volt, (modes,).

        A patch bends the pane, so it couples to the curvature averaged over its area.
        """
        m, n = np.array(MODES).T
        curvature = (m / WIDTH) ** 2 + (n / HEIGHT) ** 2
        average = np.sinc(m * PATCH_WIDTH / WIDTH / 2) * np.sinc(n * PATCH_HEIGHT / HEIGHT / 2)
        return np.asarray(self.gain * curvature * average * self.shape(self.patches[patch]))

    def velocity(self, patch: str, place: tuple[float, float], frequencies: FloatArray) -> ComplexArray:
        """Return the true response at a position (m/s per V at the patch), at `frequencies` (Hz)."""
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
    """Create a table; frequencies and damping scatter with `rng`, as mounting and glass vary.

    The scatter and the damping law are estimates (docs/hardware.md, "Touch table").
    """
    m, n = np.array(MODES).T
    curvature = (m / WIDTH) ** 2 + (n / HEIGHT) ** 2
    scatter = rng.normal(0, 0.02, len(MODES)).clip(-0.05, 0.05)
    scatter[MAIN] = rng.normal(0, 0.0015)
    natural = MAIN_HZ * curvature / curvature[MAIN] * (1 + scatter) * (1 + drift)
    damping = (0.004 + 0.000025 * natural) * rng.uniform(0.9, 1.1, len(MODES))
    patches = dict(PATCHES)
    # The gain is set for the nominal damping and patch position, so that a damped table moves less.
    nominal = Plate(natural, damping, 1.0, patches)
    strength = np.abs(nominal.coupling("A")[MAIN]) / (4 * np.pi * damping[MAIN] * natural[MAIN])
    if collocated_at is not None:
        patches["A"] = collocated_at
    return Plate(natural, np.minimum(damping * damping_scale, 0.3), MAIN_VELOCITY / strength, patches)


def warmed(plate: Plate, time: float, daily: float, seed: int) -> Plate:
    """Return the plate at a time (s): each frequency drifts over the day by +-`daily` (relative), with steps.

    The drift is a sine that starts at zero; damping ratios and forces stay constant.
    """
    step = np.random.default_rng([seed, 0xDA1, int(max(time, 0.0) / _STEP_EVERY)]).uniform(-_STEP, _STEP)
    shift = daily * (np.sin(2 * np.pi * time / _DAY) + step)
    return replace(plate, natural_hz=plate.natural_hz * (1 + shift))


@dataclass(frozen=True, eq=False)
class _Pane:
    """A plate between amplifier and laser, as poles driven by the linear volts and the volts of all patches.

    There are the poles of the modes, an amplifier and a laser pole for each patch's linear volts, and an
    amplifier pole for each patch's volts.
    """

    plate: Plate
    poles: Poles
    amplifier: float
    laser: float
    """Poles of amplifier and laser (rad/s)."""
    _weights: dict[tuple[tuple[float, float], bool], ComplexArray] = field(default_factory=dict)

    @classmethod
    def of(cls, plate: Plate, amplifier: float, laser: float) -> _Pane:
        w, zeta = 2 * np.pi * plate.natural_hz, plate.damping
        modes = w * (-zeta + 1j * np.sqrt(1 - zeta**2))
        count, patches = len(modes), len(plate.patches)
        poles = np.concatenate([modes, [-amplifier, -laser] * patches, [-amplifier] * patches])
        inputs = np.zeros((len(poles), 2 * patches))
        for i, patch in enumerate(plate.patches):
            inputs[:count, i] = plate.coupling(patch)
            inputs[count + 2 * i : count + 2 * i + 2, i] = 1.0
            inputs[count + 2 * patches + i, patches + i] = 1.0
        return cls(plate, Poles(poles, inputs), amplifier, laser)

    def velocity(self, place: tuple[float, float], measured: bool = True) -> ComplexArray:
        """Return the partial fractions of amplifier x plate, (poles,), and x laser if `measured`.

        They are doubled for a pole with a conjugate, so that the real part of the sum is the velocity.
        """
        key = place, measured
        if key not in self._weights:
            a, c, plate = self.amplifier, self.laser, self.plate
            shape = plate.shape(place)
            w, count, patches = 2 * np.pi * plate.natural_hz, len(shape), len(plate.patches)
            s = self.poles.poles[:count]
            own = np.zeros(len(self.poles.poles), dtype=np.complex128)
            own[:count] = shape * s / (1j * s.imag) * a / (s + a)
            shares = [(-a, a)]
            if measured:
                own[:count] *= c / (s + c)
                shares = [(-a, a * c / (c - a)), (-c, c * a / (a - c))]
            for at, share in shares:
                modal = shape * at / (at**2 + 2 * plate.damping * w * at + w**2)
                own[count + (at == -c) : -patches : 2] = share * (modal @ self.poles.inputs[:count, :patches])
            self._weights[key] = own
        return self._weights[key]

    def voltage(self, patch: str) -> ComplexArray:
        """Return the weights that give a patch's voltage, (poles,)."""
        own = np.zeros(len(self.poles.poles), dtype=np.complex128)
        own[list(self.plate.patches).index(patch) - len(self.plate.patches)] = self.amplifier
        return own


class TouchTable:
    """A plate with its patches, between the relay's contacts and the laser.

    The patches get staircases of the amplifier's output, smoothed by the amplifier's pole. The transfer
    function includes the laser's pole but not its delay: for the delay, read at earlier times.
    """

    def __init__(self, plate: Plate, hysteresis: float, laser_pole_hz: float = 5000.0) -> None:
        self._laser_pole_hz = laser_pole_hz
        self._hysteresis = {patch: Hysteresis(hysteresis) for patch in plate.patches}
        self.tune(plate)
        rest = np.zeros((2 * len(plate.patches), 1))
        self._stretches = deque([(self._pane, Stretch(self._pane.poles, 0.0, np.inf, rest))])

    @property
    def plate(self) -> Plate:
        """The plate in effect from the next step on."""
        return self._pane.plate

    @property
    def laser_pole_hz(self) -> float:
        """Bandwidth of the laser's output (Hz)."""
        return self._laser_pole_hz

    @laser_pole_hz.setter
    def laser_pole_hz(self, value: float) -> None:
        self._laser_pole_hz = value
        self.tune(self.plate)

    def tune(self, plate: Plate) -> None:
        """Use the modes of `plate` from the next step on."""
        # Equal poles would need another formula; shift one of them by a ten-thousandth.
        apart = 1.0001 if self._laser_pole_hz == AMPLIFIER_POLE_HZ else 1.0
        self._pane = _Pane.of(plate, 2 * np.pi * AMPLIFIER_POLE_HZ, 2 * np.pi * self._laser_pole_hz * apart)

    def step(self, start: float, period: float, volts: Mapping[str, FloatArray]) -> None:
        """Apply the amplifier's output at each patch, (steps,) V of equal length, from `start` (s) on.

        Each step is held for `period` (s), the last until the next call; `start` never decreases.
        """
        applied = [volts[patch] for patch in self.plate.patches]
        hysteresis = [self._hysteresis[patch] for patch in self.plate.patches]
        linear_volts = [h.follow(v) for h, v in zip(hysteresis, applied, strict=True)]
        before = self._stretches[-1][1]
        stretch = Stretch(self._pane.poles, start, period, np.array([*linear_volts, *applied]), before)
        self._stretches.append((self._pane, stretch))
        while len(self._stretches) > 1 and self._stretches[1][1].start < start - _REMEMBERED:
            self._stretches.popleft()

    def velocity(self, place: tuple[float, float], times: FloatArray) -> FloatArray:
        """Return the velocity at a position behind the laser's pole, (times,) m/s, at rising times (s)."""
        return self._seen(times, lambda pane: pane.velocity(place))

    def true_velocity(self, place: tuple[float, float], times: FloatArray) -> FloatArray:
        """Return the surface's own velocity at a position, (times,) m/s, at rising times (s).

        Raises ValueError for times that are no longer remembered.
        """
        if len(times) and times[0] < self._stretches[0][1].start:
            raise ValueError(
                f"The table's motion at {times[0]:.3f} s is no longer remembered: ask for times at most "
                f"{_REMEMBERED:.0f} s before the last output step."
            )
        return self._seen(times, lambda pane: pane.velocity(place, measured=False))

    def voltage(self, patch: str, times: FloatArray) -> FloatArray:
        """Return the voltage across a patch, (times,) V, at rising times (s)."""
        return self._seen(times, lambda pane: pane.voltage(patch))

    def _seen(self, times: FloatArray, weights: Callable[[_Pane], ComplexArray]) -> FloatArray:
        out, end = np.zeros(len(times)), len(times)
        for pane, stretch in reversed(self._stretches):
            first = int(np.searchsorted(times, stretch.start - 1e-9))
            if stretch is self._stretches[0][1]:
                first = 0
            if first < end:
                out[first:end] = stretch.seen(times[first:end], weights(pane))
                end = first
            if not end:
                break
        return out
