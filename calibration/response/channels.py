"""Correction of two sampled channels to the volts at the patch and the velocity of the surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray

_FITS = 0.005
"""Relative rms misfit up to which the path from command to monitor counts as a hold and one pole."""
_CORNERS = (300.0, 3e5)
"""Search range of the amplifier's corner (Hz)."""


@dataclass(frozen=True, eq=False)
class Channels:
    """Sampling delays (s) of drive monitor and laser after the clock's edge, and the laser's response.

    `laser` returns the response (lines,) from the surface's velocity to what the vibrometer shows, at
    frequencies (Hz), delay included.
    """

    rate_hz: float
    drive_delay: float
    laser_delay: float
    laser: Callable[[FloatArray], ComplexArray]
    staircase: bool = True
    """False where the drive is no output of the converter, whose samples are steps: a generator's."""

    def drive(self, sampled: ComplexArray, commanded: ComplexArray, f: FloatArray) -> ComplexArray:
        """Factors (lines,) from the monitor's samples to the volts at the patch at the clock's edges.

        A drive is a staircase, smoothed by the amplifier only. Its images around the sample rate alias
        into the monitor, which has no anti-alias filter, but not into the surface, which does not
        move at 50 kHz. With a 5 kHz amplifier that is an error of 4 mrad at 600 Hz, as much as all others
        together. Where the path from command to monitor is that of a zero-order hold and one pole, the
        images are corrected; otherwise only the delay is.
        `sampled` (plays, lines) and `commanded` (lines,) are spectra at `f` (lines,) Hz: of the
        monitor's volts and of the commanded samples.
        """
        late = np.exp(-2j * np.pi * f * self.drive_delay)
        if not self.staircase:
            return np.asarray(late)
        strong = np.abs(commanded) > 0.1 * np.abs(commanded).max()
        path = sampled.mean(axis=0)[strong] / commanded[strong]

        def misfit(log_corner: float) -> float:
            shape = self._sampled(f[strong], float(np.exp(log_corner)))
            gain = np.vdot(shape, path).real / np.vdot(shape, shape).real
            return float(np.linalg.norm(path - gain * shape))

        low, high = np.log(_CORNERS)
        found = scipy.optimize.minimize_scalar(
            misfit, bounds=(low, high), method="bounded", options={"xatol": 1e-4}
        )
        if found.fun <= _FITS * np.linalg.norm(path):
            corner = float(np.exp(found.x))
            stairs = np.sinc(f / self.rate_hz) * np.exp(-1j * np.pi * f / self.rate_hz)
            late = stairs / (1 + 1j * f / corner) / self._sampled(f, corner)
        return np.asarray(late)

    def velocity(self, sampled: ComplexArray, f: FloatArray) -> ComplexArray:
        """Spectrum of the surface's velocity at the clock's edges; arrays (..., lines), `f` (lines,) Hz."""
        return np.asarray(sampled * np.exp(-2j * np.pi * f * self.laser_delay) / self.laser(f))

    def _sampled(self, f: FloatArray, corner: float) -> ComplexArray:
        """Response of one pole (Hz) to a staircase, sampled `drive_delay` after each step begins."""
        decay = np.exp(-2 * np.pi * corner / self.rate_hz)
        since = np.exp(-2 * np.pi * corner * self.drive_delay)
        back = np.exp(-2j * np.pi * f / self.rate_hz)
        return np.asarray((1 - since) + since * (1 - decay) * back / (1 - decay * back))
