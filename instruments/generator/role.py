"""The generator role: a source of its own that plays a linear sine sweep, as the paper's did."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import final

from haploop.instruments.interlock import Interlocked
from haploop.instruments.sweep import Sweep

__all__ = ["Generator", "Sweep"]


class Generator(Interlocked, ABC):
    """A function generator. Safe state: output off. Opening the driver changes nothing.

    A sweep is configured with the output off, armed, triggered, and after its duration switched
    off: until then the output goes on at the start frequency. What really reaches the patches is
    measured by the DAQ; no generator shares its clock. A driver writes `_configure` and `_trigger`;
    they are reached through `configure` and `trigger` alone, within what the rig's limiter authorises.
    """

    identity: str
    output: str
    """Name of the amplifier input that its output is wired to."""
    _configured: Sweep | None = None

    @property
    @abstractmethod
    def load(self) -> float:
        """Ohms that the instrument takes for its load, read back; infinite for an open input.

        Its volts are volts at that load: an open input gets twice the volts that are set for 50 ohm.
        """

    @property
    @abstractmethod
    def amplitude(self) -> float:
        """V peak at `load`, read back."""

    @property
    @abstractmethod
    def is_on(self) -> bool:
        """Whether the output is on, read back."""

    @final
    def configure(self, sweep: Sweep) -> None:
        """Switch the output off, set the sweep and the load, and read each back.

        Raises LimitError for more volts than the rig file allows, or a sweep that the rig's limiter
        has not authorised (see `Rig.sweep`), InstrumentError with the instrument's own words for
        what it refuses, or when it reads back something else.
        """
        self._interlock.authorise_sweep(self.output, sweep, starts=False)
        self._configured = sweep
        self._configure(sweep)

    @abstractmethod
    def _configure(self, sweep: Sweep) -> None:
        """See `configure`: what the driver does for it."""

    @abstractmethod
    def arm(self) -> None:
        """Make the configured sweep wait for `trigger`; the output stays off.

        Raises ConfigurationError when none is configured, InstrumentError.
        """

    @final
    def trigger(self) -> None:
        """Switch the output on and start the armed sweep, and return at once.

        Raises ConfigurationError when none is armed, LimitError when it is no longer authorised,
        InstrumentError (with the output off).
        """
        if self._configured is not None:
            self._interlock.authorise_sweep(self.output, self._configured, starts=True)
        self._trigger()

    @abstractmethod
    def _trigger(self) -> None:
        """See `trigger`: what the driver does for it."""

    @abstractmethod
    def off(self) -> None:
        """Reach the safe state and read it back. Idempotent. Raises InstrumentError."""

    @abstractmethod
    def errors(self) -> tuple[str, ...]:
        """Take everything out of the instrument's own error queue, oldest first."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the instrument without changing it. May be called again."""
