"""Relay boards on a serial port that speak the ASCII protocol of Numato's USB relay modules.

A command ends with a carriage return; the board echoes it, answers on a line of its own, and ends
with the prompt `>`. `relay on X` and `relay off X` answer nothing, `relay read X` answers `on` or
`off`, `ver` the firmware; X is 0 to 9, then A to V. (Found in public programs for these modules:
docs/hardware.md, "Relay box". The 2- and 4-channel ones lack `readall` and `writeall`, so neither is used.)

Such a board cannot open by itself: its `dead_man` is infinite, and a program that is killed leaves
its channels as they are. Prefer a box with a pulse timer where a patch may not stay connected.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from typing import Annotated, Self

import serial
from pydantic import Field

from ...base.bounded import Baud, Timeout
from ...base.clock import Clock
from ...base.errors import ConfigurationError, InstrumentError
from ..driver import one_name
from ..tape import Failure, taped_line
from ..transport import SerialSettings, close_port, serial_trouble
from .board import BoardSettings, ChannelRelay, ChannelState

DIGITS = "0123456789ABCDEFGHIJKLMNOPQRSTUV"
"""Channel numbers in the board's notation."""
PROMPT = b">"
_LONGEST_ANSWER = 256
_FAILURES = (Failure(TimeoutError), Failure(ConnectionError), Failure(ConfigurationError))


def answer_in(received: bytes, command: str) -> str:
    """Extract the answer to `command` from the bytes received since it was sent, up to the prompt.

    Raises ValueError for anything but the echo of the command, at most one line, and the prompt.
    """
    text = received.decode("ascii", "replace")
    found = re.fullmatch(rf"[\r\n]*{re.escape(command)}[\r\n]+(?:([ -~]*)[\r\n]+)?>", text)
    if found is None:
        raise ValueError(repr(text[:60]))
    return found[1] or ""


class SerialRelay(ChannelRelay):
    """See `Relay` and `ChannelRelay`."""

    taped = True

    class Settings(BoardSettings, SerialSettings):
        """The `[relay]` table of a rig file."""

        patches: Annotated[
            dict[str, Annotated[int, Field(strict=True, ge=0, lt=len(DIGITS))]], Field(min_length=1)
        ]
        """Channel of each patch, counted from 0 as on the board."""
        port: str
        """Serial port (`COM5`), or the URL of a remote one (`socket://HOST:PORT`)."""
        baud: Baud = 19200
        """Baud rate; a board with its own USB port accepts any."""
        timeout: Timeout = 1.0
        """Time for the board to answer a command completely (s)."""

    @staticmethod
    def hardware(settings: Settings) -> tuple[str, ...]:
        """See `Driver.hardware`: the port."""
        return (one_name(settings.port),)

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Open the port and ask for the firmware and the state of each channel; none is changed.

        Raises ConfigurationError for an invalid port name, InstrumentError when the port does not exist
        or does not answer as such a board does.
        """
        board = _Board(settings)
        try:
            board.states()
        except BaseException:
            board.release()
            raise
        return cls(settings, clock, board)


class _Board:
    """A `RelayBoard`. The port is reopened after an error, so that a late answer is discarded."""

    dead_man = math.inf

    def __init__(self, settings: SerialRelay.Settings) -> None:
        self.identity = f"The relay board at {settings.port}"
        self._settings = settings
        self._channels: Collection[int] = settings.patches.values()
        self._port: serial.SerialBase | None = None
        self._line = taped_line()
        version = self._ask("ver")
        if not version:
            raise self._wrong("ver", "nothing")
        self.identity = f"{self.identity} (firmware {version})"

    def states(self) -> Mapping[int, ChannelState]:
        return {channel: ChannelState(closed=self._read(channel)) for channel in self._channels}

    def open_channel(self, channel: int) -> None:
        self._switch(f"relay off {DIGITS[channel]}")

    def close_channel(self, channel: int) -> None:
        self._switch(f"relay on {DIGITS[channel]}")

    def release(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            close_port(port)

    def _read(self, channel: int) -> bool:
        command = f"relay read {DIGITS[channel]}"
        answer = self._ask(command)
        if answer not in ("on", "off"):
            raise self._wrong(command, repr(answer))
        return answer == "on"

    def _switch(self, command: str) -> None:
        answer = self._ask(command)
        if answer:
            raise self._wrong(command, repr(answer))

    def _ask(self, command: str) -> str:
        try:
            received = self._line.call("ask", lambda: self._received(command), command, failures=_FAILURES)
            if not received.endswith(PROMPT):
                raise ValueError(f"{received[:60].decode('ascii', 'replace')!r} and no prompt")
            return answer_in(received, command)
        except TimeoutError:
            self.release()
            raise InstrumentError(
                f"{self.identity} did not answer {command!r} within {self._settings.timeout:g} s: "
                "is it switched on, and is that its port?"
            ) from None
        except ConnectionError as error:
            self.release()
            raise InstrumentError(
                f"{self.identity} cannot be talked to ({error}): plug it in, or correct 'port' in [relay]."
            ) from None
        except ValueError as error:
            self.release()
            raise self._wrong(command, str(error)) from None

    def _opened(self) -> serial.SerialBase:
        s = self._settings
        try:
            return s.opened(s.port, s.baud, s.timeout, s.timeout)
        except ValueError as error:
            raise ConfigurationError(
                f"'port' in [relay] cannot be {s.port!r}: {serial_trouble(error)}."
            ) from None

    def _received(self, command: str) -> bytes:
        """Reply to a command up to the prompt, within two time-outs; raises TimeoutError, ConnectionError."""
        try:
            if self._port is None:
                self._port = self._opened()
                # An empty command terminates one that another program has sent in part.
                self._exchange(self._port, "")
            return self._exchange(self._port, command)
        except TimeoutError:
            raise
        except OSError as error:  # the base of pyserial's errors
            raise ConnectionError(serial_trouble(error)) from None

    def _exchange(self, port: serial.SerialBase, command: str) -> bytes:
        port.reset_input_buffer()
        port.write(f"{command}\r".encode("ascii"))
        received: bytes = port.read_until(PROMPT, _LONGEST_ANSWER)
        if not received:
            raise TimeoutError
        return received

    def _wrong(self, command: str, answer: str) -> InstrumentError:
        return InstrumentError(
            f"{self.identity} answered {command!r} with {answer}, which no such board does: "
            "check the port, its baud rate, and the channels in [relay]."
        )
