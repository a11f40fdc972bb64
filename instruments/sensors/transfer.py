"""How a sensor passes vibration: its frequency response, relative to its linear map.

Model: a product of factors, each 1 where the map holds, times a measured response, times a delay. A real
pole at f0 is 1 / (1 + jf/f0), a pair with the damping ratio z is 1 / (1 + 2 z jf/f0 - (f/f0)^2), zeros are
their inverses; a high-pass is (jf/f0) / (1 + jf/f0). A low-pass filter, a mass on a spring, a charge
amplifier and the coupling of an IEPE supply are such factors. Assumed: the sensor is linear, and its
response does not depend on the mounting, which moves a resonance.
"""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from ...base.arrays import ComplexArray, FloatArray
from ...base.bounded import Finite, NotNegative, Positive, Strict
from ...base.filters import first_order_high_pass

Root = Positive | tuple[Positive, Annotated[float, Field(strict=True, gt=0, le=1)]]
"""A real pole or zero by its frequency (Hz), or a pair by its frequency and damping ratio."""


class Measured(Strict):
    """A measured frequency response: gain and phase at rising frequencies, constant beyond both ends."""

    hz: Annotated[tuple[Positive, ...], Field(min_length=2, max_length=10_000)]
    gain: tuple[Positive, ...]
    """Relative to the linear map."""
    degrees: tuple[Finite, ...]
    file: str = ""
    """Name of the file that it comes from."""

    @model_validator(mode="after")
    def _rising(self) -> Self:
        if not len(self.hz) == len(self.gain) == len(self.degrees):
            raise ValueError("hz, gain and degrees must be of one length")
        if np.any(np.diff(self.hz) <= 0):
            raise ValueError("the frequencies of a measured response must rise")
        return self

    def response(self, frequencies: FloatArray) -> ComplexArray:
        """Response at frequencies (Hz), interpolated in gain and unwrapped phase."""
        phase = np.unwrap(np.radians(self.degrees))
        gain = np.interp(frequencies, self.hz, self.gain)
        return np.asarray(gain * np.exp(1j * np.interp(frequencies, self.hz, phase)), dtype=np.complex128)


class Transfer(Strict):
    """Frequency response of a sensor, relative to its linear map."""

    high_pass_hz: tuple[Positive, ...] = ()
    poles: tuple[Root, ...] = ()
    zeros: tuple[Root, ...] = ()
    measured: Measured | None = None
    delay: NotNegative = 0.0
    """s."""

    def response(self, frequencies: FloatArray) -> ComplexArray:
        """Response (frequencies,) at `frequencies` (Hz)."""
        passed = np.exp(-2j * np.pi * self.delay * frequencies)
        for corner in self.high_pass_hz:
            passed *= first_order_high_pass(frequencies, corner)
        return np.asarray(passed * self.fast(frequencies))

    def fast(self, frequencies: FloatArray) -> ComplexArray:
        """Response without the high-pass corners and the delay."""
        passed = np.ones(len(frequencies), dtype=np.complex128)
        for pole in self.poles:
            passed /= _factor(frequencies, pole)
        for zero in self.zeros:
            passed *= _factor(frequencies, zero)
        if self.measured is not None:
            passed *= self.measured.response(frequencies)
        return passed

    @property
    def bandwidth_hz(self) -> float:
        """Lowest frequency from which the sensor passes 3 dB less than its map; infinite without one."""
        if len(self.poles) == 1 and isinstance(self.poles[0], float) and not self.zeros and not self.measured:
            return self.poles[0]
        f = np.geomspace(0.1, 1e6, 14_001)
        least = np.sqrt(0.5)
        lost = np.flatnonzero(np.abs(self.fast(f)) < least)
        if not len(lost):
            return np.inf
        high, low = f[lost[0]], f[max(lost[0] - 1, 0)]
        return float(np.interp(-least, -np.abs(self.fast(np.array([low, high]))), [low, high]))


def _factor(frequencies: FloatArray, root: Root) -> ComplexArray:
    s = 1j * frequencies
    if isinstance(root, tuple):
        s = s / root[0]
        return np.asarray(1 + 2 * root[1] * s + s**2)
    return np.asarray(1 + s / root)
