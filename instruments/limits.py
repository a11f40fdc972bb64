"""Limits of a drive, in volts at the patch, and the check that refuses it before it is written."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from instruments.arrays import FloatArray
from instruments.errors import LimitError

__all__ = ["Limits"]


@dataclass(frozen=True)
class Limits:
    """What a drive may be. The defaults limit nothing; `within` takes the stricter of two."""

    low: float = -np.inf
    """Lowest voltage (V)."""
    high: float = np.inf
    """Highest voltage (V)."""
    swing: float = np.inf
    """Largest peak-to-peak voltage (V); the paper's is 100."""
    slew: float = np.inf
    """Steepest change (V/s)."""
    current_peak: float = np.inf
    """Largest C dv/dt (A)."""
    current_average: float = np.inf
    """Largest mean of C |dv/dt| / 2 (A): charge per second that the amplifier delivers."""
    capacitance: float = 0.0
    """Of the connected patches together (F)."""
    burst: float = np.inf
    """Longest drive (s)."""
    mean: float = np.inf
    """Largest mean voltage (V)."""
    end: float = np.inf
    """Largest voltage of the first and last sample (V): a step excites every mode."""

    def within(self, other: Self) -> Self:
        """The stricter of both, limit by limit."""
        return replace(
            self,
            **{
                f.name: (max if f.name in ("low", "capacitance") else min)(
                    getattr(self, f.name), getattr(other, f.name)
                )
                for f in fields(self)
            },
        )

    @property
    def peak(self) -> float:
        """Largest voltage of a drive that swings evenly about zero (V)."""
        return float(min(self.high, -self.low, self.swing / 2))

    def check_measured(self, volts: FloatArray, margin: float) -> None:
        """Refuse what was measured at the patch ((samples,) V), beyond low, high or swing.

        `margin` is the share by which a monitor may be off. Raises LimitError.
        """
        lowest, highest = float(volts.min()), float(volts.max())
        within = (
            lowest >= margin * self.low
            and highest <= margin * self.high
            and highest - lowest <= margin * self.swing
        )
        if not within:
            raise LimitError(
                f"The patch got {lowest:.1f} to {highest:.1f} V, and the rig's limits are {self.low:g} to "
                f"{self.high:g} V and {self.swing:g} V from peak to peak."
            )

    def check(self, drive: FloatArray, rate_hz: float) -> None:
        """Refuse a drive ((samples,) V at the patch) that breaks any limit.

        Raises LimitError, which says the limit, by how much, and at which sample.
        """
        if not isinstance(drive, np.ndarray) or drive.dtype.kind != "f":
            raise LimitError("A drive is a numpy array of real numbers, in volts at the patch.")
        if drive.ndim != 1 or not len(drive):
            raise LimitError(f"A drive is one row of samples, and this one has the shape {drive.shape}.")
        bad = np.flatnonzero(~np.isfinite(drive))
        if len(bad):
            raise LimitError(
                f"The drive is {drive[bad[0]]} at sample {bad[0]}: every sample must be a number."
            )
        steps = np.diff(drive, prepend=0.0, append=0.0) * rate_hz
        current = self.capacitance * np.abs(steps)
        ends = np.abs(drive[[0, -1]])
        # What is compared, the limit, its unit, and the sample where it is worst.
        rows = (
            ("falls to", drive.min(), self.low, "V", int(drive.argmin()), -1),
            ("rises to", drive.max(), self.high, "V", int(drive.argmax()), 1),
            ("swings over", float(np.ptp(drive)), self.swing, "V", int(drive.argmax()), 1),
            ("slews at", float(np.abs(steps).max()), self.slew, "V/s", int(np.abs(steps).argmax()), 1),
            ("draws a peak of", float(current.max()), self.current_peak, "A", int(current.argmax()), 1),
            ("draws on average", float(current.mean()) / 2, self.current_average, "A", 0, 1),
            ("lasts", len(drive) / rate_hz, self.burst, "s", len(drive) - 1, 1),
            ("has a mean of", abs(float(drive.mean())), self.mean, "V", 0, 1),
            ("starts or ends at", float(ends.max()), self.end, "V", int(ends.argmax()) * (len(drive) - 1), 1),
        )
        for what, value, limit, unit, sample, sign in rows:
            # One part in 10^9 is rounding, not a drive that breaks a limit. A limit that is no number
            # is broken by every drive.
            if not sign * (value - limit) <= 1e-9 * max(1.0, abs(limit)):
                raise LimitError(
                    f"The drive {what} {value:.4g} {unit} at sample {sample}, "
                    f"and the rig's limit is {limit:.4g} {unit}."
                )
