"""A slow force-travel curve of a switch, as a force tester writes it: row by row, without a press to align.

Model: the plunger goes down to the largest travel and, in most files, up again. On the way down the force of
a tactile switch passes a peak and falls to a trough: by how much, over the peak, is its snap ratio. Near the
end of its way the switch is stiff: it has bottomed out. The up stroke needs less force: the area between both
is the work that a press loses. The contact, if a column shows it, closes at the operating point (travel and
force), and opens at the reset point.

Assumed: travel is the plunger's, friction and the tester's own compliance included; steps are slow enough
that no inertia is in the force. Nothing is said of what a file does not show: no contact, no operating point.
Terms: data sheets of MX switches (pretravel, operating and reset point), and of domes (snap ratio,
(F1 - F2) / F1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from ...instruments import ConfigurationError, DataError
from ...instruments.arrays import FloatArray
from .understood import Understanding

_FEWEST = 20
"""Rows of a stroke that show a curve."""
_DEEP, _NOISE = 0.03, 6.0
"""Depth of a tactile fall, over the force before it, and over the noise of a row."""
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
    """Force over travel, (rows,) of each stroke, and the points on it; None for what it does not show."""

    down_travel: FloatArray
    down_force: FloatArray
    up_travel: FloatArray
    """Empty without an up stroke."""
    up_force: FloatArray
    peak: Point | None
    """Of the first tactile fall on the way down, and its trough."""
    trough: Point | None
    bottom: Point | None
    """Where the switch bottoms out."""
    operates: Point | None
    """Where the contact closes on the way down, and opens on the way up."""
    resets: Point | None

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
        if not len(self.up_travel):
            return None
        low = max(self.down_travel.min(), self.up_travel.min())
        high = min(self.down_travel.max(), self.up_travel.max())
        x = np.linspace(low, high, 2000)
        down, up = (
            np.interp(x, travel[order], force[order])
            for travel, force in ((self.down_travel, self.down_force), (self.up_travel, self.up_force))
            for order in (np.argsort(travel, kind="stable"),)
        )
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
    deepest = np.flatnonzero(travel >= travel.max() - 1e-4 * np.ptp(travel))
    turn = int(deepest[len(deepest) // 2])
    if turn + 1 < _FEWEST:
        raise DataError(
            f"{found.path} has {turn + 1} rows on the way down, and a curve needs {_FEWEST}: does travel "
            "rise as the switch is pressed (--flip displacement)?"
        )
    down, up = slice(0, turn + 1), slice(turn + 1, len(travel))
    if len(travel) - turn - 1 < _FEWEST:
        up = slice(0, 0)
    peak, trough = _tactile(travel[down], force[down])
    contact = found.signals.get("activation")
    operates, resets = (None, None) if contact is None else _switched(contact.values, travel, force, turn)
    return Curve(
        travel[down], force[down], travel[up], force[up], peak, trough, _bottom(travel[down], force[down]),
        operates, resets)  # fmt: skip


def _tactile(travel: FloatArray, force: FloatArray) -> tuple[Point | None, Point | None]:
    """Peak and trough of the first fall of the force that noise does not make."""
    noise = 1.4826 * float(np.median(np.abs(np.diff(force, 2)))) / np.sqrt(6)
    smooth = scipy.ndimage.uniform_filter1d(force, max(1, len(force) // 400))
    for peak in scipy.signal.find_peaks(smooth)[0].tolist():
        after = smooth[peak:]
        # Up to where the force is higher than at the peak again: what lies behind is another event.
        higher = np.flatnonzero(after > smooth[peak])
        trough = peak + int(np.argmin(after[: int(higher[0]) if len(higher) else None]))
        if smooth[peak] - smooth[trough] > max(_DEEP * smooth[peak], _NOISE * noise):
            return (
                Point(float(travel[peak]), float(smooth[peak])),
                Point(float(travel[trough]), float(smooth[trough])),
            )
    return None, None


def _bottom(travel: FloatArray, force: FloatArray) -> Point | None:
    """Where the stiffness stays far above that of the way before; None where it never does."""
    travel, first = np.unique(travel, return_index=True)
    force = force[first]
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


def _switched(
    contact: FloatArray, travel: FloatArray, force: FloatArray, turn: int
) -> tuple[Point | None, Point | None]:
    closed = contact > (contact.min() + contact.max()) / 2
    changed = np.flatnonzero(closed[1:] != closed[:-1]) + 1
    closes = [at for at in changed.tolist() if at <= turn and closed[at]]
    opens = [at for at in changed.tolist() if at > turn and not closed[at]]
    found = [Point(float(travel[one[0]]), float(force[one[0]])) if one else None for one in (closes, opens)]
    return found[0], found[1]
