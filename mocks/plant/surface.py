"""A surface: whatever moves between the patches and the laser's spot; the plants of packages are made of it.

The plant around it (amplifier, relay, the patches' hysteresis, laser, converters) is the same for every
surface. A package adds a surface by an entry point of the group `haploop.plants`; a script gives an object
to `open_rig`. See docs/how-to/adding-a-plant.md.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray
from ...base.bounded import Strict
from ...base.errors import ConfigurationError
from ...instruments.config import RigFile, TableSettings
from ...instruments.vibrometer import Quantity
from .hysteresis import Hysteresis, PatchLaw

AMPLIFIER_POLE_HZ = 5000.0
"""Bandwidth of an amplifier whose rig file tells none (docs/hardware.md, "Amplifier"): the pole between its
staircase and the patch."""
REMEMBERED = 30.0
"""Past for which a surface can be read (s)."""
_FINE, _SETTLED = 8, 12.0
"""Samples per time constant, and time constants before the first sample, of the laser's low-pass."""


@dataclass(frozen=True)
class Contact:
    """A body that rests on a surface: a mass behind a spring and a damper, at one place.

    Its force on the surface is stiffness x (u - x) + damping x (u' - x');
    u is the surface's displacement, x the body's, both from where they rest.
    """

    name: str
    """Which body it is: one that stays, with another stiffness, goes on moving as it did."""
    place: tuple[float, float]
    """Fractions of the surface's width and height."""
    stiffness: float
    """N/m."""
    damping: float
    """N s/m."""
    mass: float
    """kg."""


class Surface(ABC):
    """A surface with its patches. Places are fractions of its width and height, times are in seconds.

    Everything starts at rest, at zero volts.
    """

    patches: tuple[str, ...]
    """Names of the patches. They must include those of the rig file."""
    laser_pole_hz: float = 5000.0
    """Bandwidth of the laser that looks at it (Hz): set when a laser is installed, before the first step."""
    amplifier_pole_hz: float = AMPLIFIER_POLE_HZ
    """Bandwidth of the amplifier (Hz): set before the first step."""
    coil_pole_hz: float | None = None
    """Corner of the current of the coils that drive it (Hz): R / (2 pi L); None for piezo patches, and for
    coils without an inductance. Set before the first step."""

    @abstractmethod
    def step(self, start: float, period: float, volts: Mapping[str, FloatArray]) -> None:
        """Apply linear volts at each patch, (steps,) V of equal length, from `start` (s) on.

        Each step is held for `period` (s), the last until the next call; `start` never decreases. The
        staircase reaches a patch through the amplifier's pole, `amplifier_pole_hz`, and drives a coil through
        `coil_pole_hz` as well.
        """

    @abstractmethod
    def velocity(self, place: tuple[float, float], times: FloatArray) -> FloatArray:
        """Return the surface's own velocity at a place, (times,) m/s, at rising times (s).

        Times may lie up to `REMEMBERED` before the last step, and after it.
        """

    @abstractmethod
    def response(
        self, patch: str, place: tuple[float, float], frequencies: FloatArray, time: float
    ) -> ComplexArray:
        """Return the response for small motion, (frequencies,) m/s per linear volt, as it is at `time` (s).

        It contains no amplifier and no laser. It is the truth that tests and reports show; nothing else
        reads it.
        """

    def seen(self, place: tuple[float, float], times: FloatArray) -> FloatArray:
        """Return the velocity behind the laser's pole, (times,) m/s, at rising times (s).

        This one samples `velocity` eight times per time constant and filters the straight lines between
        the samples exactly; a surface that knows better overrides it.
        """
        pole = 2 * np.pi * self.laser_pole_hz
        period = 1 / (_FINE * pole)
        begin = float(times[0]) - _SETTLED / pole
        grid = begin + period * np.arange(int(np.ceil((float(times[-1]) - begin) / period)) + 1)
        moving = self.velocity(place, np.asarray(grid))
        # The exact response of a first-order low-pass to straight lines between samples.
        decay = np.exp(-pole * period)
        now, before = 1 - (1 - decay) / (pole * period), (1 - decay) / (pole * period) - decay
        passed = scipy.signal.lfilter([now, before], [1.0, -decay], moving)
        return np.asarray(np.interp(times, grid, passed))

    def shows(self, quantity: Quantity, high_pass_hz: float) -> None:
        """Let `seen` return this quantity (SI) behind a high-pass too. Called before the first step.

        The default knows velocity without a high-pass only. Raises ConfigurationError.
        """
        if quantity != "velocity" or high_pass_hz:
            raise ConfigurationError(
                f"This plant shows no {quantity} behind a high-pass of {high_pass_hz:g} Hz: simulate with a "
                "plant that is described by modes, or with a vibrometer that shows velocity."
            )

    def load(self, place: tuple[float, float], mass: float) -> None:
        """Let a mass (kg) that is glued to a place move with the surface, from now on, and no other.

        The default leaves the surface as it is.
        """
        return

    def touched(self, contacts: Sequence[Contact]) -> None:
        """Let these bodies rest on the surface, from the next step on, and no others.

        The default knows no bodies. Raises ConfigurationError.
        """
        raise ConfigurationError(
            "Nothing can rest on this plant's surface: simulate the plant 'table', or without a finger."
        )

    def resonance_hz(self, patch: str, place: tuple[float, float], time: float) -> float:
        """Return the frequency of a patch's largest response at a place, 20 Hz to 1 kHz, at `time` (s)."""
        low, high = 20.0, 1000.0
        for count in (9801, 401, 401):
            grid = np.linspace(low, high, count)
            peak = int(np.abs(self.response(patch, place, grid, time)).argmax())
            low, high = grid[max(peak - 1, 0)], grid[min(peak + 1, count - 1)]
        return float((low + high) / 2)


class PlantSource(ABC):
    """A plant as an object that `open_rig(plant=...)` takes: it makes a new surface for each rig."""

    @abstractmethod
    def make(self, file: RigFile, rng: np.random.Generator) -> Surface:
        """Return a new surface at rest for a rig file. `rng` is the surface's own, from the rig's seed."""

    def law(self, patch: str, file: RigFile) -> PatchLaw:
        """Return the law of a patch, at rest: by default the rig file's `hysteresis`, and none of a coil."""
        coil = file.actuator is not None and file.actuator.kind == "coil"
        return Hysteresis(0.0 if coil else file.simulation.hysteresis)


class PlantSettings(Strict, PlantSource):
    """A plant's own keys of `[simulation]`, as a pydantic model that makes its surface.

    An entry point of the group `haploop.plants` names a subclass.
    """


def table_of(file: RigFile) -> TableSettings:
    """Return the `[table]` of a rig file, or the default one."""
    return file.table or TableSettings(button_point=20)


def place_of(file: RigFile, point: str) -> tuple[float, float]:
    """Return the place of a rig file's point ("button" or its number), as fractions of width and height."""
    table = table_of(file)
    index = table.button_point if point == "button" else int(point)
    row, column = divmod(index, table.columns)
    return (column + 0.5) / table.columns, (row + 0.5) / table.rows
