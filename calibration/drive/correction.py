"""Update of a response estimate from plays, and the correction of a drive computed from it.

Every play updates a stale response by a Kalman step on each line, weighted by the excitation of that
line against the plays' noise and the distortion that no response describes. A correction is planned
within the limits, as the drive itself is, for all points of the drive at once; error hidden by the plays'
noise is not corrected, and the correction stays as close to the played drive as the response's uncertainty
demands.
After Bristow, Tharayil and Alleyne, "A survey of iterative learning control", IEEE Control Systems
Magazine 26, 2006 (norm-optimal learning; here with its weights from measured variances).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray
from ...base.filters import fast_length
from ...instruments import Limits
from ..spectra import fade, resample
from .actuation import Actuation
from .drive import Drive
from .inversion import spread, within
from .planning import plan_for
from .playing import Played
from .targets import FADE

_DISTORTION = 0.02
"""Share of a patch's motion that even a correct response does not describe: its hysteresis, an amplifier's
nonlinearity. At a silent point the motions of the patches cancel, and these shares do not."""
_CAUTION = 1e-3
"""Penalty for a change of the drive, over the median power of the gain: every change, even on lines that
move nothing, passes through the patch's hysteresis and adds a little of its error."""
_POOL_HZ = 6.0
"""Width (Hz) of the neighbouring lines whose power is averaged."""
_CLEAR = 3.0
"""Standard deviations by which an error exceeds the plays' noise where it is corrected. Noise grows with the
square of the frequency: what of it looked like an error would be played, as motion beyond the band."""
_LISTEN = 0.5
"""Longest recording after a drive (s): a drive leaves the table nearly still."""
_PLAN_RATE = 5000.0
"""Sample rate (samples/s) at which corrections are planned."""
_NEAR_HZ = 50.0
"""How far (Hz) a resonance may have moved: 8 % at the upper end of the band."""
_TRIES = 8
"""Attempts at a lower limit."""


@dataclass(frozen=True, eq=False)
class ResponseEstimate:
    """Estimated response from linear volts to acceleration, for one drive's targets.

    `gain` is (points, patches, lines) m/s^2 per linear volt, `covariance` (points, patches, patches, lines)
    its covariance: of the conjugate of each row's patch with each column's.
    """

    drive: Drive
    table: Actuation
    grid: _Grid
    gain: ComplexArray
    covariance: ComplexArray
    last: tuple[ComplexArray, ComplexArray, FloatArray] | None = None
    """The latest play: linear volts (patches, lines), acceleration, and its noise power, (points, lines)
    each."""

    @classmethod
    def of(cls, drive: Drive, table: Actuation) -> ResponseEstimate:
        """The prior from the calibrations, before any play."""
        grid = _Grid.of(drive, table)
        f = grid.frequencies
        return cls(drive, table, grid, table.gain(f), table.covariance(f))

    @property
    def tail(self) -> float:
        """Recording time (s) after the drive."""
        grid = self.grid
        return min(_LISTEN, grid.samples / grid.rate_hz - grid.played / self.drive.rate_hz)

    def after(self, volts: FloatArray, played: Sequence[Played]) -> ResponseEstimate:
        """The estimate updated by plays, seen at each point: the first directly, later ones by the change.

        Each is weighted by its noise and by the distortion that no response describes.
        """
        linear_volts, motion, noise = self._spectra(volts, played)
        if self.last is None:
            estimate = self._corrected(linear_volts, motion, noise)
        else:
            before, moved, old = self.last
            estimate = self._corrected(linear_volts - before, motion - moved, noise + old)
        return replace(estimate, last=(linear_volts, motion, noise))

    def correction(
        self, volts: FloatArray, played: Sequence[Played], step: float, limits: Limits
    ) -> tuple[FloatArray, float]:
        """Volts expected to be closer to the targets than `volts`, and the expected improvement.

        The remaining error of the plays of `volts`, seen at each point, is corrected within the limits, as
        far as it exceeds their noise and as the response is certain; the share `step` of the change is
        applied. Returns (patches, samples) V, and the expected decrease of the squared error, over the
        target's: the sum over the points.
        """
        grid, table, drive = self.grid, self.table, self.drive
        linear_volts, motion, noise = self._spectra(volts, played)
        targets = grid.down(np.array([drive.target, *(one.target for one in drive.elsewhere)]))
        plan = plan_for(table, targets, grid, drive.band, limits, drive.drift)
        missed = plan.target - motion
        power = grid.pooled(np.abs(missed) ** 2)
        hidden = noise * (1 + _CLEAR * grid.scatter(min(len(one.accelerations) for one in played)))
        missed *= np.maximum(0.0, 1 - hidden / np.maximum(power, 1e-30))

        limit = float(table.reach(limits).max())
        plan = replace(
            plan,
            gain=self.gain,
            covariance=self.covariance,
            operating_point=linear_volts,
            beside=plan.target - missed - self._moved(linear_volts),
            ridge=_CAUTION,
        )
        now = table.linear(volts)
        _, state = within(plan, limit)
        for _ in range(_TRIES):
            planned, state = within(plan, limit, state)
            changed = now + step * grid.up(planned - np.fft.irfft(linear_volts, grid.samples))
            new = table.commanded(changed, grid.smooth)
            headroom, _ = table.headroom(new, limits)
            if headroom >= 1:
                break
            # Between the plan's samples, and by the hysteresis, the volts exceed the plan.
            limit *= headroom * 0.998
        # A lower limit does not always help: then the whole drive is scaled down, by some thousandths.
        while headroom < 1:
            changed *= headroom * (1 - 1e-6)
            new = table.commanded(changed, grid.smooth)
            headroom, _ = table.headroom(new, limits)
        taken = plan.left(linear_volts) - plan.left(self._linear_volts(new))
        return new, taken / plan.wanted

    def _corrected(
        self, linear_volts: ComplexArray, motion: ComplexArray, noise: FloatArray
    ) -> ResponseEstimate:
        pooled = self.grid.pooled
        drive_power = (np.abs(linear_volts) ** 2).sum(axis=0)
        each = (np.abs(self.gain * linear_volts) ** 2).sum(axis=1)
        error = noise + _DISTORTION**2 * pooled(each)
        unexpected = motion - self._moved(linear_volts)
        # Where a table has changed, the error of the response exceeds its stated covariance.
        surprise = pooled(np.abs(unexpected) ** 2 - error)
        seen = surprise / np.maximum(pooled(drive_power), 1e-30)
        # A line that was hardly driven would suggest an error larger than the gain: it is bounded.
        seen = np.minimum(seen, self.grid.highest(np.abs(self.gain).max(axis=1)) ** 2)
        stated = spread(self.covariance, linear_volts) / np.maximum(drive_power, 1e-30)
        more = np.maximum(np.where(surprise > error, seen, 0.0) - stated, 0.0)
        covariance = self.covariance + more[:, None, None] * np.eye(len(linear_volts))[:, :, None]
        # A Kalman step: one motion of each point is measured, and corrects each patch by its share in what
        # was uncertain.
        shares = np.einsum("qprl,rl->qpl", covariance, linear_volts)
        known = shares / np.maximum(spread(covariance, linear_volts) + error, 1e-30)[:, None]
        gain = self.gain + known.conj() * unexpected[:, None]
        return replace(self, gain=gain, covariance=covariance - known[:, :, None] * shares[:, None].conj())

    def _moved(self, linear_volts: ComplexArray) -> ComplexArray:
        """(points, lines): expected acceleration."""
        return np.asarray(np.einsum("qpl,pl->ql", self.gain, linear_volts))

    def _spectra(
        self, volts: FloatArray, played: Sequence[Played]
    ) -> tuple[ComplexArray, ComplexArray, FloatArray]:
        """Linear volts (patches, lines), mean acceleration, and noise power left in it, (points, lines)."""
        motions = np.array(
            [
                [
                    np.fft.rfft(self.grid.sampled(a, self.drive.rate_hz / one.rate_hz))
                    for a in one.accelerations
                ]
                for one in played
            ]
        )
        noise = self.grid.pooled(np.var(motions, axis=1, ddof=1) / motions.shape[1])
        return self._linear_volts(volts), motions.mean(axis=1), noise

    def _linear_volts(self, volts: FloatArray) -> ComplexArray:
        """(patches, lines) linear volts of commanded volts."""
        linear_volts = self.table.linear(volts)
        samples = linear_volts.shape[1]
        # The offset that hysteresis leaves at the end is removed slowly, far below the band, without a step.
        linear_volts -= linear_volts[:, -1:] * fade(samples, samples, 0)
        return np.asarray(np.fft.rfft(self.grid.down(linear_volts)))


@dataclass(frozen=True, eq=False)
class _Grid:
    """The drive's samples, and the coarser grid that corrections are planned on: one period, two rates."""

    played: int
    """Samples of the drive."""
    factor: int
    """Samples of the drive for each of the grid."""
    samples: int
    """Samples of the grid: the drive, and the ringing after it."""
    rate_hz: float
    """Sample rate of the grid."""
    smooth: FloatArray
    """(played,): the drive's faded ends."""

    @classmethod
    def of(cls, drive: Drive, table: Actuation) -> _Grid:
        played = len(drive.target)
        factor = max(1, int(drive.rate_hz // _PLAN_RATE))
        ringing = table.ringing * drive.rate_hz
        edge = round(FADE * drive.rate_hz)
        samples = fast_length(int(np.ceil((played + ringing) / factor)))
        return cls(played, factor, samples, drive.rate_hz / factor, fade(played, edge, edge))

    @property
    def frequencies(self) -> FloatArray:
        """Frequencies (Hz) of the grid's lines."""
        return np.asarray(np.arange(self.samples // 2 + 1) * self.rate_hz / self.samples)

    @property
    def window(self) -> FloatArray:
        """(samples,): `smooth`, and zero during the ringing."""
        return np.clip(self.down(self.smooth), 0.0, 1.0)

    def down(self, signal: FloatArray) -> FloatArray:
        """(..., played or more) at the drive's rate to (..., samples), band-limited."""
        return self.sampled(signal, 1.0)

    def sampled(self, signal: FloatArray, slower: float) -> FloatArray:
        """(..., any) at the drive's rate over `slower` to (..., samples), band-limited; zero after it."""
        length = round(self.samples * self.factor / slower)
        kept = signal[..., :length]
        padded = np.zeros((*kept.shape[:-1], length))
        padded[..., : kept.shape[-1]] = kept
        return resample(padded, self.samples)

    def up(self, signal: FloatArray) -> FloatArray:
        """(..., samples) to the drive's (..., played)."""
        return resample(signal, self.samples * self.factor)[..., : self.played]

    def highest(self, gain: FloatArray) -> FloatArray:
        """The largest gain (..., lines) near each line: as large as a resonance that moved makes it there."""
        lines = 2 * round(_NEAR_HZ * self.samples / self.rate_hz) + 1
        return np.asarray(scipy.ndimage.maximum_filter1d(gain, lines, mode="nearest"))

    @property
    def pool(self) -> int:
        """Number of neighbouring lines whose power is averaged."""
        return max(1, round(_POOL_HZ * self.samples / self.rate_hz))

    def pooled(self, power: FloatArray) -> FloatArray:
        """Power (..., lines) averaged over neighbouring lines."""
        return np.asarray(scipy.ndimage.uniform_filter1d(power, self.pool, mode="nearest"))

    def scatter(self, plays: int) -> float:
        """Standard deviation of pooled noise in the mean of plays, over what they tell of its power."""
        return float(np.sqrt((1 + 1 / (plays - 1)) / self.pool))
