"""Scatter of the channels of an amplifier: how their gains and delays differ between calibrations.

Model: what a channel and its patch add to the table is one gain and one delay over all frequencies, so that
two calibrations of a patch at a point differ by H g - H j w t beside what the table's modes did. Both are
told from a drift of the modes, whose frequencies and dampings are fitted with them, as a mode changes the
response near its resonance only. Measured responses are compared, not models: what a model leaves out is in
both. Gains are of linear volts commanded, so that amplifier, cable, monitor, patch and law are in them. The
changes of all channels count as one sample of their scatter, about zero; the next change is then expected to
have the mean square of Student's t. What breaks it: modes that moved by more than their width, or shapes that
changed; then more is left than noise and drift explain, and nothing is stated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np

from ...base.arrays import ComplexArray, FloatArray, IntArray
from ...base.errors import ConfigurationError, DataError
from .calibration import Calibration, ChannelScatter
from .drift import modes_of, pole_slopes
from .model import Model

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
