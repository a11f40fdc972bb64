"""What the simulated sound cards have in common: names of the module `sounddevice`, and an AC coupling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from ..base.arrays import FloatArray

FRAMES = 480
"""Frames per callback: 10 ms at 48 kHz (estimate)."""


class CallbackStop(Exception):  # noqa: N818  as sounddevice calls it
    """Raised by a callback to stop after the samples that it has delivered."""


class CallbackAbort(Exception):  # noqa: N818  as sounddevice calls it
    """Raised by a callback to stop at once."""


class PortAudioError(Exception):
    """Error of PortAudio."""


@dataclass(frozen=True)
class Flags:
    """Stream status passed to a callback."""

    input_underflow: bool = False
    input_overflow: bool = False
    output_underflow: bool = False
    output_overflow: bool = False


class Coupling:
    """A coupling capacitor, one zero at 0 Hz and one pole, through which samples pass part by part."""

    def __init__(self) -> None:
        self._before = self._output = 0.0

    def settle(self, volts: float) -> None:
        """Charge it as after a long time at `volts`."""
        self._before, self._output = volts, 0.0

    def passed(self, volts: FloatArray, corner_hz: float, period: float) -> FloatArray:
        """Return what passes of the next samples, (samples,) V, `period` (s) apart."""
        pole = float(np.exp(-2 * np.pi * corner_hz * period))
        passed, _ = scipy.signal.lfilter(
            [(1 + pole) / 2, -(1 + pole) / 2],
            [1.0, -pole],
            volts,
            zi=[pole * self._output - (1 + pole) / 2 * self._before],
        )
        self._before, self._output = float(volts[-1]), float(passed[-1])
        return np.asarray(passed)
