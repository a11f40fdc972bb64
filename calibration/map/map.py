"""The vibration map: responses of every point of the table to each patch, and to all together.

It is computed from the folder that `measure_map` fills. All points share the table's modes, so every play
contributes to their estimate; each point's modal amplitudes then follow by linear least squares. "All
patches" is the sum over patches; superposition is tested at the points where all were played in parallel.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from ...base import hdf5
from ...base.arrays import ComplexArray, FloatArray, IntArray
from ...base.errors import DataError
from ...base.notebook import InNotebook
from ...instruments import RigFile
from ..model import PlateModes
from ..response import HALF_WIDTHS, Hysteresis, Modes, Plays, fit_modes, operators
from .folder import MapFolder, MapPlan, PointMeasurement

ALL = "all"
"""The configuration of all patches in parallel."""
BAND = (30.0, 600.0)
"""Band (Hz) in which a map is compared and searched."""
_WHOLE = 0.75
"""Least share of the grid's points from which the shapes of a pane are known."""
_BEYOND = 1.3
"""Highest frequency of a mode that is used, over the upper end of the band."""
_WEAK, _ALIKE = 0.003, 0.7
"""Strength of a mode over the strongest's, below which it is none, and mean product of two shapes of a mean
square of one, above which they are one: poles that describe what a mode leaves had 0.97 and more
(simulated)."""
_FINE = 50
"""Samples per period of the highest frequency at which hysteresis is simulated."""


@dataclass(frozen=True)
class Best:
    """Patch, point and frequency of the strongest vibration; `displacement` is m per V at the patch."""

    patch: str
    point: str
    frequency_hz: float
    displacement: float


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A cached fit, beside the measurements that it was computed from."""

    sources: str
    """SHA-256 over the measurements."""
    poles: ComplexArray
    weights: FloatArray
    shares: FloatArray
    gains: ComplexArray
    residual: FloatArray
    superposition: FloatArray
    drift: FloatArray


@dataclass(frozen=True, eq=False)
class VibrationMap(InNotebook):
    """Responses of all measured points to all patches.

    `shares` is (patches, points, unknowns) of `modes`, per linear volt; `gains` (patches,) are the
    linear volts per volt of a sine of `plan.level` volts, lag included: together they are the response of
    a sweep at this level.

    For example:

        >>> haploop.calibration.VibrationMap.load("map").points
        ('0',)
    """

    plan: MapPlan
    points: tuple[str, ...]
    """Measured points, in the plan's order."""
    skipped: tuple[tuple[str, str], ...]
    """Points not measured, each with the reason."""
    modes: Modes
    shares: FloatArray
    gains: ComplexArray
    residual: FloatArray
    """(points,): relative rms residual of the measured velocity after the fit of the modes."""
    superposition: tuple[tuple[str, float], ...]
    """Points where all patches were played in parallel, and the relative rms difference over the band
    between the response measured there and the sum over patches."""
    drift: FloatArray
    """Relative shift of all frequencies at each repeated measurement of the first point."""
    table_seconds: float
    """Time that the table was in use (s), connecting and disconnecting included."""
    content: str
    """SHA-256 over the measurements."""
    created: str
    """Time of the latest measurement, ISO 8601, UTC."""

    def __repr__(self) -> str:
        plan = self.plan
        simulated = ", simulated" if plan.simulated else ""
        return (
            f"<VibrationMap {plan.rig}: {len(self.points)} of {len(plan.points)} points, patches "
            f"{', '.join(plan.patches)}{simulated}>"
        )

    @classmethod
    def load(cls, path: str | Path) -> VibrationMap:
        """Load the map in a folder, complete or not.

        The fit is cached in the folder, and repeated when measurements were added. Raises
        DataError when there is no map, a measurement is damaged, or nothing was measured.
        """
        folder = MapFolder.open(Path(path))
        plan = folder.plan
        found = {step: folder.read(step) for step in plan.steps}
        measurements = {step.name: r for step, r in found.items() if r is not None}
        first = [r for step, r in found.items() if r is not None and not step.again]
        again = [r for step, r in found.items() if r is not None and step.again]
        if not first:
            raise DataError(f"{path} holds no measured point yet.")
        digests = [hdf5.digest_of(r) for r in measurements.values()]
        sources = hashlib.sha256("".join(digests).encode())
        kept = folder.path / f"modes-{sources.hexdigest()[:16]}.h5"
        if kept.is_file():
            fitted = hdf5.restore(_Fitted, hdf5.read(kept, "map modes"), kept)
        else:
            with threadpool_limits(1):
                fitted = _fit(plan, first, again, sources.hexdigest())
            hdf5.write(kept, "map modes", hdf5.flatten(fitted))
        tested = [r.point for r in first if ALL in r.plays]
        return cls(
            plan=plan,
            points=tuple(r.point for r in first),
            skipped=tuple(folder.skipped().items()),
            modes=Modes(fitted.poles, fitted.weights),
            shares=fitted.shares,
            gains=fitted.gains,
            residual=fitted.residual,
            superposition=tuple(zip(tested, map(float, fitted.superposition), strict=True)),
            drift=fitted.drift,
            table_seconds=float(sum(r.seconds for r in measurements.values())),
            content=fitted.sources,
            created=max(r.created for r in measurements.values()),
        )

    @property
    def configurations(self) -> tuple[str, ...]:
        """The patches, and "all" if there are several."""
        return (*self.plan.patches, ALL) if len(self.plan.patches) > 1 else self.plan.patches

    def velocity(self, configuration: str, frequencies: FloatArray) -> ComplexArray:
        """(points, frequencies) m/s per V at the patch, or at all patches. Raises DataError."""
        if configuration == ALL:
            return np.asarray(sum(self.velocity(patch, frequencies) for patch in self.plan.patches))
        if configuration not in self.plan.patches:
            raise DataError(
                f"The map has no patch {configuration!r}: it has {', '.join(self.configurations)}."
            )
        index = self.plan.patches.index(configuration)
        return np.asarray(self.gains[index] * self.modes.velocity(self.shares[index], frequencies))

    def displacement(self, configuration: str, frequencies: FloatArray) -> ComplexArray:
        """(points, frequencies) m per V, as in the paper's maps."""
        return np.asarray(self.velocity(configuration, frequencies) / (2j * np.pi * np.asarray(frequencies)))

    def grid(self, values: FloatArray) -> FloatArray:
        """Arrange (points,) as (rows, columns) of the table; NaN where nothing was measured."""
        whole = np.full(self.plan.rows * self.plan.columns, np.nan)
        whole[[int(point) for point in self.points]] = values
        return whole.reshape(self.plan.rows, self.plan.columns)

    def best(self, low: float = 200.0, high: float = 320.0, patches: Sequence[str] | None = None) -> Best:
        """The patch, point and frequency (Hz, within `low` to `high`) of the largest acceleration.

        Single patches are compared unless configurations are named. The default band lies around 250 Hz,
        where skin is most sensitive (paper, "Experimental Setup"). Acceleration is compared because
        drives reproduce it; displacement is largest at the lowest mode, where it is hardly felt.
        """
        f = np.arange(low, high, 0.25)
        found: list[tuple[float, Best]] = []
        for patch in self.plan.patches if patches is None else patches:
            size = np.abs(self.displacement(patch, f))
            point, line = np.unravel_index(int(np.argmax(size * f**2)), size.shape)
            best = Best(patch, self.points[point], float(f[line]), float(size[point, line]))
            found.append((float(size[point, line] * f[line] ** 2), best))
        return max(found, key=lambda one: one[0])[1]

    def resonances(self) -> tuple[tuple[float, float], ...]:
        """Natural frequency (Hz) and damping ratio of each mode within the band, strongest first.

        Strength is the peak velocity of the mode alone, over all points and patches.
        """
        p = self.modes.poles
        hz = np.abs(p) / (2 * np.pi)
        order = [int(np.argmin(np.abs(hz - one))) for one, _ in self._strengths(*BAND)]
        return tuple((float(hz[k]), float(-p.real[k] / abs(p[k]))) for k in order)

    def _strengths(self, low: float, high: float) -> list[tuple[float, float]]:
        """Frequency (Hz) and strength of each mode between two frequencies, strongest first."""
        p = self.modes.poles
        count = len(p)
        residues = self.shares[..., :count] + 1j * self.shares[..., count : 2 * count]
        strength = np.sqrt((np.abs(residues) ** 2).sum(axis=(0, 1))) / -p.real
        hz = np.abs(p) / (2 * np.pi)
        order = [k for k in np.argsort(-strength) if low < hz[k] < high and strength[k] > 0]
        return [(float(hz[k]), float(strength[k])) for k in order]

    def shape(self, frequency_hz: float) -> FloatArray:
        """Shape (points,) of the mode nearest to a frequency: real, with a largest deflection of 1."""
        p = self.modes.poles
        k = int(np.argmin(np.abs(np.abs(p) / (2 * np.pi) - frequency_hz)))
        residues = self.shares[..., k] + 1j * self.shares[..., len(p) + k]
        # Residues of a mode differ between patches by one factor: the first singular vector is the shape.
        _, _, rows = np.linalg.svd(residues, full_matrices=False)
        mode = rows[0] * np.exp(-0.5j * np.angle((rows[0] ** 2).sum()))
        return np.asarray(mode.real / mode.real[int(np.argmax(np.abs(mode.real)))])

    def plate_modes(self) -> PlateModes:
        """The modes of the pane, for `calibrate_finger`: strongest first, and each shape once.

        Shapes of different modes of a pane have nothing in common; a pole whose shape is that of a stronger
        mode describes what that one leaves. Raises DataError for a map of less than three quarters of the
        grid: what a shape is over the pane is then not known.
        """
        plan, p = self.plan, self.modes.poles
        grid = plan.rows * plan.columns
        if len(self.points) < _WHOLE * grid:
            raise DataError(
                f"The map has {len(self.points)} of {grid} points: the modes of the pane need {_WHOLE:.0%} "
                "of them. "
                "Measure more of it (haploop map)."
            )
        table = RigFile.model_validate_json(plan.rig_file).table
        assert table is not None  # it was measured on it
        strongest = 0.0
        poles: list[complex] = []
        shapes: list[FloatArray] = []
        for frequency_hz, strength in self._strengths(plan.low, _BEYOND * plan.high):
            strongest = strongest or strength
            shape = self.shape(frequency_hz)
            shape = shape / np.sqrt(np.mean(shape**2))
            if strength < _WEAK * strongest or any(abs(np.mean(shape * one)) > _ALIKE for one in shapes):
                continue
            poles.append(complex(p[int(np.argmin(np.abs(np.abs(p) / (2 * np.pi) - frequency_hz)))]))
            shapes.append(shape)
        if not poles:
            raise DataError("The map has no mode: look at its resonances (haploop show).")
        button = str(table.button_point)
        return PlateModes(self.points, button, np.array(poles), np.array(shapes), self.residual)


def _fit(
    plan: MapPlan, first: list[PointMeasurement], again: list[PointMeasurement], sources: str
) -> _Fitted:
    samples = plan.parallel.samples(plan.rate_hz)
    f = np.arange(samples // 2 + 1) * plan.rate_hz / samples
    lines = np.flatnonzero((f >= plan.low) & (f <= plan.high))
    f = f[lines]
    groups = ("each",) if plan.together else plan.patches
    plays = [_plays(plan, first, name, f, lines) for name in groups]
    modes = fit_modes(plays, len(plan.patches))
    found = [modes.shares(one) for one in plays]
    shares = np.concatenate([np.swapaxes(own, 1, 2) for own, _ in found])
    residual = np.sqrt(np.mean([left**2 for _, left in found], axis=0))
    gains = _gains(plan, modes)
    tested = [r for r in first if ALL in r.plays]
    differences = []
    if tested:
        parallel = _plays(plan, tested, ALL, f, lines)
        law = Modes(modes.poles, np.repeat(modes.weights.mean(axis=0)[None], len(plan.patches), axis=0))
        own = law.shares(parallel)[0][0].T
        inside = f[(f >= BAND[0]) & (f <= BAND[1])]
        rows = [[r.point for r in first].index(r.point) for r in tested]
        scale = np.sqrt(np.mean(np.abs(gains) ** 2))
        together = law.velocity(own, inside) * scale * _phase(gains)
        summed = sum(g * modes.velocity(s[rows], inside) for g, s in zip(gains, shares, strict=True))
        differences = list(np.linalg.norm(together - summed, axis=1) / np.linalg.norm(summed, axis=1))
    drift = [modes.shift(_plays(plan, [r], groups[0], f, lines)) for r in again]
    return _Fitted(
        sources=sources,
        poles=modes.poles,
        weights=modes.weights,
        shares=shares,
        gains=gains,
        residual=residual,
        superposition=np.array(differences),
        drift=np.array(drift),
    )


def _phase(gains: ComplexArray) -> complex:
    total = complex(gains.sum())
    return total / abs(total)


def _plays(
    plan: MapPlan, points: Sequence[PointMeasurement], name: str, f: FloatArray, lines: IntArray
) -> Plays:
    """One kind of play at several points, scaled to the mean drive of all points."""
    drives, velocities = [], []
    for point in points:
        number = point.plays.index(name)
        drives.append([d for d, (play, _) in zip(point.drives, point.rows, strict=True) if play == number])
        velocities.append(point.velocity[number])
    own = np.array(drives)
    mean = own.mean(axis=0)
    gain = np.einsum("pkl,kl->p", own, mean.conj()) / (np.abs(mean) ** 2).sum()
    patches = plan.patches if name in ("each", ALL) else (name,)
    inputs = np.array([_operators(plan, drive, lines) for drive in mean])
    if name == ALL:
        # All patches together count as one patch with the mean of their drives.
        patches, inputs = plan.patches[:1], inputs.mean(axis=0)[None]
    indices = tuple(plan.patches.index(patch) for patch in patches)
    return Plays(f, indices, inputs, (np.array(velocities) / gain[:, None]).T, rings=not plan.swept)


def _operators(plan: MapPlan, drive: ComplexArray, lines: IntArray) -> ComplexArray:
    """(operators, lines): components of the linear volts of a periodic drive, which is given by its lines."""
    first, last = int(lines[0]), int(lines[-1])
    count = int(_FINE * plan.high * plan.period)
    coarse = plan.parallel.samples(plan.rate_hz)
    spectrum = np.zeros(count // 2 + 1, dtype=np.complex128)
    spectrum[first : last + 1] = drive
    volts = np.fft.irfft(spectrum, count) * (count / coarse)
    # In the second period the operators start from their state at the end of the first.
    bent = operators(np.tile(volts, 2), plan.level)[:, count:]
    return np.asarray(np.fft.rfft(bent)[:, first : last + 1] * (coarse / count))


def _gains(plan: MapPlan, modes: Modes) -> ComplexArray:
    """(patches,): linear volts per volt of a sine of the plan's level, with the fitted hysteresis."""
    radii = HALF_WIDTHS * plan.level
    # The square of a sine has no first harmonic, so its weight is left out.
    return np.array([Hysteresis(radii, own[:-1], plan.level).gain(plan.level) for own in modes.weights])
