"""The points of a slow force-travel curve, as a force tester writes it: row by row, no press to align.

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

import numpy as np
import scipy

from ...acquisition.presses import FEWEST, Curve, Point, each_travel
from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError, DataError
from .understood import Understanding

_DEEP, _NOISE = 0.08, 6.0
"""Depth of a tactile fall, over the usual force and over the noise of a row. Of 145 public curves whose file
names say what the switch is, 61 of 65 linear ones then show no fall (friction and a spring that settles make
up to 6.4 % in them), and 79 of 80 tactile and clicky ones show theirs."""
_STIFF, _STEP = 8.0, 0.02
"""Stiffness over that of the whole way before it, at which a switch has bottomed out, and the part of the
travel over which it is taken."""


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
    if turn + 1 < FEWEST:
        raise DataError(
            f"{found.path} has {turn + 1} rows on the way down, and a curve needs {FEWEST}: does travel "
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
        source_sha256=found.sha256,
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
    travel, force = each_travel(travel, force)
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
