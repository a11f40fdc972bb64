"""The player role: plays a waveform on a clock of its own, where a DAQ's output shares the DAQ's."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import AbstractContextManager
from typing import final

from haploop.instruments.arrays import ComplexArray, FloatArray
from haploop.instruments.interlock import Interlocked

__all__ = ["Player"]


class Player(Interlocked, ABC):
    """Plays waveforms into the amplifier, begun when it likes and on its own clock.

    Safe state: nothing plays, and its output rests at zero volts. Opening it changes no output.
    Neither its volts nor its time are to be believed: what reaches the patches is measured by the
    DAQ, and `Rig.excite` finds there when a waveform began and how fast its clock runs. A driver
    writes `_play`; it is reached through `play` alone, within what the rig's limiter authorises.
    """

    identity: str
    output: str
    """Name of the amplifier input that its output is wired to."""
    declared: str | None
    """Settings that only a person can check, as a sentence to confirm; None when they are read back."""
    room: float
    """Seconds at most from the call of `play` to the waveform's first sample."""

    @final
    def play(self, volts: FloatArray, rate_hz: float) -> AbstractContextManager[None]:
        """Start to play `volts` ((samples,) at the output, at `rate_hz`) once, and let it run.

        Leave the context after `room` and the waveform's length have passed: its exit stops what
        still plays, and raises InstrumentError when the waveform was not played whole and without
        a gap. When the body raises, it stops at once, and the body's error is the one that counts.

        Raises LimitError for a waveform that cannot be played as it is (too large, not finite, a
        mean that an AC-coupled output loses), or that the rig's limiter has not authorised: it is
        never clipped. Raises InstrumentError.
        """
        self._interlock.authorise(self.output, volts, rate_hz)
        return self._play(volts, rate_hz)

    @abstractmethod
    def _play(self, volts: FloatArray, rate_hz: float) -> AbstractContextManager[None]:
        """See `play`: what the driver does for it."""

    @abstractmethod
    def rendered(self, volts: FloatArray, rate_hz: float) -> tuple[FloatArray, float]:
        """What it will put out for a waveform: (samples,) V, and the rate at which it steps through them.

        Resampling overshoots, and the limits hold for what comes out. Raises LimitError, as `play`.
        """

    @abstractmethod
    def response(self, frequencies: FloatArray) -> ComplexArray:
        """What the output passes at `frequencies` (Hz), as far as it is known; its delay left out."""

    @abstractmethod
    def stop(self) -> None:
        """Reach the safe state. Idempotent. Raises InstrumentError."""

    @abstractmethod
    def close(self) -> None:
        """Stop, and let go of the device. May be called again."""
