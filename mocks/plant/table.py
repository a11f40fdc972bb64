"""The touch table, haploop's own surface: a simply supported pane of soda-lime glass with four patches.

Geometry and damping are estimates (docs/hardware.md, "Touch table"): 0.50 x 0.35 m, of the thickness that
puts its (2, 2) mode at the paper's 263.5 Hz.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Annotated

import numpy as np
from pydantic import Field

from ...base.arrays import FloatArray, IntArray
from ...base.bounded import Positive
from ...instruments.config import Actuator, RigFile
from .modal import Modes
from .modal_surface import ModalSurface, SofteningSurface
from .surface import PlantSettings, place_of

WIDTH, HEIGHT = 0.50, 0.35
PATCH_WIDTH, PATCH_HEIGHT = 0.050, 0.030
"""Size of the ceramic of a P-876.A12 (m; found; docs/hardware.md, "Patches")."""
MAIN_HZ = 263.5
HIGHEST_HZ = 10_000.0
"""Highest mode by default (236 of them): an octave above the corner of the laser's filter."""
FEWEST_HZ = 3.2 * MAIN_HZ
"""Lowest choice of the highest mode (17 of them): those above the band of drives add stiffness within it."""


def _curvature(m: int, n: int) -> float:
    return (m / WIDTH) ** 2 + (n / HEIGHT) ** 2


def modes_to(highest_hz: float) -> list[tuple[int, int]]:
    """Half waves along width and height of each mode up to a frequency (Hz), rising.

    A pane has as many modes in each band of frequencies: 17 up to 843 Hz, 116 to 5 kHz, 236 to 10 kHz.
    """
    per_hz = _curvature(2, 2) / MAIN_HZ
    most = int(WIDTH * (highest_hz * per_hz) ** 0.5) + 1
    found = ((m, n) for m in range(1, most + 1) for n in range(1, most + 1))
    return sorted(
        (mode for mode in found if _curvature(*mode) < highest_hz * per_hz),
        key=lambda mode: _curvature(*mode),
    )


MODES = modes_to(FEWEST_HZ)
MAIN = MODES.index((2, 2))
_DAMPED_TO = 1.05 * FEWEST_HZ
"""Frequency (Hz) up to which the damping ratio rises; above it, it stays at 2.6 % (estimate: a mounted pane's
loss factor, 1 to 6 %, hardly depends on the frequency)."""
PATCHES = {"A": (0.20, 0.15), "B": (0.62, 0.93), "C": (0.08, 0.45), "D": (0.92, 0.55)}
"""Centres of the patches, as fractions of width and height, near the edges; A drives the main mode best
(estimate)."""
MAIN_VELOCITY = 5.0e-3 / 50
"""Velocity at the main mode's antinode (m/s per V): 3 um of displacement at 50 V (estimate;
docs/hardware.md, "Touch table")."""
PANE_MASS = 0.96
"""Mass of the pane (kg), whose thickness of 2.2 mm follows from MAIN_HZ; a quarter of it is every mode's."""
SOFT_AT = 3e-6
"""Displacement at which `softening` is meant (m)."""
_DAY = 86_400.0
_STEP_EVERY, _STEP = 3 * 3600.0, 0.1
"""Interval (s) of temperature steps (a door, a window, a heater), and the largest step as a fraction of the
daily amplitude (estimates)."""
_TUNED = 10.0
"""Interval at which the modes are updated for the temperature (s): at a drift of 1 % per day they have moved
by less than a millionth."""


class TouchTable(PlantSettings):
    """The default plant: see the module."""

    mode_drift: Annotated[float, Field(strict=True, gt=-0.5, lt=0.5)] = 0.0
    """Relative shift e of every mode's frequency, at equal mass and damping ratio, as the day's: modal forces
    per volt stay, so that velocity at a resonance falls by 1 + e, and displacement at rest by (1 + e)^2."""
    daily_drift: Annotated[float, Field(strict=True, ge=0, lt=0.1)] = 0.0
    """Relative amplitude of the daily drift of every mode's frequency, caused by temperature."""
    damping_scale: Positive = 1.0
    highest_hz: Annotated[float, Field(ge=FEWEST_HZ, le=12_000)] = HIGHEST_HZ
    """Highest mode (Hz)."""
    collocated: bool = False
    """Put patch A under the button point, so that the response has no right-half-plane zeros."""

    pane_mass: Annotated[float, Field(strict=True, ge=0.01, le=100)] = PANE_MASS
    """Mass of the pane (kg): what a finger, a palm or a glued body is to it. Its frequencies, and its motion
    by patches, stay as they are."""

    softening: Annotated[float, Field(strict=True, ge=0, lt=0.2)] = 0.0
    """Relative fall of a mode's frequency at a displacement of 3 um: see `modal_surface`."""

    def make(self, file: RigFile, rng: np.random.Generator) -> ModalSurface:
        """See `PlantSettings.make`."""
        under = place_of(file, "button") if self.collocated else None
        plate = make_plate(rng, self.mode_drift, self.damping_scale, under, self.highest_hz)
        plate = replace(plate, masses=np.full(len(plate.natural_hz), self.pane_mass / 4))
        if file.actuator is not None and file.actuator.kind == "coil":
            plate = with_coils(plate, file.actuator, under)
        seed, daily = file.simulation.seed, self.daily_drift
        every = _TUNED if daily else np.inf
        modes = (lambda time: warmed(plate, time, daily, seed)) if daily else plate
        if self.softening:
            return SofteningSurface(modes, self.softening, SOFT_AT, every)
        return ModalSurface(modes, every)


def make_plate(
    rng: np.random.Generator,
    drift: float = 0.0,
    damping_scale: float = 1.0,
    collocated_at: tuple[float, float] | None = None,
    highest_hz: float = HIGHEST_HZ,
) -> Modes:
    """Create the modes of a table; frequencies and damping scatter with `rng`, as mounting and glass vary.

    The scatter and the damping law are estimates (docs/hardware.md, "Touch table").
    """
    waves = np.array(modes_to(highest_hz))
    m, n = waves.T
    curvature, lowest, more = (m / WIDTH) ** 2 + (n / HEIGHT) ** 2, len(MODES), len(waves) - len(MODES)
    scatter, spread = rng.normal(0, 0.02, lowest), np.ones(len(waves))
    main = rng.normal(0, 0.0015)
    spread[:lowest] = rng.uniform(0.9, 1.1, lowest)
    # The lowest modes come first, so that a seed's are the same with more above them.
    scatter = np.concatenate([scatter, rng.normal(0, 0.02, more)]).clip(-0.05, 0.05)
    scatter[MAIN], spread[lowest:] = main, rng.uniform(0.9, 1.1, more)
    natural = MAIN_HZ * curvature / curvature[MAIN] * (1 + scatter)
    damping = (0.004 + 0.000025 * np.minimum(natural, _DAMPED_TO)) * spread
    # The gain is set for the nominal damping and patch position, so that a damped table moves less.
    strength = np.abs(_coupling(waves, PATCHES["A"])[MAIN]) / (4 * np.pi * damping[MAIN] * natural[MAIN])
    gain = MAIN_VELOCITY / strength
    patches = dict(PATCHES) if collocated_at is None else {**PATCHES, "A": collocated_at}
    coupling = {patch: gain * _coupling(waves, place) for patch, place in patches.items()}
    masses = np.full(len(waves), PANE_MASS / 4)
    damping = np.minimum(damping * damping_scale, 0.3)
    return Modes(natural * (1 + drift), damping, coupling, partial(_shape, waves), MAIN, masses)


def with_coils(plate: Modes, actuator: Actuator, collocated_at: tuple[float, float] | None) -> Modes:
    """Return a table that coils at the patches' places push, instead of patches that bend it.

    Newtons are the force factor times the current, at one point; behind the corner of the current, which the
    surface applies (`Surface.coil_pole_hz`). A coil that moves makes a voltage against the amplifier's: the
    damping that it adds is that of its resistance, mode by mode.
    """
    assert actuator.resistance
    factor = 1.0 if actuator.force_factor is None else actuator.force_factor
    places = dict(PATCHES) if collocated_at is None else {**PATCHES, "A": collocated_at}
    pushed = {patch: plate.shape(place) for patch, place in places.items()}
    assert plate.masses is not None
    mass = plate.masses[0]
    coupling = {patch: factor / actuator.resistance / mass * shape for patch, shape in pushed.items()}
    # Only the coil of a patch that is connected brakes, and which that is changes: the first one's is taken.
    braking = factor**2 / actuator.resistance * next(iter(pushed.values())) ** 2 / mass
    damping = plate.damping + braking / (2 * 2 * np.pi * plate.natural_hz)
    # A push drives the lowest mode best, and no mode is meant to carry buttons.
    return replace(plate, coupling=coupling, damping=np.minimum(damping, 0.3), main=None)


def _shape(waves: IntArray, place: tuple[float, float]) -> FloatArray:
    """Return the mode shapes at a position (fractions of width and height), (modes,): 1 at antinodes."""
    m, n = waves.T
    return np.asarray(np.sin(np.pi * m * place[0]) * np.sin(np.pi * n * place[1]))


def _coupling(waves: IntArray, place: tuple[float, float]) -> FloatArray:
    """Return the modal force per volt of a patch at a position, (modes,), at a gain of 1.

    A patch bends the pane, so it couples to the curvature averaged over its area.
    """
    m, n = waves.T
    curvature = (m / WIDTH) ** 2 + (n / HEIGHT) ** 2
    average = np.sinc(m * PATCH_WIDTH / WIDTH / 2) * np.sinc(n * PATCH_HEIGHT / HEIGHT / 2)
    return np.asarray(curvature * average * _shape(waves, place))


def warmed(modes: Modes, time: float, daily: float, seed: int) -> Modes:
    """Return the modes at a time (s): each frequency drifts over the day by +-`daily` (relative), with steps.

    The drift is a sine that starts at zero; damping ratios and forces stay constant.
    """
    step = np.random.default_rng([seed, 0xDA1, int(max(time, 0.0) / _STEP_EVERY)]).uniform(-_STEP, _STEP)
    shift = daily * (np.sin(2 * np.pi * time / _DAY) + step)
    return replace(modes, natural_hz=modes.natural_hz * (1 + shift))
