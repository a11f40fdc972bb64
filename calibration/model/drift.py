"""Expected drift of a table between its calibration and a play, and the scatter of amplifier channels.

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
from dataclasses import asdict, dataclass, replace
from datetime import datetime

import numpy as np

from ...base.arrays import ComplexArray, FloatArray, IntArray
from ...base.errors import ConfigurationError, DataError
from .calibration import Calibration, ChannelScatter
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


# Scatter of the channels of an amplifier: how their gains and delays differ between calibrations.
#
# Model: what a channel and its patch add to the table is one gain and one delay over all frequencies, so that
# two calibrations of a patch at a point differ by H g - H j w t beside what the table's modes did. Both are
# told from a drift of the modes, whose frequencies and dampings are fitted with them, as a mode changes the
# response near its resonance only. Measured responses are compared, not models: what a model leaves out is in
# both. Gains are of linear volts commanded, so that amplifier, cable, monitor, patch and law are in them. The
# changes of all channels count as one sample of their scatter, about zero; the next change is then expected
# to have the mean square of Student's t. What breaks it: modes that moved by more than their width, or shapes
# that changed; then more is left than noise and drift explain, and nothing is stated.

_ROUNDS = 6
"""Steps of the fit: of modes that moved by a third of their width, four suffice."""
_SHIFT, _DAMPING = 0.02, 0.3
"""Standard deviations of a mode's own shift and damping before anything was measured, relative."""
_MISFIT = 0.002
"""Relative misfit at which these count."""
_LEFT = 0.02
"""Change that is left, over the response, beyond which it is not one of gain, delay and modes."""
_FEWEST = 3
"""Changes from which the next one's mean square is known at all."""


@dataclass(frozen=True)
class ChannelChange:
    """How one channel changed from a calibration to a later one."""

    gain: float
    """Relative."""
    delay: float
    """s."""
    left: float
    """Change that neither explains, nor a drift of the modes: rms, over the response."""


def channel_change(before: Calibration, after: Calibration) -> ChannelChange:
    """Compare two calibrations of a patch at a point.

    Raises ConfigurationError for calibrations of different places, DataError when the difference is none of
    gain, delay and drift.
    """
    one, other = before.response, after.response
    place = f"patch {other.patch} at the {other.point} point"
    if (one.patch, one.point) != (other.patch, other.point):
        raise ConfigurationError(
            f"The calibrations are of patch {one.patch} at the {one.point} point and of {place}: only those "
            "of one place can be compared."
        )
    f = other.frequencies
    f = f[(f >= before.model.band[0]) & (f <= before.model.band[1])]
    was, now = _commanded(before, f), _commanded(after, f)
    fit = _Fit.of(before, f)
    x = np.zeros(2 + 2 * fit.modes)
    for _ in range(_ROUNDS):
        x = x + fit.step(x, now - was)
    left = float(np.linalg.norm(now - was - fit.change(x)) / np.linalg.norm(was))
    if not left <= _LEFT:
        raise DataError(
            f"The response of {place} has changed since {one.created} in a way that no gain, delay or drift "
            f"of modes explains ({left:.1%} of it is left): nothing can be said of the channel."
        )
    return ChannelChange(float(x[0]), float(x[1]), left)


def with_scatter(calibrations: Sequence[Calibration], earlier: Sequence[Calibration]) -> list[Calibration]:
    """Calibrations with the scatter of their channels since earlier ones of the same places.

    Raises ConfigurationError for fewer than three changes, and what `channel_change` raises.
    """
    different = {one.digest: one for one in earlier}.values()
    pairs = [
        (old, new)
        for new in calibrations
        for old in different
        if (old.response.patch, old.response.point) == (new.response.patch, new.response.point)
    ]
    if len(pairs) < _FEWEST:
        raise ConfigurationError(
            f"There are {len(pairs)} earlier calibrations of the same patches at the same point, and the "
            f"scatter of channels needs {_FEWEST}: one of each of three patches, or more of one."
        )
    changes = [channel_change(old, new) for old, new in pairs]
    spans = [_time(new) - _time(old) for old, new in pairs]
    free = max(len(pairs) - 2, 1)
    scatter = ChannelScatter(
        gain=float(np.sqrt(sum(one.gain**2 for one in changes) / free)),
        delay=float(np.sqrt(sum(one.delay**2 for one in changes) / free)),
        changes=len(pairs),
        seconds=max(spans),
    )
    return [replace(one, scatter=scatter) for one in calibrations]


@dataclass(frozen=True, eq=False)
class _Fit:
    """`x` is gain, delay, and each mode's shift and damping, relative; changes are per linear volt."""

    model: Model
    numbers: IntArray
    """(poles,): mode of each pole; -1 for one that stays."""
    s: ComplexArray
    path: ComplexArray
    """(lines,): volts at the patch per linear volt commanded."""
    was: ComplexArray

    @classmethod
    def of(cls, calibration: Calibration, f: FloatArray) -> _Fit:
        [numbers] = modes_of([calibration.model])
        s = np.asarray(2j * np.pi * f, dtype=np.complex128)
        path = _path(calibration, f)
        return cls(calibration.model, numbers, s, path, path * calibration.model.velocity(f))

    @property
    def modes(self) -> int:
        return int(self.numbers.max()) + 1

    def change(self, x: FloatArray) -> ComplexArray:
        """(lines,): change of the response."""
        return np.asarray(self._late(x) * self._moved(x).velocity(self.s.imag / (2 * np.pi)) - self.was)

    def step(self, x: FloatArray, seen: ComplexArray) -> FloatArray:
        """What a Gauss-Newton step adds to `x`, from the change that was `seen`."""
        late, moved = self._late(x), self._moved(x)
        H = late * moved.velocity(self.s.imag / (2 * np.pi))
        columns = [H / (1 + x[0]), -self.s * H]
        member = self.numbers[:, None] == np.arange(self.modes)
        by_mode = [late[:, None] * (one @ member) for one in pole_slopes(moved, self.s.imag / (2 * np.pi))]
        slope = np.column_stack([*columns, np.hstack(by_mode) / (1 + x[2:])])
        prior = np.repeat([_SHIFT, _DAMPING], self.modes)
        scale = np.concatenate([[1.0, 1e-6], prior])
        weight = 1 / (_MISFIT * np.linalg.norm(self.was))
        missed = weight * (seen - self.change(x))
        rows = weight * slope * scale
        pull = np.diag(np.concatenate([[0.0, 0.0], np.ones(2 * self.modes)]))
        left = np.concatenate([missed.real, missed.imag, -pull @ (x / scale)])
        solved = np.linalg.lstsq(np.concatenate([rows.real, rows.imag, pull]), left, rcond=None)[0]
        return np.asarray(scale * solved)

    def _late(self, x: FloatArray) -> ComplexArray:
        return np.asarray(self.path * (1 + x[0]) * np.exp(-self.s * x[1]))

    def _moved(self, x: FloatArray) -> Model:
        p, own = self.model.poles, self.numbers >= 0
        turned, damped = (np.where(own, part[self.numbers], 0.0) for part in np.split(x[2:], 2))
        return replace(self.model, poles=(1 + turned) * (p.real * (1 + damped) + 1j * p.imag))


def _commanded(calibration: Calibration, f: FloatArray) -> ComplexArray:
    """(lines,) m/s per linear volt commanded, as measured."""
    response = calibration.response
    return np.asarray(np.interp(f, response.frequencies, response.velocity) * _path(calibration, f))


def _path(calibration: Calibration, f: FloatArray) -> ComplexArray:
    """(lines,): volts at the patch per linear volt commanded."""
    response = calibration.response
    lag = calibration.hysteresis.gain(response.level)
    return np.asarray(np.interp(f, response.frequencies, response.path) / lag)


def _time(calibration: Calibration) -> float:
    return datetime.fromisoformat(calibration.response.created).timestamp()
