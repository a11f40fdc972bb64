"""Actuation: acceleration of points per linear volt of patches, and volts to command for linear volts.

Drives are planned in linear volts (the volts that would produce the same motion without the patches'
hysteresis), because the table is linear in them; `commanded` converts them to volts to command.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import ConfigurationError, DataError
from ...base.filters import fast_length
from ..model import Calibration, Drift, apart, mode_deviations, standard_deviation
from ..response import Response

if TYPE_CHECKING:
    from ...instruments import Limits

_SETTLED = 0.2
"""Seconds in which the decay that a coupling capacitor adds to the end of a drive dies out."""

_LEAST_COHERENCE = 0.8
_APART = 0.002
"""Difference of resonances between calibrations beyond which they are not planned with. On 12 simulated
tables calibrations of one table differed by 0.00001, of two by 0.003 or more. Of four patches with one that
was calibrated after a drift of 1 %, the error was 16.6 % of 2.5; on another table, 37 %."""
_LINES = 2000
"""Lines over which a change is averaged."""

_Values = TypeVar("_Values", FloatArray, ComplexArray)


@dataclass(frozen=True, eq=False)
class Actuation:
    """Calibrations of `patches` at `points`: rows of points, of each patch in turn.

    The first point is the one that has the press. A patch's law and path are those of its calibration there.
    """

    patches: tuple[str, ...]
    points: tuple[str, ...]
    rows: tuple[tuple[Calibration, ...], ...]

    @classmethod
    def of(
        cls, calibration: Calibration | Sequence[Calibration], elsewhere: Collection[str] = ()
    ) -> Actuation:
        """Order calibrations by patch, as they come first, and by point: those of `elsewhere` last.

        Raises ConfigurationError when a pair is missing or there twice, when they are not of one rig or of
        one state of its table, and what `_before` raises.
        """
        calibrations = [calibration] if isinstance(calibration, Calibration) else calibration
        by_place = {(c.response.patch, c.response.point): c for c in calibrations}
        patches = tuple(dict.fromkeys(patch for patch, _ in by_place))
        points = tuple(dict.fromkeys(point for _, point in by_place))
        if not by_place:
            raise ConfigurationError("A drive needs a calibration, of each patch at each point.")
        if len(by_place) < len(calibrations):
            places = [(c.response.patch, c.response.point) for c in calibrations]
            patch, point = next(place for place in places if places.count(place) > 1)
            raise ConfigurationError(
                f"{places.count((patch, point))} calibrations of patch {patch} at the {point} point were "
                "given, and a drive takes one: leave the others out."
            )
        for patch in patches:
            for point in points:
                if (patch, point) not in by_place:
                    raise ConfigurationError(
                        f"There is no calibration of patch {patch} at the {point} point, and of others there "
                        "is: calibrate each patch at each point."
                    )
        made = {(c.response.rig, c.response.simulated, c.rate_hz) for c in calibrations}
        if len(made) > 1:
            raise ConfigurationError(
                f"The calibrations are of {len(made)} rigs ({', '.join(sorted(rig for rig, *_ in made))}): "
                "patches of one table are calibrated on one rig."
            )
        _refuse_fingers(calibrations)
        _refuse_one_place(points, calibrations[0].response)
        _refuse_apart(list(by_place.values()))
        rows = tuple(tuple(by_place[patch, point] for patch in patches) for point in points)
        return cls(patches, points, rows)._before(elsewhere)

    def _before(self, elsewhere: Collection[str]) -> Actuation:
        """The first point that is not elsewhere, and those that are.

        Raises ConfigurationError for more points than patches, for one without a calibration, and where other
        points are calibrated that nobody names.
        """
        if len(elsewhere) >= len(self.patches):
            raise ConfigurationError(
                f"{len(elsewhere) + 1} points cannot be moved or kept silent at once by {len(self.patches)} "
                "patches: each point takes a patch of its own."
            )
        if unknown := [point for point in elsewhere if point not in self.points]:
            raise ConfigurationError(
                f"No patch was calibrated at the {unknown[0]} point: there are calibrations of "
                f"{', '.join(self.points)}. Calibrate each patch there, or take the point from a map."
            )
        own = [point for point in self.points if point not in elsewhere]
        if not own:
            raise ConfigurationError(
                f"Every calibrated point ({', '.join(self.points)}) is to be silent or to play a press of "
                "its own, and none is left for the button."
            )
        if len(own) != 1:
            raise ConfigurationError(
                f"One point is to have the press, and {len(own)} of the calibrated ones are left for it "
                f"({', '.join(own)}): name what the others are for, or leave them out."
            )
        points, by_point = (*own, *elsewhere), dict(zip(self.points, self.rows, strict=True))
        return Actuation(self.patches, points, tuple(by_point[point] for point in points))

    @property
    def own(self) -> tuple[Calibration, ...]:
        """(patches,): the calibrations at the first point."""
        return self.rows[0]

    @property
    def rate_hz(self) -> float:
        """Sample rate of drives."""
        return self.own[0].rate_hz

    @property
    def digest(self) -> str:
        """Content hash of all inputs to a drive, whichever point is the first; of one calibration its own."""
        digests = sorted(c.digest for row in self.rows for c in row)
        return digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()

    @property
    def carriers(self) -> tuple[float, ...]:
        """Of each point, the resonance (Hz) of the patch that moves it most there: it carries buttons."""
        most = (
            max(row, key=lambda c: abs(c.model.velocity(np.array([c.carrier_hz]))[0])) for row in self.rows
        )
        return tuple(one.carrier_hz for one in most)

    @property
    def known(self) -> tuple[float, float]:
        """Lowest and highest frequency (Hz) at which every response was measured.

        Beyond it a drive would move points in a way that nobody knows.
        """
        edges = np.array([known(c) for row in self.rows for c in row])
        return float(edges[:, 0].max()), float(edges[:, 1].min())

    def known_to(self, row: int, band: tuple[float, float]) -> float:
        """Standard deviation of the responses at a point within `band` (Hz), over them (rms)."""
        f = np.linspace(*band, _LINES)
        deviations, gains = ([of(c, f) for c in self.rows[row]] for of in (_deviation, _acceleration))
        return float(np.linalg.norm(deviations) / np.linalg.norm(gains))

    @property
    def ringing(self) -> float:
        """Seconds after which the slowest mode has fallen to a hundredth, 0.3 to 2."""
        found = [r for c in self.own for r in c.model.resonances]
        slowest = min(2 * np.pi * r.frequency_hz * r.damping for r in found)
        return float(np.clip(np.log(100) / slowest, 0.3, 2.0))

    def measured_well(self, band: tuple[float, float], points: Collection[str]) -> tuple[float, float]:
        """The part of `band` (Hz) in which every response at `points` was measured well.

        Raises DataError when there is none.
        """
        for point, row in zip(self.points, self.rows, strict=True):
            for calibration in row if point in points else ():
                band = measured_well(calibration.response, band)
        return band

    def gain(self, f: FloatArray) -> ComplexArray:
        """(points, patches, lines) m/s^2 per linear volt commanded, at `f` (Hz) within what is `known`.

        The model averages the sweeps' noise and contains the lag of hysteresis at the sweeps' level;
        that lag is removed. The path's gain is left out as well, because it acts before the
        hysteresis; its delay may stay, because hysteresis does not depend on time. Beyond the model's band it
        is the measured response itself.
        """
        return np.array([[_acceleration(c, f) for c in row] for row in self.rows])

    def covariance(self, f: FloatArray) -> ComplexArray:
        """(points, patches, patches, lines): covariance of `gain` as measured, each patch on its own.

        Of the models, and beyond their bands of the measured responses.
        """
        deviations = np.array([[_deviation(c, f) for c in row] for row in self.rows])
        return np.asarray(
            np.eye(len(self.patches))[None, :, :, None] * (deviations**2)[:, :, None] + np.zeros(1, complex)
        )

    def drifted(self, f: FloatArray, drift: Drift) -> ComplexArray:
        """(points, patches, patches, lines): covariance of `gain` between calibration and play.

        Of the conjugate of each row's patch with each column's; see `haploop.calibration.model.drift`.
        """
        every = [c for row in self.rows for c in row]
        low, high = max(c.model.band[0] for c in every), min(c.model.band[1] for c in every)
        shape = len(self.points), len(self.patches)
        found = np.zeros((*shape, shape[1], len(f)), dtype=np.complex128)
        inside, above = (f >= low) & (f <= high), (f > high) & (f <= self.known[1])
        models = [c.model for c in every]
        for lines, deviations in (
            (inside, mode_deviations(models, f[inside], drift)),
            (above, _stretched(every, f[above], drift)),
        ):
            moved = deviations * np.array([_per_linear_volt(c, f[lines]) for c in every])
            moved = moved.reshape(len(moved), *shape, int(lines.sum()))
            found[..., lines] = np.einsum("kqpl,kqrl->qprl", moved.conj(), moved)
        gains, delays = np.array([_channel(c, drift) for c in self.own]).T[:, :, None]
        size = gains**2 + (delays * 2 * np.pi * f) ** 2
        each = np.arange(shape[1])
        found[:, each, each] += np.abs(self.gain(f)) ** 2 * size
        return found

    def reach(self, limits: Limits) -> FloatArray:
        """(patches,): linear volts that the limits let each patch reach."""
        return np.array([c.hysteresis.reach(limits.peak * min(1.0, _path_gain(c))) for c in self.own])

    def linear(self, volts: FloatArray) -> FloatArray:
        """(patches, samples) linear volts of commanded volts."""
        each = zip(self.own, volts, strict=True)
        return np.array([c.hysteresis.to_linear_volts(v * _path_gain(c)) for c, v in each])

    def commanded(self, linear_volts: FloatArray, smooth: FloatArray) -> FloatArray:
        """(patches, samples) V to command for linear volts, with zero mean and zero ends.

        `smooth` (samples,) is a window that falls to zero at both ends.
        """
        each = zip(self.own, linear_volts, strict=True)
        volts = np.array([c.hysteresis.from_linear_volts(v) / _path_gain(c) for c, v in each])
        # At zero linear volts, hysteresis may leave a residual voltage; it fades out at the end.
        half = volts.shape[1] // 2
        volts[:, half:] -= volts[:, -1:] * (1 - smooth[half:])
        volts -= smooth * (volts.sum(axis=1, keepdims=True) / smooth.sum())
        return volts

    def headroom(self, volts: FloatArray, limits: Limits) -> tuple[float, str]:
        """The largest factor that keeps commanded volts within every limit, and the binding limit in words.

        Limits hold for the volts commanded and for those that reach each patch, which has a channel of its
        own.
        """
        each = [(v, _arriving(c, v)) for c, v in zip(self.own, volts, strict=True)]
        return min(limits.headroom(waveform, self.rate_hz) for pair in each for waveform in pair)


def _refuse_fingers(calibrations: Sequence[Calibration]) -> None:
    """Raise ConfigurationError for calibrations of which not all hold under the same person's finger."""
    fingers = dict.fromkeys(c.finger.participant if c.finger else None for c in calibrations)
    if len(fingers) > 1:
        held = " and ".join(f"under {one}'s finger" if one else "of the bare table" for one in fingers)
        raise ConfigurationError(
            f"The calibrations are {held}: give those of the bare table, or of one person's finger."
        )


def _refuse_one_place(points: Sequence[str], response: Response) -> None:
    """Raise ConfigurationError for the button's point and its own number as two points."""
    if "button" not in points or len(points) < 2 or not response.rig_file:
        return
    from ...instruments import RigFile  # noqa: PLC0415 - most drives are for one point

    table = RigFile.model_validate_json(response.rig_file).table
    number = str(table.button_point) if table else ""
    if number in points:
        raise ConfigurationError(
            f"Point {number} is the button point: one place cannot do two things. Name another point."
        )


def _refuse_apart(calibrations: Sequence[Calibration]) -> None:
    """Raise ConfigurationError for calibrations whose resonances are not those of one table on one day."""
    first, *others = calibrations
    for other in others:
        by = apart(first.model, other.model)
        if by > _APART:
            named = (
                f"patch {c.response.patch} at the {c.response.point} point ({c.response.created[:10]})"
                for c in (first, other)
            )
            raise ConfigurationError(
                f"The calibrations of {' and of '.join(named)} have resonances that differ by {by:.1%}: they "
                "are of two tables, or the table has drifted between them. Calibrate all patches one after "
                "another."
            )


def drift_change(
    calibrations: Sequence[Calibration], drift: Drift, band: tuple[float, float] = (75.0, 600.0)
) -> float:
    """Rms change of the responses within `band` (Hz) that a drift makes, over the responses' rms."""
    table, f = Actuation.of(calibrations), np.linspace(*band, _LINES)
    changed = float(np.trace(table.drifted(f, drift)[0]).real.sum())
    return float(np.sqrt(changed / (np.abs(table.gain(f)[0]) ** 2).sum()))


def known(calibration: Calibration) -> tuple[float, float]:
    """Lowest and highest frequency (Hz) at which the response was measured."""
    low, high = calibration.model.band
    above = calibration.above
    return low, high if above is None else float(above.frequencies[-1])


def measured_well(response: Response, band: tuple[float, float]) -> tuple[float, float]:
    """The part of `band` (Hz) between the first and last frequency with a coherence of 0.8 or more.

    Raises DataError when there is none.
    """
    coherence = response.coherence if len(response.coherence) else np.ones(len(response.frequencies))
    good = response.frequencies[coherence >= _LEAST_COHERENCE]
    low, high = (max(band[0], good[0]), min(band[1], good[-1])) if len(good) else (1.0, 0.0)
    if low >= high:
        raise DataError(
            f"The response of patch {response.patch} at the {response.point} point is too noisy for a "
            f"drive between {band[0]:g} and {band[1]:g} Hz: its coherence is "
            f"{float(coherence.max()):.2f} at best, and {_LEAST_COHERENCE} is needed."
        )
    return float(low), float(high)


def _acceleration(calibration: Calibration, f: FloatArray) -> ComplexArray:
    """(lines,) m/s^2 per linear volt commanded."""
    return _velocity(calibration, f) * _per_linear_volt(calibration, f)


def _channel(calibration: Calibration, drift: Drift) -> tuple[float, float]:
    """Standard deviations of the channel's gain and delay (s): those of the drift, or as it states them."""
    own = calibration.scatter
    return (own.gain if drift.gain is None else drift.gain, own.delay if drift.delay is None else drift.delay)


def _velocity(calibration: Calibration, f: FloatArray) -> ComplexArray:
    """(lines,) m/s per V at the patch."""
    return _joined(calibration, f, calibration.model.velocity(f), lambda above: above.velocity)


def _stretched(calibrations: Sequence[Calibration], f: FloatArray, drift: Drift) -> ComplexArray:
    """(deviations, calibrations, lines) m/s per V: what a drift of frequencies changes beyond the modes.

    It stretches the measured response. On one line a common drift and that of its mode look alike.
    """
    by = float(np.hypot(drift.common, drift.own))
    now, up, down = ([_velocity(c, f / (1 + s)) for c in calibrations] for s in (0.0, by, -by))
    return np.asarray((np.array([up, down]) - np.array(now)) / np.sqrt(2))


def _per_linear_volt(calibration: Calibration, f: FloatArray) -> ComplexArray:
    """(lines,): m/s^2 per linear volt commanded, over m/s per V at the patch."""
    lag = _path_gain(calibration) * calibration.hysteresis.gain(calibration.response.level)
    return np.asarray(2j * np.pi * f * _path(calibration, f) / lag)


def _deviation(calibration: Calibration, f: FloatArray) -> FloatArray:
    """(lines,): standard deviation of the gain."""
    low, high = calibration.model.band
    inside = standard_deviation(calibration, np.clip(f, low, high))
    deviation = _joined(calibration, f, inside, lambda above: above.deviation)
    return np.asarray(deviation * 2 * np.pi * f)


def _path_gain(calibration: Calibration) -> float:
    """Measured volts at the patch per volt commanded."""
    return float(np.median(np.abs(calibration.response.path)))


def _arriving(calibration: Calibration, volts: FloatArray) -> FloatArray:
    """(samples,) V that reach the patch, by the measured path.

    An AC-coupled output, such as a sound card's, shifts phases below 100 Hz, which can raise the peak at
    equal amplitudes.
    """
    rate_hz = calibration.rate_hz
    length = fast_length(len(volts) + round(_SETTLED * rate_hz))
    f = np.asarray(np.fft.rfftfreq(length, 1 / rate_hz), dtype=np.float64)
    return np.asarray(np.fft.irfft(np.fft.rfft(volts, length) * _path(calibration, f), length)[: len(volts)])


def _path(calibration: Calibration, f: FloatArray) -> ComplexArray:
    """Measured volts at the patch per volt commanded, at `f` (Hz)."""
    response = calibration.response
    inside = np.interp(f, response.frequencies, response.path)
    return _joined(calibration, f, inside, lambda above: above.path)


def _joined(
    calibration: Calibration, f: FloatArray, inside: _Values, of: Callable[[Response], _Values]
) -> _Values:
    """`inside`, given at `f` (Hz); beyond the middle of what both cover, a quantity of the response above."""
    above = calibration.above
    if above is None:
        return inside
    edge = (calibration.model.band[1] + above.frequencies[0]) / 2
    return np.asarray(np.where(f > edge, np.interp(f, above.frequencies, of(above)), inside))
