"""A calibration for a table with a finger on it: the bare one, and what the finger does to it.

A fingertip at the point x is a spring k and a damper c on a mass m, of impedance

    Z = c s (s + r) / (s^2 + d s + d r),    r = k / c,    d = c / m

With the mobility Y_xx = sum of g_j h_j(s) over modes, h_j = s / (s^2 + 2 z w s + w^2), a response at x is

    H_x / (1 + Z Y_xx),    and at another point y    H_y - Z Y_yx H_x / (1 + Z Y_xx)

Neither modal masses nor shapes are known, and none is needed: the products l_j = c g_j, none of which is
negative, are found from one response under the finger by least squares, for the r and d that leave least, and
the ratios of shapes at y and x are those of the bare responses' residues. So the laser may look at x (from
the other side of the pane) or at a point beside. Another force scales l, r and d: all grow as F^0.35, as a
spring does that grows as F^0.7, and a damper as F^0.35 (estimates: docs/hardware.md, "Fingers on the table").

What breaks it: a finger that is not one mass (several, or a palm), and one that does not hold still.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ...instruments import ConfigurationError, DataError, InstrumentError, Rig
from ...instruments.arrays import ComplexArray, FloatArray
from ...instruments.operator import LiftFinger, RestFinger
from ...instruments.progress import Progress, prefixed, silent
from ..response import Response, quick_response
from .model import Model, fit

if TYPE_CHECKING:
    from .calibration import Calibration

__all__ = ["Finger", "calibrate_finger", "under_finger"]

_GROWS = 0.35
"""Exponent of the damper's growth with force."""
_FORCES = (0.1, 20.0)
"""Forces (N) of a fingertip that rests."""
_BAND = (75.0, 600.0)
"""Lines (Hz) that tell a finger: the band of drives."""
_START, _WITHIN, _TRIES = (700.0, 300.0), ((20.0, 20.0), (2e4, 5e3)), 80
"""First guess of r and d (1/s), the least and most of both, and the most evaluations of a search."""
_COMES = 0.5
"""Time (s) that a finger gets to come to rest, or to leave."""
_MISFIT = 0.1
"""Largest residual of the response under the finger, over what the finger changed, and beside `_NOISE`."""
_NOISE = 0.007
"""Residual (relative rms) that noise leaves."""


@dataclass(frozen=True, eq=False)
class Finger:
    """The fingertip that a calibration holds for."""

    participant: str
    force: float
    """Force (N) that was asked for."""
    load: FloatArray
    """(poles,) of the bare model, 1/s: l_j of the theory, at that force."""
    stiff: float
    """1/s: r of the theory, at that force."""
    slow: float
    """1/s: d of the theory, at that force."""
    bare: Model
    """The bare table's model, whose poles these are."""
    changed: float
    """Relative rms change of the response at the point."""
    misfit: float
    """Relative rms of the response under the finger that one fingertip does not explain."""
    beside: str
    """Point that the laser looked at; empty for the point itself."""

    def refuse_nonsense(self) -> None:
        """See `hdf5.restore`. Raises DataError for a finger that no measurement finds."""
        if self.load.shape != self.bare.poles.shape or not np.all(self.load >= 0):
            raise DataError("the finger's load is not one number of 0 or more for each pole.")
        if not all(0 < one < np.inf for one in (self.force, self.stiff, self.slow, *np.ravel(1 + self.load))):
            raise DataError("the finger's force or impedance is not a positive number.")

    def factor(self, f: FloatArray, force: float | None = None) -> ComplexArray:
        """Return the response under the finger over the bare one, (frequencies,), at `f` (Hz)."""
        scale = 1.0 if force is None else (force / self.force) ** _GROWS
        parts = _mobilities(self.bare, f) * _shape(f, scale * self.stiff, scale * self.slow)[:, None]
        return np.asarray(1 / (1 + scale * (parts @ self.load)))


def calibrate_finger(
    rig: Rig,
    bare: Calibration,
    participant: str,
    *,
    force: float = 1.0,
    beside: str | None = None,
    progress: Progress = silent,
) -> Calibration:
    """Measure what a participant's resting fingertip does to a calibration, in two seconds of a multisine.

    The operator is asked to rest the fingertip at the calibration's point, and to lift it afterwards. The
    laser sees the point from the other side of the pane, or another point, `beside`, whose bare response is
    measured first. The carrier stays the bare table's.

    Raises ConfigurationError for a calibration that is a finger's already, for another rig's, and for a force
    that no finger rests with; InstrumentError when nobody rests a finger; DataError when what rests is no
    fingertip; and what `measure_response` raises.
    """
    response = bare.response
    if bare.finger is not None:
        raise ConfigurationError("Give a calibration of the bare table: this one is a finger's already.")
    if (response.rig, response.simulated) != (rig.name, rig.simulated):
        raise ConfigurationError(f"The calibration is of another rig, {response.rig!r}: calibrate this one.")
    if not _FORCES[0] <= force <= _FORCES[1]:
        raise ConfigurationError(
            f"A fingertip rests with {_FORCES[0]:g} to {_FORCES[1]:g} N, and {force:g} N was asked for."
        )
    law, seen_at = bare.hysteresis, beside or response.point
    at_rest = response
    if seen_at != response.point:
        told = prefixed(progress, "bare")
        at_rest = quick_response(rig, response.patch, seen_at, told, hysteresis=law)
    if not rig.operator.confirm(RestFinger(participant, response.point, force)):
        raise InstrumentError(
            f"Nobody rests a finger at the {response.point} point: {participant} must be there."
        )
    try:
        rig.clock.sleep(_COMES)
        told = prefixed(progress, "under the finger")
        under = quick_response(rig, response.patch, seen_at, told, hysteresis=law)
    finally:
        rig.operator.confirm(LiftFinger())
        rig.clock.sleep(_COMES)
    return under_finger(bare, _finger(bare, at_rest, under, RestFinger(participant, response.point, force)))


def under_finger(bare: Calibration, finger: Finger, force: float | None = None) -> Calibration:
    """Return a bare calibration as it is under a finger, at another force (N) than the measured one if given.

    Three drives for three forces are three of these.
    """
    response = bare.response
    velocity = response.velocity * finger.factor(response.frequencies, force)
    scale = 1.0 if force is None else (force / finger.force) ** _GROWS
    found = replace(
        finger,
        load=scale * finger.load,
        stiff=scale * finger.stiff,
        slow=scale * finger.slow,
        force=force or finger.force,
    )
    loaded = replace(response, velocity=velocity)
    return replace(bare, response=loaded, model=fit(loaded), finger=found)


def _finger(bare: Calibration, at_rest: Response, under: Response, asked: RestFinger) -> Finger:
    """Find the load of a finger from the responses of where the laser looked, bare and under it."""
    model = bare.model
    beside = at_rest is not bare.response
    f = under.frequencies
    inside = (f >= _BAND[0]) & (f <= _BAND[1])
    f, loaded = f[inside], under.velocity[inside]
    here = model.velocity(f)
    seen = _Seen(
        f=f,
        here=here,
        there=fit(at_rest).velocity(f) if beside else here,
        loaded=loaded,
        parts=_mobilities(model, f),
        ratios=_ratios(model, at_rest) if beside else np.ones(len(model.poles)),
    )

    def left(x: FloatArray) -> float:
        return seen.solved(*np.exp(x).tolist())[1]

    found = scipy.optimize.minimize(
        left,
        np.log(_START),
        method="Nelder-Mead",
        bounds=scipy.optimize.Bounds(*np.log(_WITHIN)),
        options={"xatol": 0.02, "fatol": 1e-5, "maxfev": _TRIES},
    )
    stiff, slow = (float(value) for value in np.exp(found.x))
    load, misfit = seen.solved(stiff, slow)
    changed = float(np.linalg.norm(seen.there - loaded) / np.linalg.norm(seen.there))
    if misfit > _MISFIT * changed + _NOISE:
        raise DataError(
            f"Under the finger the response differs by {changed:.0%} from the bare one, and a fingertip at "
            f"the point leaves {misfit:.0%} of it unexplained: hold still, touch nothing else, and see that "
            "the table has not drifted since it was calibrated."
        )
    made = Finger(asked.participant, asked.force, load, stiff, slow, model, 0.0, misfit, "")
    own = float(np.linalg.norm((made.factor(f) - 1) * here) / np.linalg.norm(here))
    return replace(made, changed=own, beside=at_rest.point if beside else "")


@dataclass(frozen=True, eq=False)
class _Seen:
    """Responses at lines `f` (Hz), all (lines,): bare at the finger's point, bare and loaded where seen."""

    f: FloatArray
    here: ComplexArray
    there: ComplexArray
    loaded: ComplexArray
    parts: ComplexArray
    ratios: FloatArray

    def solved(self, stiff: float, slow: float) -> tuple[FloatArray, float]:
        """Return the load (poles,) for a finger of r and d, and the relative residual that it leaves."""
        parts = self.parts * _shape(self.f, stiff, slow)[:, None]
        # there - loaded = sum_j l_j Z_j (ratio_j here - (there - loaded)): linear in l, none is negative.
        lost = self.there - self.loaded
        columns = parts * (self.ratios * self.here[:, None] - lost[:, None])
        load, _ = scipy.optimize.nnls(
            np.concatenate([columns.real, columns.imag]), np.concatenate([lost.real, lost.imag])
        )
        explained = self.there - (parts @ (self.ratios * load)) * self.here / (1 + parts @ load)
        return load, float(np.linalg.norm(explained - self.loaded) / np.linalg.norm(self.loaded))


def _shape(f: FloatArray, stiff: float, slow: float) -> ComplexArray:
    """Z / c of the theory at `f` (Hz)."""
    s = 2j * np.pi * np.maximum(np.asarray(f), 1e-3)
    return np.asarray(s * (s + stiff) / (s**2 + slow * s + slow * stiff))


def _mobilities(model: Model, f: FloatArray) -> ComplexArray:
    """h_j of the theory, (frequencies, poles); nothing for real poles."""
    s = 2j * np.pi * np.asarray(f)[:, None]
    p = model.poles
    found = s / ((s - p) * (s - np.conj(p)))
    return np.asarray(np.where(p.imag > 0, found, 0.0))


def _ratios(model: Model, response: Response) -> FloatArray:
    """Each mode's shape where a bare response was measured over that at the model's point, (poles,)."""
    f = response.frequencies
    inside = (f >= model.band[0]) & (f <= model.band[1])
    f, s = f[inside], 2j * np.pi * f[inside, None]
    paired = model.poles.imag > 0
    near, mirror = 1 / (s - model.poles), np.where(paired, 1 / (s - np.conj(model.poles)), 0)
    columns = np.concatenate([near + mirror, 1j * (near - mirror)[:, paired], np.ones_like(s), s], axis=1)
    sizes = np.linalg.norm(columns, axis=0)
    rows = np.concatenate([columns.real, columns.imag]) / sizes
    measured = np.concatenate([response.velocity[inside].real, response.velocity[inside].imag])
    solved = np.linalg.lstsq(rows, measured, rcond=None)[0] / sizes
    residues = solved[: len(paired)].astype(np.complex128)
    residues[paired] += 1j * solved[len(paired) : len(paired) + paired.sum()]
    return np.asarray((residues * np.conj(model.residues)).real / np.abs(model.residues) ** 2)
