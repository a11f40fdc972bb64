"""What a fingertip that rests on the table does to a response.

A fingertip at the point x is a spring k and a damper c on a mass m, of impedance

    Z = c s (s + r) / (s^2 + d s + d r),    r = k / c,    d = c / m

With the mobility Y_xx = sum of g_j h_j(s) over modes, h_j = s / (s^2 + 2 z w s + w^2), a response at x is

    H_x / (1 + Z Y_xx)

of which the products l_j = c g_j, r and d are all that matters. `finger_finding` finds them.

Another force scales l, r and d: all grow as F^0.35, as a spring does that grows as F^0.7, and a damper as
F^0.35 (estimates: docs/hardware.md, "Fingers on the table").
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import DataError
from ..resting_finger import refuse_force
from .model import Model, fit

if TYPE_CHECKING:
    from .calibration import Calibration

GROWS = 0.35
"""Exponent of the damper's growth with force."""


@dataclass(frozen=True, eq=False)
class Finger:
    """The fingertip that a calibration holds for."""

    participant: str
    force: float
    """Force (N) that was asked for, or measured by the force sensor under the table."""
    load: FloatArray
    """(poles,), 1/s: l_j of the theory, at that force."""
    poles: ComplexArray
    """rad/s, of the modes that the finger loads: the bare model's, or a map's."""
    stiff: float
    """1/s: r of the theory, at that force."""
    slow: float
    """1/s: d of the theory, at that force."""
    bare: Model
    """The bare table's model."""
    changed: float
    """Relative rms change of the response at the point."""
    misfit: float
    """Relative rms of the responses under the finger that one fingertip does not explain."""
    uncertainty: float
    """Relative standard deviation (rms) of the response at the point under the finger, at that force, over
    the bare one."""
    beside: tuple[str, ...]
    """Points that the laser looked at; empty for the point itself."""
    mapped: bool = False
    """Whether a map of the table told the shapes of its modes there."""

    def refuse_nonsense(self) -> None:
        """See `hdf5.restore`. Raises DataError for a finger that no measurement finds."""
        if np.ndim(self.load) != 1 or self.load.shape != self.poles.shape or not np.all(self.load >= 0):
            raise DataError("the finger's load is not one number of 0 or more for each pole.")
        numbers = (self.force, self.stiff, self.slow, *np.ravel(1 + self.load))
        if not np.all(np.isfinite(self.poles)) or not np.all(self.poles.real < 0):
            raise DataError("the poles of the modes that the finger loads are not stable.")
        told = (self.changed, self.misfit, self.uncertainty)
        if not all(0 < one < np.inf for one in numbers) or not all(0 <= one < np.inf for one in told):
            raise DataError("the finger's force, impedance or uncertainty is not a positive number.")

    def factor(self, f: FloatArray, force: float | None = None) -> ComplexArray:
        """Return the response under the finger over the bare one, (frequencies,), at `f` (Hz)."""
        return np.asarray(1 / (1 + loads(self, f, force) @ np.ones(len(self.load))))


def under_finger(bare: Calibration, finger: Finger, force: float | None = None) -> Calibration:
    """Return a bare calibration as it is under a finger, at another force (N) than the measured one if given.

    Three drives for three forces are three of these. Raises ConfigurationError for a force that no fingertip
    rests with.
    """
    if force is not None:
        refuse_force(force)
    response = bare.response
    velocity = response.velocity * finger.factor(response.frequencies, force)
    scale = _scale(finger, force)
    found = replace(
        finger,
        load=scale * finger.load,
        stiff=scale * finger.stiff,
        slow=scale * finger.slow,
        force=finger.force if force is None else force,
    )
    loaded = replace(response, velocity=velocity)
    return replace(bare, response=loaded, model=fit(loaded), finger=found)


def at_force(calibration: Calibration, force: float) -> Calibration:
    """Return a finger's calibration as it is at another force (N).

    Raises DataError for one of no finger, and what `under_finger` raises.
    """
    finger = calibration.finger
    if finger is None:
        raise DataError("A calibration of the bare table is of no force: calibrate with a finger.")
    response = calibration.response
    without = replace(response, velocity=response.velocity / finger.factor(response.frequencies))
    return under_finger(replace(calibration, response=without, model=finger.bare), finger, force)


def _scale(finger: Finger, force: float | None) -> float:
    return 1.0 if force is None else float((force / finger.force) ** GROWS)


def loads(finger: Finger, f: FloatArray, force: float | None) -> ComplexArray:
    """(frequencies, poles): Z Y_xx of the theory, mode by mode."""
    scale = _scale(finger, force)
    shape = impedance(f, scale * finger.stiff, scale * finger.slow)
    return np.asarray(mobilities(finger.poles, f) * shape[:, None] * (scale * finger.load))


def impedance(f: FloatArray, stiff: float, slow: float) -> ComplexArray:
    """Z / c of the theory at `f` (Hz)."""
    s = 2j * np.pi * np.maximum(np.asarray(f), 1e-3)
    return np.asarray(s * (s + stiff) / (s**2 + slow * s + slow * stiff))


def mobilities(p: ComplexArray, f: FloatArray) -> ComplexArray:
    """h_j of the theory for poles p, (frequencies, poles); nothing for real poles."""
    s = 2j * np.pi * np.asarray(f)[:, None]
    found = s / ((s - p) * (s - np.conj(p)))
    return np.asarray(np.where(p.imag > 0, found, 0.0))
