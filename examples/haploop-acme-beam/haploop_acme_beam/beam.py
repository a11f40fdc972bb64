"""An Euler-Bernoulli beam with piezo patches glued on, simply supported or clamped at one end.

Natural frequencies w = b^2 sqrt(E I / (rho A)) and mode shapes are those of any textbook of vibrations (Rao,
"Mechanical Vibrations", on lateral vibration of beams). A glued patch that is thin against the beam bends it
by a pair of moments at its ends, M = E_p d31 w (t + t_p) / 2 per volt (Crawley and de Luis, AIAA Journal 25,
1987, for a perfect bond), so it drives a mode by M times the difference of the mode's slopes at these two
ends. The patch's own mass and stiffness, shear and rotary inertia are left out.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator
from scipy.optimize import brentq

from haploop.instruments.config import RigFile
from haploop.mocks.plant import ModalSurface, Modes, PlantSettings

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]

HIGHEST_HZ = 5000.0
"""Modes up to here are simulated."""
PIEZO = 62e9 * 180e-12
"""Young's modulus times d31 of a PZT ceramic (N/(V m); typical figures of data sheets)."""
PATCH_THICKNESS = 0.2e-3


class Beam(PlantSettings):
    """Keys that `[simulation]` takes with `plant = "beam"`, in SI units. The default is a bar of steel."""

    support: Literal["simple", "cantilever"] = "simple"
    length: Positive = 0.325
    width: Positive = 0.04
    thickness: Positive = 3e-3
    modulus: Positive = 200e9
    """Young's modulus (N/m^2)."""
    density: Positive = 7850.0
    damping: Annotated[float, Field(gt=0, lt=1)] = 0.01
    """Damping ratio of every mode."""
    patches: dict[str, Annotated[float, Field(gt=0, lt=1)]] = Field(
        default={"A": 0.25, "B": 0.6, "C": 0.4, "D": 0.85}
    )
    """Centre of each patch, as a fraction of the length."""
    patch_length: Positive = 0.010
    patch_width: Positive = 0.006

    @field_validator("patches")
    @classmethod
    def _some(cls, patches: dict[str, float]) -> dict[str, float]:
        if not patches:
            raise ValueError("name one patch at least")
        return patches

    def make(self, file: RigFile, rng: np.random.Generator) -> ModalSurface:
        """See `PlantSettings.make`. A point of the rig file lies at its column's place along the beam."""
        numbers = self._wave_numbers()
        area, inertia = self.width * self.thickness, self.width * self.thickness**3 / 12
        natural = numbers**2 * np.sqrt(self.modulus * inertia / (self.density * area)) / (2 * np.pi)
        # Unit modal mass.
        scale = 1 / np.sqrt(self.density * area * self.length)
        moment = PIEZO * self.patch_width * (self.thickness + PATCH_THICKNESS) / 2
        half = self.patch_length / 2
        coupling = {}
        for patch, centre in self.patches.items():
            left, right = (self._slopes(numbers, centre * self.length + side) for side in (-half, half))
            coupling[patch] = moment * scale * (right - left)
        return ModalSurface(
            Modes(
                natural_hz=natural,
                damping=np.full(len(numbers), self.damping),
                coupling=coupling,
                shape=lambda place: scale * self._shapes(numbers, place[0] * self.length),
            )
        )

    def _wave_numbers(self) -> np.ndarray:
        """Wave numbers of the modes (1/m)."""
        stiffness = np.sqrt(self.modulus * self.thickness**2 / (12 * self.density))
        highest = np.sqrt(2 * np.pi * HIGHEST_HZ / stiffness) * self.length
        count = int(highest / np.pi) + 1
        if self.support == "simple":
            return np.pi * np.arange(1, count + 1) / self.length
        # cosh(z) cos(z) = -1, one root in each half wave; divided by cosh, which grows without end.
        roots = [
            brentq(lambda z: np.cos(z) + 1 / np.cosh(z), np.pi * k, np.pi * (k + 1), xtol=1e-14)
            for k in range(count)
        ]
        return np.array(roots) / self.length

    def _shapes(self, numbers: np.ndarray, x: float) -> np.ndarray:
        """Mode shapes at x (m), (modes,), whose mean square over the length is one."""
        if self.support == "simple":
            return np.sqrt(2) * np.sin(numbers * x)
        z, end = numbers * x, numbers * self.length
        # cosh - cos - s (sinh - sin), with s near 1: the growing exponentials cancel, so they are left out.
        s = (np.cosh(end) + np.cos(end)) / (np.sinh(end) + np.sin(end))
        return (1 - s) * np.sinh(z) + np.exp(-z) - np.cos(z) + s * np.sin(z)

    def _slopes(self, numbers: np.ndarray, x: float) -> np.ndarray:
        """Slopes of the mode shapes at x (m), (modes,) 1/m."""
        if self.support == "simple":
            return np.sqrt(2) * numbers * np.cos(numbers * x)
        z, end = numbers * x, numbers * self.length
        s = (np.cosh(end) + np.cos(end)) / (np.sinh(end) + np.sin(end))
        return numbers * ((1 - s) * np.cosh(z) - np.exp(-z) + np.sin(z) + s * np.cos(z))
