"""A linear sine sweep: what a generator plays and the interlock authorises."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .errors import ConfigurationError

__all__ = ["Sweep"]


@dataclass(frozen=True)
class Sweep:
    """One linear sine sweep. Raises ConfigurationError for one that no generator can play."""

    start_hz: float
    """Start frequency, above zero: no generator starts at 0 Hz (the paper's sweep is 0 to 625 Hz;
    docs/hardware.md, "Generators")."""
    stop_hz: float
    duration: float
    """Seconds from start to stop."""
    amplitude: float
    """Amplitude at the load that the generator is set to (V peak)."""

    def __post_init__(self) -> None:
        values = (self.start_hz, self.stop_hz, self.duration, self.amplitude)
        if not all(math.isfinite(v) and v > 0 for v in values) or self.stop_hz <= self.start_hz:
            raise ConfigurationError(
                f"A sweep from {self.start_hz:g} to {self.stop_hz:g} Hz in {self.duration:g} s at "
                f"{self.amplitude:g} V cannot be played: it must rise from above 0 Hz, last, and have volts."
            )
