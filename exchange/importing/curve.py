"""A slow force-travel curve of a switch, as a force tester writes it: row by row, without a press to align.

Model: the plunger goes down to the largest travel and, in most files, up again. On the way down the force of
a tactile switch passes a peak and falls to a trough: the deepest such fall is the tactile one (a spring that
settles makes a small one at the start), and how deep it is, over the peak, is its snap ratio. Near the end of
its way the switch is stiff: it has bottomed out. The up stroke needs less force: the area between both
is the work that a press loses. The contact, if a column shows it, closes at the operating point (travel and
force), and opens at the reset point.

Assumed: travel is the plunger's, friction and the tester's own compliance included; steps are slow enough
that no inertia is in the force. Nothing is said of what a file does not show: no contact, no operating point.
Terms: data sheets of MX switches (pretravel, operating and reset point), and of domes (snap ratio,
(F1 - F2) / F1).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import scipy

from ...acquisition import hdf5
from ...instruments import ConfigurationError, DataError
from ...instruments.arrays import FloatArray
from .understood import Understanding

_FEWEST = 20
"""Rows of a stroke that show a curve."""
_DEEP, _NOISE = 0.08, 6.0
"""Depth of a tactile fall, over the usual force and over the noise of a row. Of 145 public curves whose file
names say what the switch is, 61 of 65 linear ones then show no fall (friction and a spring that settles make
up to 6.4 % in them), and 79 of 80 tactile and clicky ones show theirs."""
_STIFF, _STEP = 8.0, 0.02
"""Stiffness over that of the whole way before it, at which a switch has bottomed out, and the part of the
travel over which it is taken."""


@dataclass(frozen=True)
class Point:
    """A place on a curve: travel (m) and force (N)."""

    travel: float
    force: float


@dataclass(frozen=True, eq=False)
class Curve:
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
        return slice(self.turn + 1, rows) if rows - self.turn - 1 >= _FEWEST else slice(0, 0)

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
        down = np.interp(x, *_each_travel(self.down_travel, self.down_force))
        up = np.interp(x, *_each_travel(travel, force))
        return float(scipy.integrate.trapezoid(down - up, x))


def curve_of(found: Understanding) -> Curve:
    """The curve that a file holds. Raises ConfigurationError and DataError for one that holds none."""
    found.require()
    missing = [role for role in ("force", "displacement") if role not in found.signals]
    if missing:
        raise ConfigurationError(
            f"{found.path} shows no {' and no '.join(missing)}, which a force-travel curve is made of: name "
            f"its column (--{missing[0]} COLUMN)."
        )
    force, travel = found.signals["force"].values, found.signals["displacement"].values
    if (times := _presses(travel)) > 1:
        raise DataError(
            f"{found.path} goes down {times} times, and a curve is one press: keep the rows of one (with a "
            "column that tells them apart, --each COLUMN makes a file of each)."
        )
    deepest = np.flatnonzero(travel >= travel.max() - 1e-4 * np.ptp(travel))
    turn = int(deepest[len(deepest) // 2])
    if turn + 1 < _FEWEST:
        raise DataError(
            f"{found.path} has {turn + 1} rows on the way down, and a curve needs {_FEWEST}: does travel "
            "rise as the switch is pressed (--flip displacement)?"
        )
    down = slice(0, turn + 1)
    bottom = _bottom(travel[down], force[down])
    soft = down if bottom is None else slice(0, int(np.argmax(travel >= bottom.travel)))
    peak, trough = _tactile(travel[soft], force[soft])
    contact = found.signals.get("activation")
    closed = np.zeros(0) if contact is None else _closed(contact.values)
    operates, resets = _switched(closed, travel, force, turn) if len(closed) else (None, None)
    return Curve(
        button=found.mapping.button or str(found.table.about.get("button", found.path.stem)),
        source=found.path.name,
        source_sha256=hashlib.sha256(found.path.read_bytes()).hexdigest(),
        units={role: found.signals[role].unit for role in ("force", "displacement")},
        notes=found.notes,
        simulated=bool(found.table.about.get("simulated", False)),
        travel=travel,
        force=force,
        contact=closed,
        turn=turn,
        peak=peak,
        trough=trough,
        bottom=bottom,
        operates=operates,
        resets=resets,
    )


def _presses(travel: FloatArray) -> int:
    """How often travel goes from its lowest to its highest quarter."""
    share = (travel - travel.min()) / np.ptp(travel)
    high = (share > 0.75)[(share < 0.25) | (share > 0.75)]
    return int(np.count_nonzero(high[1:] & ~high[:-1]))


def _each_travel(travel: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Travels in rising order, each once, and the mean force at each: testers repeat coarse travels."""
    places, which = np.unique(travel, return_inverse=True)
    return places, np.bincount(which, force) / np.bincount(which)


def _tactile(travel: FloatArray, force: FloatArray) -> tuple[Point | None, Point | None]:
    """Peak and trough of the deepest fall of the force that noise does not make; None without one."""
    noise = 1.4826 * float(np.median(np.abs(np.diff(force, 2)))) / np.sqrt(6)
    smooth = scipy.ndimage.uniform_filter1d(force, max(1, len(force) // 400))
    deepest, found = max(_DEEP * float(np.median(force)), _NOISE * noise), None
    for peak in scipy.signal.find_peaks(smooth)[0].tolist():
        after = smooth[peak:]
        # Up to where the force is higher than at the peak again: what lies behind is another event.
        higher = np.flatnonzero(after > smooth[peak])
        trough = peak + int(np.argmin(after[: int(higher[0]) if len(higher) else None]))
        fall = smooth[peak] - smooth[trough]
        if fall > deepest:
            deepest, found = fall, (peak, trough)
    if found is None:
        return None, None
    top, low = (Point(float(travel[at]), float(smooth[at])) for at in found)
    return top, low


def _bottom(travel: FloatArray, force: FloatArray) -> Point | None:
    """Where the stiffness stays far above that of the way before; None where it never does."""
    travel, force = _each_travel(travel, force)
    x = np.linspace(travel[0], travel[-1], round(1 / _STEP) + 1)
    steps = np.diff(np.interp(x, travel, force)) / np.diff(x)
    whole = (force.max() - force[0]) / (x[-1] - x[0])
    usual = float(np.median(np.abs(steps)))
    stiff = steps > max(_STIFF * usual, 2 * whole)
    if not stiff[-1]:
        return None
    soft = np.flatnonzero(~stiff)
    at = int(soft[-1]) + 1 if len(soft) else 0
    return Point(float(x[at]), float(np.interp(x[at], travel, force)))


def _closed(contact: FloatArray) -> FloatArray:
    """(rows,) 1 where a contact is closed."""
    return np.asarray(contact > (contact.min() + contact.max()) / 2, dtype=np.float64)


def _switched(
    closed: FloatArray, travel: FloatArray, force: FloatArray, turn: int
) -> tuple[Point | None, Point | None]:
    changed = np.flatnonzero(np.diff(closed)) + 1
    closes = [at for at in changed.tolist() if at <= turn and closed[at]]
    opens = [at for at in changed.tolist() if at > turn and not closed[at]]
    operates, resets = (
        Point(float(travel[one[0]]), float(force[one[0]])) if one else None for one in (closes, opens)
    )
    return operates, resets
