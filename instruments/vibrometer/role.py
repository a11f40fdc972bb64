"""The vibrometer role: a laser's velocity output, with its scale, bandwidth and delay."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from ..arrays import ComplexArray, FloatArray
from ..frozen import Frozen
from ..sensors import low_pass

__all__ = ["Vibrometer"]


class Vibrometer(Frozen, ABC):
    """A single-point laser vibrometer with an analog velocity output. It has no unsafe state."""

    identity: str
    channel: str
    """Name of the DAQ channel that its output is wired to."""
    range: float
    """Full scale (m/s)."""
    scale: float
    """Scale of its output (m/s per V)."""
    bandwidth_hz: float
    delay: float
    """Delay of the output (s)."""
    declared: str | None
    """Settings that only a person can check, as a sentence to confirm; None when they are read back."""

    @property
    def resolved_hz(self) -> float:
        """Highest frequency (Hz) at which motion is measured: half the bandwidth.

        There an error of 5 % of the filter's corner makes an error of 1 % (of one pole); at the corner, of
        2.5 %, and a laser's noise, as acceleration, grows with the frequency's power of 1.5.
        """
        return self.bandwidth_hz / 2

    @abstractmethod
    def signal_level(self) -> float | None:
        """Fraction of full light that returns, 0 to 1; None where the product does not report it."""

    @abstractmethod
    def close(self) -> None:
        """Disconnect from the instrument. May be called again."""

    def to_velocity(self, volts: FloatArray) -> FloatArray:
        """Convert volts at the output to m/s, in any shape."""
        return volts * self.scale

    def response(self, frequencies: FloatArray) -> ComplexArray:
        """Frequency response of the output's pole and delay at `frequencies` (Hz)."""
        late = np.exp(-2j * np.pi * frequencies * self.delay)
        return np.asarray(low_pass(frequencies, self.bandwidth_hz) * late)
