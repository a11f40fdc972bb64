"""A force-travel curve of a switch, measured slowly: its rows, and the points that were found on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import scipy

from ...base import hdf5
from ...base.arrays import FloatArray
from ...base.errors import DataError
from ...base.notebook import InNotebook

FEWEST = 20
"""Rows of a stroke that show a curve."""


@dataclass(frozen=True)
class Point:
    """A place on a curve: travel (m) and force (N)."""

    travel: float
    force: float


@dataclass(frozen=True, eq=False)
class Curve(InNotebook):
    """Force over travel, row by row, and the points on it; None for what it does not show."""

    button: str
    """As told; the file's name where nobody said."""
    source: str
    """Name of the file that it was read from, and the SHA-256 of its bytes."""
    source_sha256: str
    units: Mapping[str, str]
    """By role: what the file's column was in."""
    notes: tuple[str, ...]
    """Sentences on how the file was read."""
    simulated: bool
    travel: FloatArray
    """(rows,) m."""
    force: FloatArray
    """(rows,) N."""
    contact: FloatArray
    """(rows,) 1 where the switch is closed; empty without a column of it."""
    turn: int
    """Row of the largest travel, the last one of the way down."""
    peak: Point | None
    """Of the tactile fall on the way down, and its trough."""
    trough: Point | None
    bottom: Point | None
    """Where the switch bottoms out."""
    operates: Point | None
    """Where the contact closes on the way down, and opens on the way up."""
    resets: Point | None

    def refuse_nonsense(self) -> None:
        """Raise DataError for rows that do not fit together."""
        rows = len(self.travel)
        if not (
            self.travel.shape == self.force.shape == (rows,)
            and self.contact.shape in ((0,), (rows,))
            and 0 <= self.turn < rows
            and np.isfinite(self.travel).all()
            and np.isfinite(self.force).all()
        ):
            raise DataError("its travel, force and contact do not fit together.")

    def __repr__(self) -> str:
        mark = ", simulated" if self.simulated else ""
        return f"<Curve {self.button}: {len(self.travel)} rows to {1e3 * self.end.travel:.3f} mm{mark}>"

    def save(self, path: str | Path) -> None:
        """Write to a new HDF5 file, whole or not at all. Raises DataError if it exists."""
        # Not packed: a contact that closes once packs further than a reader believes of a measured array.
        hdf5.write(path, "curve", hdf5.flatten(self))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote. Raises DataError, one sentence, for anything else."""
        return hdf5.restore(cls, hdf5.read(path, "curve"), path)

    @property
    def down_travel(self) -> FloatArray:
        """(rows of the way down,) m."""
        return self.travel[: self.turn + 1]

    @property
    def down_force(self) -> FloatArray:
        """(rows of the way down,) N."""
        return self.force[: self.turn + 1]

    @property
    def up(self) -> slice:
        """The rows of the way up; none where it is too short to be one."""
        rows = len(self.travel)
        return slice(self.turn + 1, rows) if rows - self.turn - 1 >= FEWEST else slice(0, 0)

    @property
    def end(self) -> Point:
        """The largest travel, and the force there."""
        return Point(float(self.down_travel[-1]), float(self.down_force[-1]))

    @property
    def snap_ratio(self) -> float | None:
        """Fall of the force from peak to trough, over the peak's."""
        if self.peak is None or self.trough is None:
            return None
        return (self.peak.force - self.trough.force) / self.peak.force

    @property
    def lost(self) -> float | None:
        """Work (J) that the press loses: the area between both strokes, where both have travels."""
        travel, force = self.travel[self.up], self.force[self.up]
        if not len(travel):
            return None
        low = max(self.down_travel.min(), travel.min())
        high = min(self.down_travel.max(), travel.max())
        x = np.linspace(low, high, 2000)
        down = np.interp(x, *each_travel(self.down_travel, self.down_force))
        up = np.interp(x, *each_travel(travel, force))
        return float(scipy.integrate.trapezoid(down - up, x))


def each_travel(travel: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Travels in rising order, each once, and the mean force at each: testers repeat coarse travels."""
    places, which = np.unique(travel, return_inverse=True)
    return places, np.bincount(which, force) / np.bincount(which)
