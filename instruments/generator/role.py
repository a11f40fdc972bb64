"""The generator role: a separate source of a waveform; and the replies of SCPI instruments."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from typing import final

from ...base.errors import ConfigurationError
from ..interlock import Interlocked
from ..waveforms import Waveform


class Generator(Interlocked, ABC):
    """A function generator. Safe state: output off. Opening the driver changes nothing.

    A waveform is configured with the output off, armed, triggered, and switched off after its duration:
    until then some go on (`Waveform.goes_on`). The DAQ measures the drive at the patches;
    no generator shares its clock. A driver implements `_configure` and `_trigger`, which only
    `configure` and `trigger` call, once the rig's limiter has authorised the waveform.
    """

    identity: str
    output: str
    """Name of the amplifier input that its output is wired to."""
    _configured: Waveform | None = None

    @property
    @abstractmethod
    def load(self) -> float:
        """Load that the instrument assumes (ohm), read back; infinite for an open input.

        Its volts are volts at that load: an open input gets twice the volts that are set for 50 ohm.
        """

    @property
    @abstractmethod
    def amplitude(self) -> float:
        """Amplitude at `load` (V peak), read back."""

    @property
    @abstractmethod
    def is_on(self) -> bool:
        """True when the output is on, read back."""

    @final
    def configure(self, waveform: Waveform) -> None:
        """Switch the output off, set the waveform and the load, and read each back.

        Raises ConfigurationError for a kind of waveform that it does not play, LimitError for more
        volts than the rig file allows, or a waveform that the rig's limiter has not authorised (see
        `Rig.generate`), InstrumentError with the instrument's own message when
        it refuses a setting, or when another value reads back.
        """
        self._interlock.authorise_waveform(self.output, waveform, starts=False)
        # One that is refused leaves the one before set, which is no longer authorised.
        self._configured = None
        self._configure(waveform)
        self._configured = waveform

    @abstractmethod
    def _configure(self, waveform: Waveform) -> None:
        """Do the driver's part of `configure`."""

    @abstractmethod
    def arm(self) -> None:
        """Make the configured waveform wait for `trigger`; the output stays off.

        Raises ConfigurationError when none is configured, InstrumentError.
        """

    @final
    def trigger(self) -> None:
        """Switch the output on and start the armed waveform, and return at once.

        Raises ConfigurationError when none is armed, LimitError when it is no longer authorised,
        InstrumentError (with the output off).
        """
        if self._configured is None:
            raise ConfigurationError(f"{self.identity} has no waveform to play: configure one first.")
        self._interlock.authorise_waveform(self.output, self._configured, starts=True)
        self._trigger()

    @abstractmethod
    def _trigger(self) -> None:
        """Do the driver's part of `trigger`."""

    @abstractmethod
    def off(self) -> None:
        """Reach the safe state and read it back. Idempotent. Raises InstrumentError."""

    @abstractmethod
    def errors(self) -> tuple[str, ...]:
        """Empty the instrument's own error queue and return its entries, oldest first."""

    @abstractmethod
    def close(self) -> None:
        """Disconnect without changing the instrument. May be called again."""


# Replies of SCPI instruments: text in, values out, no I/O.
#
# Forms of response data: IEEE 488.2-1992, 8.7 (NR1, NR2, NR3); SCPI-99 volume 1, 7.2.1.3 and 7.2.1.4
# for infinity and not-a-number, and volume 2, 21.8 for the error queue.

_NUMBER = re.compile(r"[+-]?(?:\d{1,40}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][+-]?\d{1,3})?")
_ERROR = re.compile(r'([+-]?\d{1,6})\s*,\s*(?:"([^"]*(?:""[^"]*)*)"|([^",]*))')
_INFINITE = 9e37
"""SCPI writes infinity as 9.9E+37."""
_NAN = 9.91e37
"""SCPI writes NaN as 9.91E+37."""


def number_of(text: str) -> float:
    """Parse a number; `INF...` and 9.9E+37 are infinity. Raises ValueError otherwise, NaN included."""
    if re.fullmatch(r"INF(INITY|INITE)?", text.upper()):
        return math.inf
    if not _NUMBER.fullmatch(text):
        raise ValueError("not a number")
    value = float(text)
    if not abs(value) > _INFINITE:
        return value
    if math.isclose(value, _NAN, rel_tol=1e-4) or value < 0:
        raise ValueError("SCPI's NaN, or minus infinity")
    return math.inf


def switch_of(text: str) -> bool:
    """Parse the state of a switch: ON or OFF, 1 or 0. Raises ValueError."""
    states = {"0": False, "OFF": False, "1": True, "ON": True}
    if text.upper() not in states:
        raise ValueError("neither ON nor OFF")
    return states[text.upper()]


def error_of(text: str) -> tuple[int, str]:
    """Parse an entry of the error queue; number 0 means that the queue is empty. Raises ValueError."""
    entry = _ERROR.fullmatch(text)
    if entry is None:
        raise ValueError("no entry of an error queue")
    return int(entry[1]), (entry[2] or entry[3] or "").replace('""', '"')


def words_of(text: str) -> tuple[str, str, str, str]:
    """Parse the answer to `*IDN?`: maker, model, serial number and firmware. Raises ValueError."""
    words = [word.strip() for word in text.split(",")]
    if len(words) != 4 or not words[0] or not words[1]:
        raise ValueError("not maker, model, serial number and firmware")
    return words[0], words[1], words[2], words[3]
