"""A coil as a load: its current and its heat, from the volts across it.

Model: a resistance and an inductance in series, held still (no back-EMF), driven by a staircase of volts; the
current has a closed form. The winding is one body that loses its heat with one time constant: what counts is
the dissipated power, R i^2, smoothed by that time constant, against the power that it may lose for ever.

What breaks it, and which way: a coil that moves draws less current than a still one below and at its
resonance, and above it at most V / R; copper gains 0.4 % of resistance per kelvin, so that a warm coil draws
less. A winding thinner than its body heats faster than the body: state the winding's time constant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arrays import FloatArray


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
