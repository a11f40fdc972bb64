"""A plant that is told mode by mode, and random ones of it: to try estimators on surfaces of every kind."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from ...base.arrays import FloatArray
from ...base.bounded import Finite, Positive, Proportion
from ...base.errors import ConfigurationError
from ...instruments.config import RigFile
from .modal import Modes
from .modal_surface import ModalSurface, SofteningSurface
from .surface import PlantSettings, place_of, table_of

_PEAK = 1e-4
"""Largest response of a random plant's first patch at the button, 60 to 600 Hz (m/s per V): the table's."""


class Modal(PlantSettings):
    """Modes, one by one: q'' + 2 damping w q' + w^2 q = coupling x linear volts, with unit modal mass."""

    natural_hz: tuple[Positive, ...]
    """Natural frequency of each mode (Hz)."""
    damping: tuple[Proportion, ...]
    """Damping ratio of each mode."""
    coupling: dict[str, tuple[Finite, ...]]
    """Modal force of each patch (m/s^2 per V), a number for each mode."""
    shapes: dict[str, tuple[Finite, ...]]
    """Mode shapes at each point, "button" or a point's number: a number for each mode."""

    masses: tuple[Positive, ...] | None = None
    """Mass of each mode (kg) where its shape is 1; without them nothing can rest on the surface."""
    softening: Annotated[float, Field(strict=True, ge=0, lt=0.2)] = 0.0
    """Relative fall of a mode's frequency when its coordinate is `soft_at`."""
    soft_at: Positive = 3e-6
    """Amplitude of a mode's coordinate (m) at which `softening` is meant."""

    @model_validator(mode="after")
    def _one_number_a_mode(self) -> Modal:
        lists = {"damping": self.damping}
        if self.masses is not None:
            lists["masses"] = self.masses
        lists |= {f"coupling.{patch}": values for patch, values in self.coupling.items()}
        lists |= {f"shapes.{point}": values for point, values in self.shapes.items()}
        for name, values in lists.items():
            if len(values) != len(self.natural_hz) or not values:
                raise ValueError(
                    f"{name} has {len(values)} numbers, and natural_hz has {len(self.natural_hz)}: give "
                    "one for each mode, and one mode at least"
                )
        return self

    def make(self, file: RigFile, rng: np.random.Generator) -> ModalSurface:
        """See `PlantSettings.make`."""
        table = table_of(file)
        known = {place_of(file, point): np.array(values) for point, values in self.shapes.items()}
        points = {place_of(file, str(n)): str(n) for n in range(table.rows * table.columns)}
        coupling = {patch: np.array(values) for patch, values in self.coupling.items()}
        shape = _Shape(known, points)
        masses = None if self.masses is None else np.array(self.masses)
        modes = Modes(np.array(self.natural_hz), np.array(self.damping), coupling, shape, masses=masses)
        if self.softening:
            return SofteningSurface(modes, self.softening, self.soft_at)
        return ModalSurface(modes)


@dataclass(frozen=True, eq=False)
class _Shape:
    known: Mapping[tuple[float, float], FloatArray]
    points: Mapping[tuple[float, float], str]

    def __call__(self, place: tuple[float, float]) -> FloatArray:
        if place not in self.known:
            raise ConfigurationError(
                f"The plant 'modal' has no shapes at the point {self.points.get(place, place)}: add it to "
                "`shapes`, or aim at another point."
            )
        return self.known[place]


def random_modal(
    rng: np.random.Generator,
    modes: int | None = None,
    damping: tuple[float, float] = (0.002, 0.05),
    close_pairs: int | None = None,
) -> Modal:
    """Draw a plant: 6 to 60 modes from 50 Hz to 2.5 kHz, with damping ratios drawn between two limits.

    `close_pairs` of the modes (0 to 3 if None) lie within half to three half-widths of another one. The
    largest response of patch A at the button, 60 to 600 Hz, is 1e-4 m/s per V, which is the table's.
    """
    count = int(rng.integers(6, 61)) if modes is None else modes
    natural = np.sort(np.exp(rng.uniform(np.log(50), np.log(2500), count)))
    # One mode in the middle of the band at least, or there is nothing to play on.
    natural[np.abs(natural - 250).argmin()] = rng.uniform(150, 400)
    ratios = np.exp(rng.uniform(np.log(damping[0]), np.log(damping[1]), count))
    pairs = int(rng.integers(0, 4)) if close_pairs is None else close_pairs
    for k in rng.choice(count, 2 * min(pairs, count // 2), replace=False).reshape(-1, 2):
        half_width = ratios[k[0]] * natural[k[0]]
        natural[k[1]] = natural[k[0]] + rng.choice([-1, 1]) * rng.uniform(0.5, 3) * half_width
    coupling = {patch: rng.standard_normal(count) * natural for patch in "ABCD"}
    shape = rng.uniform(-1, 1, count)
    band = np.arange(60.0, 600.0, 0.1)
    drawn = Modes(natural, ratios, coupling, lambda _place: shape)
    gain = _PEAK / float(np.abs(drawn.velocity("A", (0.0, 0.0), band)).max())
    return Modal(
        natural_hz=tuple(natural.tolist()),
        damping=tuple(ratios.tolist()),
        coupling={patch: tuple((gain * force).tolist()) for patch, force in coupling.items()},
        shapes={"button": tuple(shape.tolist())},
    )
