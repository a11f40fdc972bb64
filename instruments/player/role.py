"""The player role: plays waveforms on its own clock, unlike a DAQ's output."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import AbstractContextManager
from typing import final

from ...base.arrays import ComplexArray, FloatArray
from ..interlock import Interlocked


class Player(Interlocked, ABC):
    """Plays waveforms into the amplifier, from an unknown start time and on its own clock.

    Safe state: nothing plays, and its output rests at zero volts. Opening it changes no output.
    Its volts and its timing are not trusted: the DAQ measures the drive at the patches, from which
    `Rig.excite` finds when a waveform began and how fast the player's clock runs. A driver implements
    `_play`, which only `play` calls, once the rig's limiter has authorised the waveform.
    """

    identity: str
    output: str
    """Name of the amplifier input that its output is wired to."""
    declared: str | None
    """Settings that only a person can check, as a sentence to confirm; None when they are read back."""
    max_latency: float
    """Longest time from the call of `play` to the waveform's first sample (s)."""

    @final
    def play(self, volts: FloatArray, rate_hz: float) -> AbstractContextManager[None]:
        """Start to play `volts` ((samples,) V at the output, at `rate_hz`) once, in the background.

        Leave the context after `max_latency` and the waveform's length have passed: its exit stops the
        play, and raises InstrumentError when the waveform was not played completely and without a
        gap. When the body raises, the play stops at once, and the body's error is raised.

        Raises LimitError for a waveform that cannot be played unchanged (too large, not finite, a
        mean that an AC-coupled output loses), or that the rig's limiter has not authorised: it is
        never clipped. Raises InstrumentError.
        """
        self._interlock.authorise(self.output, volts, rate_hz)
        return self._play(volts, rate_hz)

    @abstractmethod
    def _play(self, volts: FloatArray, rate_hz: float) -> AbstractContextManager[None]:
        """Do the driver's part of `play`."""

    @abstractmethod
    def rendered(self, volts: FloatArray, rate_hz: float) -> tuple[FloatArray, float]:
        """Compute the output for a waveform: (samples,) V, and its sample rate (Hz).

        The limits apply to this output, because resampling overshoots. Raises LimitError, as `play`.
        """

    @abstractmethod
    def response(self, frequencies: FloatArray) -> ComplexArray:
        """Frequency response of the output at `frequencies` (Hz), as far as known, without its delay."""

    @abstractmethod
    def stop(self) -> None:
        """Reach the safe state. Idempotent. Raises InstrumentError."""

    @abstractmethod
    def close(self) -> None:
        """Stop, and close the device. May be called again."""
