"""What plays say of a response, and the correction of a drive that follows from it.

A response that has gone stale is corrected by every play, by Kalman's rule on each line: as far as the
drive moved that line, less the plays' noise and the distortion that no response describes. A correction
is planned within the limits as the drive itself is; what the plays' noise hides is left alone, and it
goes no further from what was played than the response is known.
After Bristow, Tharayil and Alleyne, "A survey of iterative learning control", IEEE Control Systems
Magazine 26, 2006 (norm-optimal learning; here with its weights from measured variances).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import uniform_filter1d

from calibration import actuation
from calibration.check import Played
from calibration.drive import FADE, Drive, plan_for
from calibration.inversion import Plan, within
from calibration.record import Calibration
from calibration.spectra import fade, resample
from instruments import Limits
from instruments.arrays import ComplexArray, FloatArray

__all__ = ["Known"]

_DISTORTION = 0.02
"""Share of the motion that a response does not describe even when it is right: a patch's hysteresis,
an amplifier's bend."""
_CAUTION = 1e-3
"""What a change of the drive costs, over the median power of the gain: every change, also where it moves
nothing, goes through the patch's hysteresis and brings a little of its error with it."""
_POOL_HZ = 6.0
"""Neighbouring lines whose power is averaged."""
_LISTEN = 0.5
"""Seconds that are recorded after a drive at most: a drive leaves the table nearly still."""
_PLAN_RATE = 5000.0
"""Samples/s that corrections are planned at."""
_TRIES = 8
"""Of a lower limit."""


@dataclass(frozen=True, eq=False)
class Known:
    """What is believed of the response from strain to acceleration, for one drive's target.

    `gain` is (lines,) m/s^2 per V of strain, `variance` (lines,) what it may be off by, squared.
    """

    drive: Drive
    calibration: Calibration
    grid: _Grid
    gain: ComplexArray
    variance: FloatArray
    last: tuple[ComplexArray, ComplexArray, FloatArray] | None = None
    """Of the latest play: strain, acceleration, and its noise power, (lines,) each."""

    @classmethod
    def of(cls, drive: Drive, calibration: Calibration) -> Known:
        """What the calibration says, before anything was played."""
        grid = _Grid.of(drive, calibration)
        f = grid.frequencies
        variance = actuation.doubt(calibration, f) ** 2
        return cls(drive, calibration, grid, actuation.gain(calibration, f), variance)

    @property
    def tail(self) -> float:
        """Seconds that plays are to be recorded for after the drive."""
        grid = self.grid
        return min(_LISTEN, grid.samples / grid.rate_hz - grid.played / self.drive.rate_hz)

    def after(self, volts: FloatArray, played: Played) -> Known:
        """Corrected by what was measured: by the play as it is, then by how it differs from the last.

        Each is believed by its noise, and by the distortion that no response describes.
        """
        strain, motion, noise = self._spectra(volts, played)
        if self.last is None:
            known = self._corrected(strain, motion, noise)
        else:
            before, moved, old = self.last
            known = self._corrected(strain - before, motion - moved, noise + old)
        return replace(known, last=(strain, motion, noise))

    def correction(
        self, volts: FloatArray, played: Played, step: float, limits: Limits
    ) -> tuple[FloatArray, float]:
        """Volts that should be closer to the target than `volts`, and by how much.

        What is left of the error of the plays of `volts` is planned away within the limits, as far as it
        stands out of their noise and as the response is known; of the change, the share `step` is made.
        Returns (samples,) V, and what is expected to be taken off the squared error, over the target's.
        """
        grid, path = self.grid, actuation.path_gain(self.calibration)
        strain, motion, noise = self._spectra(volts, played)
        target = rfft(grid.down(self.drive.target))
        missed = target - motion
        power = grid.pooled(np.abs(missed) ** 2)
        missed *= np.maximum(0.0, 1 - noise / np.maximum(power, 1e-30))

        limit = self.calibration.hysteresis.reach(limits.peak * min(1.0, path))
        wanted = irfft(target, grid.samples)
        plan = plan_for(self.calibration, wanted, grid.window, grid.rate_hz, self.drive.band, limits, limit)
        plan = replace(
            plan,
            wanted=missed + self.gain * strain,
            gain=self.gain,
            doubt=np.sqrt(self.variance),
            noise=0.0,
            around=strain,
            ridge=_CAUTION,
        )
        now = self.calibration.hysteresis.strain(volts * path)
        _, state = within(plan, limit)
        for _ in range(_TRIES):
            planned, state = within(plan, limit, state)
            bent = now + step * grid.up(planned - irfft(strain, grid.samples))
            new = actuation.commanded(self.calibration, bent, grid.smooth)
            room = actuation.room(self.calibration, new, limits)
            if room >= 1:
                break
            # Between the plan's samples, and by the hysteresis, it goes beyond what was planned.
            limit *= room * 0.998
        # A lower limit does not always help: then the whole drive gives way, by some thousandths.
        while room < 1:
            bent *= room * (1 - 1e-6)
            new = actuation.commanded(self.calibration, bent, grid.smooth)
            room = actuation.room(self.calibration, new, limits)
        taken = _left(plan, strain) - _left(plan, self._strain(new))
        return new, float(taken / (np.abs(target) ** 2).sum())

    def _corrected(self, strain: ComplexArray, motion: ComplexArray, noise: FloatArray) -> Known:
        pooled = self.grid.pooled
        drive_power = np.abs(strain) ** 2
        error = noise + _DISTORTION**2 * pooled(np.abs(motion) ** 2)
        # Where a table has changed, the response is further off than its variance says.
        surprise = pooled(np.abs(motion - self.gain * strain) ** 2 - error)
        seen = surprise / np.maximum(pooled(drive_power), 1e-30)
        # By no more than all of it, which a line that was hardly driven would seem to say.
        seen = np.minimum(seen, np.abs(self.gain).max() ** 2)
        variance = np.maximum(self.variance, np.where(surprise > error, seen, 0.0))
        trust = variance * drive_power / np.maximum(variance * drive_power + error, 1e-30)
        measured = motion * np.conj(strain) / np.maximum(drive_power, 1e-30)
        gain = self.gain + trust * (measured - self.gain)
        return replace(self, gain=gain, variance=variance * (1 - trust))

    def _spectra(self, volts: FloatArray, played: Played) -> tuple[ComplexArray, ComplexArray, FloatArray]:
        """(lines,) strain and mean acceleration, and the noise power that is left in the mean."""
        motions = np.array([rfft(self.grid.down(a)) for a in played.accelerations])
        noise = self.grid.pooled(np.var(motions, axis=0, ddof=1) / len(motions))
        return self._strain(volts), motions.mean(axis=0), noise

    def _strain(self, volts: FloatArray) -> ComplexArray:
        """(lines,) strain of commanded volts."""
        strain = self.calibration.hysteresis.strain(volts * actuation.path_gain(self.calibration))
        # What hysteresis leaves at the end comes and goes slowly, far below the band, and is no step.
        strain -= strain[-1] * fade(len(strain), len(strain), 0)
        return np.asarray(rfft(self.grid.down(strain)))


def _left(plan: Plan, strain: ComplexArray) -> float:
    """Squared error that is expected of a strain's spectrum."""
    missed = np.abs(plan.wanted - plan.gain * strain) ** 2
    return float((plan.weight * (missed + (plan.doubt * np.abs(strain - plan.around)) ** 2)).sum())


@dataclass(frozen=True, eq=False)
class _Grid:
    """The drive's samples, and the fewer that corrections are planned on: one period, two rates."""

    played: int
    """Samples of the drive."""
    factor: int
    """Samples of the drive for each of the grid."""
    samples: int
    """Of the grid: the drive, and room to ring in."""
    rate_hz: float
    """Of the grid."""
    smooth: FloatArray
    """(played,): the drive's faded ends."""

    @classmethod
    def of(cls, drive: Drive, calibration: Calibration) -> _Grid:
        played = len(drive.volts)
        factor = max(1, int(drive.rate_hz // _PLAN_RATE))
        room = actuation.ringing(calibration.model) * drive.rate_hz
        edge = round(FADE * drive.rate_hz)
        samples = next_fast_len(int(np.ceil((played + room) / factor)), real=True)
        return cls(played, factor, samples, drive.rate_hz / factor, fade(played, edge, edge))

    @property
    def frequencies(self) -> FloatArray:
        """Of the grid's lines (Hz)."""
        return np.asarray(np.arange(self.samples // 2 + 1) * self.rate_hz / self.samples)

    @property
    def window(self) -> FloatArray:
        """(samples,): `smooth`, and zero while it rings."""
        return np.clip(self.down(self.smooth), 0.0, 1.0)

    def down(self, signal: FloatArray) -> FloatArray:
        """(played or more,) at the drive's rate to (samples,), band-limited."""
        return resample(np.pad(signal, (0, self.samples * self.factor - len(signal))), self.samples)

    def up(self, signal: FloatArray) -> FloatArray:
        """(samples,) to the drive's (played,)."""
        return resample(signal, self.samples * self.factor)[: self.played]

    def pooled(self, power: FloatArray) -> FloatArray:
        """Power (lines,) averaged over neighbouring lines."""
        lines = max(1, round(_POOL_HZ * self.samples / self.rate_hz))
        return np.asarray(uniform_filter1d(power, lines, mode="nearest"))
