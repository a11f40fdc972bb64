"""Limits of a drive in volts at the patch, checked before anything is written; and a coil as a load."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from ..base.arrays import FloatArray
from ..base.errors import LimitError

_SUSTAINED = 1.0
"""Window of the average current (s), placed where a drive draws most: silence elsewhere must not hide a
burst."""
_REPEATED = 0.8
"""Share of a coil's power that `headroom` plans for a drive that is repeated without a pause: drives of other
shapes may come between."""
_ROUNDING = 1e-9
"""Relative tolerance for rounding errors."""


@dataclass(frozen=True)
class Limits:
    """Limits of a drive. The defaults limit nothing; `within` takes the stricter of two."""

    min: float = -np.inf
    """Lowest voltage (V)."""
    max: float = np.inf
    """Highest voltage (V)."""
    peak_to_peak: float = np.inf
    """Largest peak-to-peak voltage (V); paper: 100 (docs/hardware.md, "Limits and loss of the host")."""
    slew: float = np.inf
    """Largest slew rate (V/s)."""
    current_peak: float = np.inf
    """Largest current (A): C dv/dt of patches, the current of a coil."""
    current_average: float = np.inf
    """Largest mean (A) over any second: of C |dv/dt| / 2, the charge that the amplifier delivers, or of a
    coil's |current|."""
    capacitance: float = 0.0
    """Total capacitance of the connected patches (F)."""
    coil: Coil | None = None
    """The connected coil."""
    power: float = np.inf
    """Largest dissipation of the coil (W), smoothed by its thermal time constant; a limiter keeps the heat of
    earlier plays."""
    max_duration: float = np.inf
    """Longest drive (s), from its first sample that is not zero to its last."""
    duty: float = 1.0
    """Largest fraction of any minute in which something is played; a limiter keeps the history."""
    max_offset: float = np.inf
    """Largest magnitude of the mean voltage (V)."""
    max_end: float = np.inf
    """Largest magnitude of the first and last sample (V): a step excites every mode."""

    def within(self, other: Self) -> Self:
        """Return the stricter of the two values of each limit."""
        return replace(
            self,
            coil=self.coil or other.coil,
            **{
                f.name: (max if f.name in ("min", "capacitance") else min)(
                    getattr(self, f.name), getattr(other, f.name)
                )
                for f in fields(self)
                if f.name != "coil"
            },
        )

    @property
    def peak(self) -> float:
        """Largest peak voltage of a drive that is symmetric about zero (V)."""
        return float(min(self.max, -self.min, self.peak_to_peak / 2))

    def headroom(self, drive: FloatArray, rate_hz: float) -> tuple[float, str]:
        """Return the largest factor that keeps (samples,) V within these limits, and which one binds.

        The limits are those of voltage, slew rate, current, and power (as if the drive were repeated for
        ever). The factor is infinite for a drive of zeros.
        """
        steps, current, average = self._drawn(drive, rate_hz)
        rows = [
            (np.abs(drive).max(), self.peak, f"{self.peak:.1f} V at the patch"),
            (steps.max(), self.slew, f"{self.slew:.3g} V/s at the patch"),
            (current.max(), self.current_peak, f"{self.current_peak:.3g} A into the patch"),
            (average.max(), self.current_average, f"{self.current_average:.3g} A on average into the patch"),
        ]
        if self.coil is not None:
            # Its factor is of volts, whose square heats.
            heat = np.sqrt(self.coil.for_ever(drive, rate_hz))
            rows.append((heat, np.sqrt(_REPEATED * self.power), f"{self.power:.3g} W in the coil"))
        factors = [(limit / float(value), binding) for value, limit, binding in rows if value > 0]
        return min(factors, default=(np.inf, ""))

    def check_measured(self, volts: FloatArray, margin: float) -> None:
        """Refuse volts measured at the patch ((samples,) V) beyond min, max or peak_to_peak.

        The limits are widened by the factor `margin`, for the drive monitor's own error. Raises LimitError.
        """
        lowest, highest = float(volts.min()), float(volts.max())
        within = (
            lowest >= margin * self.min
            and highest <= margin * self.max
            and highest - lowest <= margin * self.peak_to_peak
        )
        if not within:
            raise LimitError(
                f"The patch got {lowest:.1f} to {highest:.1f} V, and the rig's limits are {self.min:g} to "
                f"{self.max:g} V and {self.peak_to_peak:g} V from peak to peak."
            )

    def heat(self, drive: FloatArray, rate_hz: float) -> float:
        """What a drive alone leaves of the coil's smoothed dissipation at its end (W); 0 without a coil."""
        return 0.0 if self.coil is None else float(self.coil.heat(drive, rate_hz)[-1])

    def check(self, drive: FloatArray, rate_hz: float, whose: str = "the rig", warm: float = 0.0) -> None:
        """Refuse a drive ((samples,) V at the patch) that breaks any limit.

        Zeros before and after it are not part of the drive. `whose` names the owner of these limits
        in the error; `warm` (W) is left in the coil from earlier plays. Raises LimitError with the limit, the
        excess and the sample.
        """
        if not isinstance(drive, np.ndarray) or drive.dtype.kind != "f":
            raise LimitError("A drive is a numpy array of real numbers, in volts at the patch.")
        if drive.ndim != 1 or not len(drive):
            raise LimitError(f"A drive is one row of samples, and this one has the shape {drive.shape}.")
        bad = np.flatnonzero(~np.isfinite(drive))
        if len(bad):
            raise LimitError(f"The drive is {drive[bad[0]]} at sample {bad[0]}: every sample must be finite.")
        ends = np.abs(drive[[0, -1]])
        first, stop = sounding(drive)
        drive = drive[first:stop]
        steps, current, average = self._drawn(drive, rate_hz)
        heat = np.zeros(1) if self.coil is None else self.coil.heat(drive, rate_hz, warm)
        # Phrase, value, limit, unit, sample of the worst value, and the sign of the comparison.
        rows = (
            ("falls to", drive.min(), self.min, "V", int(drive.argmin()), -1),
            ("rises to", drive.max(), self.max, "V", int(drive.argmax()), 1),
            ("has a peak-to-peak voltage of", np.ptp(drive), self.peak_to_peak, "V", int(drive.argmax()), 1),
            ("slews at", steps.max(), self.slew, "V/s", int(steps.argmax()), 1),
            ("draws a peak of", current.max(), self.current_peak, "A", int(current.argmax()), 1),
            ("draws on average", average.max(), self.current_average, "A", int(average.argmax()), 1),
            ("heats the coil to", heat.max(), self.power, "W", int(heat.argmax()), 1),
            ("lasts", len(drive) / rate_hz, self.max_duration, "s", len(drive) - 1, 1),
            ("has an offset of", abs(drive.mean()), self.max_offset, "V", 0, 1),
            ("starts or ends at", ends.max(), self.max_end, "V", int(ends.argmax()) * (len(drive) - 1), 1),
        )
        for what, value, limit, unit, sample, sign in rows:
            beyond = sign * (float(value) - limit)
            # A NaN limit refuses every drive.
            if not beyond <= _ROUNDING * max(1.0, abs(limit)):
                raise LimitError(
                    f"The drive {what} {float(value):.4g} {unit} at sample {first + sample}, {beyond:.3g} "
                    f"{unit} beyond the {limit:.4g} {unit} of {whose}."
                )

    def _drawn(self, drive: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Magnitudes of the slew rate (V/s), of the current (A), and of its mean over each second (A)."""
        steps = np.abs(np.diff(drive, prepend=0.0, append=0.0)) * rate_hz
        second = round(_SUSTAINED * rate_hz)
        if self.coil is not None:
            current = np.abs(self.coil.current(drive, rate_hz))
            return steps, current, _averages(current, second)
        current = self.capacitance * steps
        return steps, current, _averages(current, second) / 2


def sounding(drive: FloatArray) -> tuple[int, int]:
    """Indices of a drive's first nonzero sample and of the one after its last; all of an all-zero drive."""
    found = np.flatnonzero(drive)
    return (int(found[0]), int(found[-1]) + 1) if len(found) else (0, len(drive))


def _averages(current: FloatArray, samples: int) -> FloatArray:
    """Mean of each window of `samples` values, by its first index; a shorter input is one window."""
    samples = min(max(samples, 1), len(current))
    total = np.concatenate([[0.0], np.cumsum(current)])
    return np.asarray((total[samples:] - total[:-samples]) / samples)


# A coil as a load: its current and its heat, from the volts across it.
#
# Model: a resistance and an inductance in series, held still (no back-EMF), driven by a staircase of volts;
# the current has a closed form. The winding is one body that loses its heat with one time constant: what
# counts is the dissipated power, R i^2, smoothed by that time constant, against the power that it may lose
# for ever.
#
# What breaks it, and which way: a coil that moves draws less current than a still one below and at its
# resonance, and above it at most V / R; copper gains 0.4 % of resistance per kelvin, so that a warm coil
# draws less. A winding thinner than its body heats faster than the body: state the winding's time constant.


@dataclass(frozen=True)
class Coil:
    """Resistance (ohm), inductance (H) and thermal time constant (s)."""

    resistance: float
    inductance: float
    thermal_time: float

    def current(self, volts: FloatArray, rate_hz: float) -> FloatArray:
        """Current at the end of each of (samples,) held volts, (samples,) A."""
        if not self.inductance:
            return np.asarray(volts / self.resistance)
        kept = np.exp(-self.resistance / self.inductance / rate_hz)
        return _filtered((1 - kept) / self.resistance, kept, volts, 0.0)

    def heat(self, volts: FloatArray, rate_hz: float, warm: float = 0.0) -> FloatArray:
        """Smoothed dissipation during (samples,) held volts, (samples,) W; `warm` (W) is left from before."""
        kept = np.exp(-1 / self.thermal_time / rate_hz)
        power = self.resistance * self.current(volts, rate_hz) ** 2
        return _filtered(1 - kept, kept, power, warm)

    def left(self, warm: float, seconds: float) -> float:
        """What is left of a smoothed dissipation (W) after some seconds at rest."""
        return float(warm * np.exp(-max(seconds, 0.0) / self.thermal_time))

    def for_ever(self, volts: FloatArray, rate_hz: float) -> float:
        """Largest smoothed dissipation (W) of (samples,) held volts that are repeated without a pause."""
        once = self.heat(volts, rate_hz)
        kept = np.exp(-len(volts) / self.thermal_time / rate_hz)
        before = once[-1] / (1 - kept)
        return float(self.heat(volts, rate_hz, float(before)).max())


def _filtered(gain: float, kept: float, values: FloatArray, before: float) -> FloatArray:
    """y[n] = gain x[n] + kept y[n - 1], from y[-1] = before, (samples,)."""
    import scipy  # noqa: PLC0415  only a rig with a coil pays for its import

    found, _ = scipy.signal.lfilter([gain], [1.0, -kept], values, zi=[kept * before])
    return np.asarray(found)
