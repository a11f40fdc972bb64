"""Expected drift of a table between its calibration and a play, as deviations of its responses.

A table drifts in as many ways as it has modes, and a few more: temperature moves the frequencies of all modes
together, the frame and the glue those of each mode, and its damping; an amplifier's channels drift in gain
and delay. Each of these is one number with a standard deviation, and moves the responses of every patch at
every point at once. Against what they have in common, several patches can be planned
(`calibration.drive.inversion`).

A response is a sum over poles; a mode's number moves its pole, and the residue stays: in velocity it is force
times shape over the modal mass, which no drift of the frequency changes. Calibrations of several patches are
fitted one by one, so that their poles of one mode differ a little: poles nearer to each other than the sum of
their half-widths are one mode. Poles with no resonance among them stand for what is far away, often as large
parts that cancel, and stay where they are. Deviations are differences for a standard deviation up and down,
not derivatives, because a drift may be as large as a resonance is wide. Assumptions: drifts are independent
of each other; the residues stay. A change of the shapes (a finger, a loose patch) breaks them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from ...base.arrays import ComplexArray, FloatArray, IntArray
from ...base.errors import ConfigurationError
from .model import Model


@dataclass(frozen=True)
class Drift:
    """Standard deviations of what changes between calibration and play; relative where no unit is given.

    The defaults are estimates: three times what `haploop recalibrate` accepts of resonances, half of what it
    accepts of damping.
    """

    common: float = 0.01
    """Frequencies of all modes, alike."""
    own: float = 0.005
    """Frequency of each mode."""
    damping: float = 0.1
    """Damping ratio of each mode."""
    gain: float | None = None
    """Velocity per volt of each patch; None: as its calibration states it (`Calibration.scatter`)."""
    delay: float | None = None
    """Delay of each patch (s); None as well."""

    def __post_init__(self) -> None:
        """Raises ConfigurationError for a size that no deviation has."""
        for name, size in asdict(self).items():
            if size is None:
                continue
            if not 0 <= size < 1:
                raise ConfigurationError(
                    f"A drift cannot be {name} = {size:g}: it is 0 or more, and below 1."
                )
            object.__setattr__(self, name, float(size))  # a file tells a whole number from others

    @classmethod
    def usual(cls, common: float) -> Drift:
        """The usual drift, at the size at which all resonances move by `common`."""
        return cls().times(common / cls().common)

    def times(self, factor: float) -> Drift:
        """A drift of so many times the size; what a calibration states stays."""
        gain, delay = (None if one is None else factor * one for one in (self.gain, self.delay))
        return Drift(factor * self.common, factor * self.own, factor * self.damping, gain, delay)

    @property
    def modes(self) -> bool:
        """True when a mode is expected to change."""
        return bool(self.common or self.own or self.damping)


def apart(one: Model, other: Model) -> float:
    """Relative difference of the resonances of two fits of one table: the median over those of the one with
    fewer.

    Each is compared with the nearest of the other. Near a node a patch shows half of the modes, so that half
    of the other's would be far off; of its own few are, near the ends of the band.
    """
    each = (np.array([r.frequency_hz for r in model.resonances]) for model in (one, other))
    own, others = sorted(each, key=len)
    if not len(own) or not len(others):
        return 0.0
    shifts = np.abs(others[None, :] / own[:, None] - 1)
    return float(np.median(shifts.min(axis=1)))


def mode_deviations(models: Sequence[Model], f: FloatArray, drift: Drift) -> ComplexArray:
    """(deviations, models, frequencies) m/s per V: what each number of the modes changes, at `f` (Hz).

    The sum over the deviations of their products is the covariance of the responses.
    """
    modes = modes_of(models)
    count = int(max(each.max() for each in modes)) + 1
    s = np.asarray(2j * np.pi * f, dtype=np.complex128)
    found = []
    for which, turned, damped in (
        (None, drift.common, 0.0),
        *((k, drift.own, 0.0) for k in range(count)),
        *((k, 0.0, drift.damping) for k in range(count)),
    ):
        if turned or damped:
            for sign in (1.0, -1.0):
                found.append(
                    [
                        _moved(m, own, s, which, (sign * turned, sign * damped))
                        for m, own in zip(models, modes, strict=True)
                    ]
                )
    return np.asarray(np.array(found).reshape(len(found), len(models), len(s)) / np.sqrt(2))


def _moved(
    model: Model, modes: IntArray, s: ComplexArray, which: int | None, by: tuple[float, float]
) -> ComplexArray:
    """(frequencies,): change of a response where a mode's frequency and damping change (None: all modes')."""
    changed: ComplexArray = np.zeros(len(s), dtype=np.complex128)
    chosen = modes >= 0 if which is None else modes == which
    for p, r in zip(model.poles[chosen], model.residues[chosen], strict=True):
        moved = (1 + by[0]) * complex(p.real * (1 + by[1]), p.imag)
        for pole, residue, sign in ((moved, r, 1.0), (p, r, -1.0)):
            changed += sign * (residue / (s - pole) + np.conj(residue) / (s - np.conj(pole)))
    return changed


def pole_slopes(model: Model, f: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """(frequencies, poles) each: what the logarithms of a pole's frequency and damping change, per unit."""
    p, r = model.poles, model.residues
    s = 2j * np.pi * f[:, None]
    near = r / (s - p) ** 2
    mirror = np.where(p.imag > 0, np.conj(r) / (s - np.conj(p)) ** 2, 0)
    return np.asarray(near * p + mirror * np.conj(p)), np.asarray((near + mirror) * p.real)


def modes_of(models: Sequence[Model]) -> list[IntArray]:
    """Number of the mode of each pole of each model; -1 for one that belongs to no resonance."""
    poles = np.concatenate([m.poles for m in models])
    numbers = np.full(len(poles), -1)
    order = [k for k in np.argsort(np.abs(poles)) if poles[k].imag > 0]
    number = 0
    for before, k in zip([None, *order], order, strict=False):
        if before is not None and abs(poles[k]) - abs(poles[before]) > -poles[k].real - poles[before].real:
            number += 1
        numbers[k] = number
    resonances = numbers[np.concatenate([m.resonant for m in models])]
    numbers[~np.isin(numbers, resonances)] = -1
    ends = np.cumsum([len(m.poles) for m in models])
    return list(np.split(numbers, ends[:-1]))
