"""How a fingertip is found that rests on the table.

Its impedance Z and its law are those of `finger`. With the laser at x, where the finger is, and at another
point y, a response under it is

    H_x / (1 + Z Y_xx),    and    H_y - Z Y_yx H_x / (1 + Z Y_xx)

Without a map of the table neither modal masses nor shapes are known, and none is needed: the products l_j = c
g_j, none of which is negative, are found from responses under the finger by least squares, for the r and d
that leave least. So the laser may look at x (from the other side of the pane), or at one or several points y
beside: the ratio of a mode's shape at y and x is that of the residues of the bare responses there. Modes that
the calibrated patch hardly drives are not in its response, and move under a finger all the same: where the
laser sees x, a pole may stand anywhere, one in each fiftieth of a frequency, and the least squares choose.

A map shows the shapes p_j of a pane's modes, those too that the calibrated patch hardly drives. Of a uniform
pane of mass M a mode's mass is M times the mean square of its shape, so that g_j = p_j(x)^2 / M and Y_yx =
sum of p_j(y) p_j(x) h_j / M, with shapes of a mean square of one: one real number c / M is left to find, with
r and d.

What breaks it: a finger that is not one mass (several, or a palm), and one that does not hold still; with a
map, a pane that is not uniform. The uncertainty that is stated has three parts: what of the responses under
the finger is not explained, the ratios, and that nobody holds a force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import DataError
from ..band import BAND
from ..response import Response
from .finger import GROWS, Finger, impedance, loads, mobilities
from .model import Model, fit

if TYPE_CHECKING:
    from ...instruments.operator import RestFinger
    from .calibration import Calibration

_START, _WITHIN, _TRIES = (700.0, 300.0), ((20.0, 20.0), (2e4, 5e3)), 80
"""First guess of r and d (1/s), the least and most of both, and the most evaluations of a search."""
_HIDDEN, _STEP = (60.0, 1200.0), 0.02
"""Poles (Hz) that modes may have which the patch hardly drives, and their relative distance: without them a
finger's response on a light pane was wrong by 3.3 %, with one in each 5 % by 2.0 %, with these by 0.4 %."""
_MISFIT, _BESIDE = 0.03, 0.1
"""Largest residual of the responses under the finger, over what the finger changed, where the laser sees
its point, and beside it; `_NOISE` comes on top. At its point a fingertip leaves up to 0.006, and a palm 0.049
and more. Beside it fingertips leave up to 0.07 (simulated)."""
_PALM = 100.0
"""d at 1 N (1/s) below which what rests is too heavy for a fingertip: the mean one has 300, one of three
standard deviations below 125, a palm 45, found as 20 to 107 on the paper's pane (simulated; estimates)."""
_NOISE = 0.004
"""Residual (relative rms) that noise leaves, beside that."""
_CHANGED = 0.015
"""Relative change of the response below which nothing rests on the table: two looks at a bare one differ by
less, and 0.25 N on the paper's pane change it by more (simulated)."""
_WANDERS = 0.031
"""Standard deviation of a held force's mean over a look of two seconds, relative: the force itself wanders by
6 %, at 0.13, 0.41 and 1.1 Hz (estimates: docs/hardware.md, "Fingers on the table")."""
_NEAR = 0.05
"""Largest relative distance of a map's mode from a pole that is the same mode: tables drift by less."""
_HALF_WIDTHS = 3.0
"""Half of the lines about a pole that show how well its residue is known, over its half-width."""


@dataclass(frozen=True, eq=False)
class PlateModes:
    """Modes of a pane, from a map of all of it; shapes have a mean square of one over the pane."""

    points: tuple[str, ...]
    button: str
    """The button's point, by its number."""
    poles: ComplexArray
    """(modes,) rad/s, imaginary parts > 0."""
    shapes: FloatArray
    """(modes, points)"""
    residual: FloatArray
    """(points,): relative rms that the modes leave of each point's motion."""

    def at(self, point: str) -> int:
        """The place of a point among `points`. Raises DataError for one that was not measured."""
        name = self.button if point == "button" else point
        if name not in self.points:
            raise DataError(
                f"The map has no point {name}: measure it (haploop map), or calibrate the finger without "
                "the map."
            )
        return self.points.index(name)


@dataclass(frozen=True, eq=False)
class Look:
    """The responses of one point: of the bare table, and under the finger."""

    at_rest: Response
    under: Response


def find_finger(
    bare: Calibration, looks: Sequence[Look], asked: RestFinger, plate: PlateModes | None = None
) -> Finger:
    """Find the load of a finger on the calibrated point from one or several looks.

    Raises DataError when nothing seems to rest there, when what rests is no fingertip, and for a map without
    one of the points.
    """
    model = bare.model
    beside = any(look.under.point != bare.response.point for look in looks)
    basis = _Basis.of(model) if plate is None else _Basis.of_plate(model, plate, asked.point)
    seen = [_seen(bare, look, basis, plate) for look in looks]
    stiff, slow = _impedance(basis, seen, _START, 0.3)
    if plate is None and not beside:
        # Few poles bring the impedance near, and many are slow.
        basis = basis.with_hidden()
        seen = [_seen(bare, look, basis, plate) for look in looks]
        stiff, slow = _impedance(basis, seen, (stiff, slow), 0.05)
    load, misfit = _solved(basis, seen, stiff, slow)
    changed = float(np.sqrt(np.mean([one.changed**2 for one in seen])))
    if changed < _CHANGED:
        raise DataError(
            f"Nothing seems to rest at the {asked.point} point: the response changed by {changed:.1%} only. "
            f"{asked.participant} rests a fingertip there from when that is asked until it is to be lifted."
        )
    if misfit > (_BESIDE if beside else _MISFIT) * changed + _NOISE:
        raise DataError(
            f"Under the finger the response differs by {changed:.1%} from the bare one, and a fingertip at "
            f"the point leaves {misfit:.1%} of it unexplained: hold still, touch nothing else, and see that "
            "the table has not drifted since it was calibrated."
        )
    if slow < (least := _PALM * asked.force**GROWS):
        raise DataError(
            f"What rests at the point is heavier than a fingertip, as a palm is: its damping over "
            f"its mass is {slow:.0f} 1/s, and a fingertip's {least:.0f} or more. Rest a fingertip alone."
        )
    made = Finger(
        participant=asked.participant,
        force=asked.force,
        load=load,
        poles=basis.poles,
        stiff=stiff,
        slow=slow,
        bare=model,
        changed=0.0,
        misfit=misfit,
        uncertainty=0.0,
        beside=tuple(one.under.point for one in looks if one.under.point != bare.response.point),
        mapped=plate is not None,
    )
    here = seen[0].here
    own_change = float(np.linalg.norm((made.factor(seen[0].f) - 1) * here) / np.linalg.norm(here))
    return replace(made, changed=own_change, uncertainty=_uncertainty(made, seen))


@dataclass(frozen=True, eq=False)
class _Basis:
    """Poles of the modes that a finger loads, and (poles, unknowns) of which its load is made."""

    poles: ComplexArray
    own: FloatArray

    @classmethod
    def of(cls, model: Model) -> _Basis:
        """Of a model, whose modes have any masses."""
        return cls(model.poles, np.eye(len(model.poles)))

    def with_hidden(self) -> _Basis:
        """Of modes, too, that a model does not show."""
        w = 2 * np.pi * np.geomspace(*_HIDDEN, round(np.log(_HIDDEN[1] / _HIDDEN[0]) / _STEP))
        shown = self.poles[self.poles.imag > 0]
        damping = float(np.median(-shown.real / np.abs(shown)))
        poles = np.append(self.poles, w * (-damping + 1j * np.sqrt(1 - damping**2)))
        return _Basis(poles, np.eye(len(poles)))

    @classmethod
    def of_plate(cls, model: Model, plate: PlateModes, point: str) -> _Basis:
        """Of a map, whose modes have one mass, with the frequencies of the model: a table drifts."""
        scales = [np.abs(pole) / np.abs(plate.poles) for pole in model.poles[model.resonant]]
        nearest = [float(one[np.argmin(np.abs(one - 1))]) for one in scales]
        alike = [one for one in nearest if abs(one - 1) < _NEAR]
        if not alike:
            raise DataError(
                "No resonance of the calibration is one of the map's: they are of different tables."
            )
        return cls(plate.poles * float(np.median(alike)), plate.shapes[:, plate.at(point), None] ** 2)


@dataclass(frozen=True, eq=False)
class _Seen:
    """Responses at lines `f` (Hz), all (lines,): bare at the finger's point, bare and loaded where seen."""

    f: FloatArray
    here: ComplexArray
    there: ComplexArray
    loaded: ComplexArray
    cross: FloatArray
    """(poles, unknowns): of which l_j times the ratio of shapes is made."""
    spread: FloatArray
    """(poles,): standard deviation of the ratios, over the ratios."""

    @property
    def changed(self) -> float:
        """Relative rms change of the response where it was seen."""
        return float(np.linalg.norm(self.there - self.loaded) / np.linalg.norm(self.there))


def _impedance(
    basis: _Basis, seen: Sequence[_Seen], start: tuple[float, float], step: float
) -> tuple[float, float]:
    """Return the r and d of the theory that leave least, from a first guess and a first relative step."""

    def left(x: FloatArray) -> float:
        return _solved(basis, seen, *np.exp(x).tolist())[1]

    # A guess at a limit is rounded, maybe beyond it.
    first: FloatArray = np.clip(np.log(start), *np.log(_WITHIN))
    simplex: FloatArray = first + step * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    found = scipy.optimize.minimize(
        left,
        first,
        method="Nelder-Mead",
        bounds=scipy.optimize.Bounds(*np.log(_WITHIN)),
        options={"xatol": 0.02, "fatol": 1e-5, "maxfev": _TRIES, "initial_simplex": simplex},
    )
    stiff, slow = np.exp(found.x)
    return float(stiff), float(slow)


def _solved(basis: _Basis, seen: Sequence[_Seen], stiff: float, slow: float) -> tuple[FloatArray, float]:
    """Return the load (poles,) for a finger of r and d, and the relative residual that it leaves."""
    parts = [mobilities(basis.poles, one.f) * impedance(one.f, stiff, slow)[:, None] for one in seen]
    rows = []
    for one, part in zip(seen, parts, strict=True):
        # there - loaded = Z Y_yx here - Z Y_xx (there - loaded): linear in the unknowns, none is negative.
        lost, size = one.there - one.loaded, np.linalg.norm(one.loaded)
        columns = (part @ one.cross) * one.here[:, None] - (part @ basis.own) * lost[:, None]
        both = np.column_stack([columns, lost]) / size
        rows += [both.real, both.imag]
    # The same least squares in as many rows as unknowns.
    small = np.asarray(np.linalg.qr(np.concatenate(rows), mode="r"))
    unknown, _ = scipy.optimize.nnls(small[:, :-1], small[:, -1])
    load = basis.own @ unknown
    left = []
    for one, part in zip(seen, parts, strict=True):
        shown = one.there - (part @ (one.cross @ unknown)) * one.here / (1 + part @ load)
        left.append(np.linalg.norm(shown - one.loaded) / np.linalg.norm(one.loaded))
    return load, float(np.sqrt(np.mean(np.square(left))))


def _seen(bare: Calibration, look: Look, basis: _Basis, plate: PlateModes | None) -> _Seen:
    model, point = bare.model, bare.response.point
    f = look.under.frequencies
    inside = (f >= BAND[0]) & (f <= BAND[1])
    f = f[inside]
    here = model.velocity(f)
    cross, spread = basis.own, np.zeros(len(basis.poles))
    beside = look.at_rest is not bare.response
    if plate is not None:
        own, there = plate.at(point), plate.at(look.under.point)
        cross = (plate.shapes[:, own] * plate.shapes[:, there])[:, None]
        spread = np.full(len(basis.poles), np.hypot(plate.residual[own], plate.residual[there]))
    elif beside:
        ratios, spread = _ratios(model, look.at_rest)
        cross = np.diag(ratios)
    return _Seen(
        f=f,
        here=here,
        there=fit(look.at_rest).velocity(f) if beside else here,
        loaded=look.under.velocity[inside],
        cross=cross,
        spread=spread,
    )


def _ratios(model: Model, response: Response) -> tuple[FloatArray, FloatArray]:
    """Each mode's shape at a point over that at the model's, (poles,), by its bare response; how well it is
    known.

    What the model's poles leave of it near a resonance, over that resonance, is how well its ratio is known.
    """
    f = response.frequencies
    inside = (f >= model.band[0]) & (f <= model.band[1])
    f, s = f[inside], 2j * np.pi * f[inside, None]
    paired = model.poles.imag > 0
    near, mirror = 1 / (s - model.poles), np.where(paired, 1 / (s - np.conj(model.poles)), 0)
    columns = np.concatenate([near + mirror, 1j * (near - mirror)[:, paired], np.ones_like(s), s], axis=1)
    sizes = np.linalg.norm(columns, axis=0)
    rows = np.concatenate([columns.real, columns.imag]) / sizes
    measured = response.velocity[inside]
    solved = np.linalg.lstsq(rows, np.concatenate([measured.real, measured.imag]), rcond=None)[0] / sizes
    residues = solved[: len(paired)].astype(np.complex128)
    residues[paired] += 1j * solved[len(paired) : len(paired) + paired.sum()]
    left = np.abs(measured - columns @ solved) ** 2
    spread = np.zeros(len(paired))
    for k, pole in enumerate(model.poles):
        about = np.abs(2 * np.pi * f - pole.imag) < _HALF_WIDTHS * -pole.real
        if paired[k] and about.any():
            own = np.abs(residues[k] * near[about, k]) ** 2
            spread[k] = np.sqrt(left[about].sum() / own.sum())
    found = (residues * np.conj(model.residues)).real / np.abs(model.residues) ** 2
    return np.asarray(found), np.minimum(spread, 1.0)


def _uncertainty(finger: Finger, seen: Sequence[_Seen]) -> float:
    """See `Finger.uncertainty`; r and d follow the force as c does."""
    first = seen[0]
    factor = finger.factor(first.f)
    moved = (factor**2 * first.here)[:, None] * loads(finger, first.f, None)
    spread = np.sqrt(np.mean([one.spread**2 for one in seen], axis=0))
    of_ratios = float(np.linalg.norm(moved * spread))
    more, less = (finger.factor(first.f, share * finger.force) for share in (1 + _WANDERS, 1 - _WANDERS))
    of_force = float(np.linalg.norm((more - less) / 2 * first.here))
    size = float(np.linalg.norm(factor * first.here))
    return float(np.sqrt(finger.misfit**2 + (of_ratios**2 + of_force**2) / size**2))
