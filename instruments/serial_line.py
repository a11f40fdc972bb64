"""Lines of text over a serial port, each with a hard deadline, for any instrument that speaks so."""

from __future__ import annotations

from contextlib import suppress
from typing import Any, Protocol

import serial

from instruments.clock import RealClock
from instruments.errors import InstrumentError

__all__ = ["Line", "SerialLine"]

_LONGEST = 4096
"""Bytes of a reply before it is no reply any more."""
_POLL = 0.02
"""Seconds between two looks at the deadline."""


class Line(Protocol):
    """A connection that carries lines of ASCII text."""

    def send(self, text: str) -> None:
        """Send one line. Raises InstrumentError."""

    def receive(self, asked: str) -> str:
        """The next line without its end; `asked` is the command that it answers, for the sentence.

        Raises InstrumentError when no whole line of ASCII has come within the deadline.
        """

    def close(self) -> None:
        """Let go of the connection. May be called again."""


class SerialLine:
    """See `Line`. `port` is a device's name (COM3) or any URL of pyserial's (socket://HOST:PORT).

    After a failure the port is closed and the next line opens it again, so that a late reply is
    not taken for the answer to a later question, and an instrument that comes back is found.
    """

    def __init__(self, name: str, port: str, baud: int, timeout: float) -> None:
        self._name = f"{name} at {port}"
        self._address = port
        self._baud = baud
        self._timeout = timeout
        self._clock = RealClock()
        self._port: Any = None

    def send(self, text: str) -> None:
        """See `Line.send`."""
        port = self._opened()
        try:
            port.reset_input_buffer()
            port.write(text.encode("ascii") + b"\n")
        except (serial.SerialException, OSError) as error:
            raise self._failed(f"cannot be sent {text!r} ({error}): check its cable and power") from None

    def receive(self, asked: str) -> str:
        """See `Line.receive`."""
        port = self._opened()
        deadline = self._clock.now() + self._timeout
        reply = b""
        while not reply.endswith(b"\n"):
            if self._clock.now() >= deadline:
                raise self._failed(self._late(asked, reply))
            if len(reply) > _LONGEST:
                raise self._failed(f"answered {asked!r} with {_LONGEST} bytes and no end: check 'baud'")
            try:
                reply += port.read(1)
            except (serial.SerialException, OSError) as error:
                raise self._failed(f"was lost after {asked!r} ({error}): check its cable and power") from None
        try:
            text = reply.decode("ascii").strip()
        except UnicodeDecodeError:
            text = ""
        if not text.isprintable() or not text:
            raise self._failed(f"answered {asked!r} with {reply[:60]!r}, which is no text: check 'baud'")
        return text

    def close(self) -> None:
        """See `Line.close`."""
        port, self._port = self._port, None
        if port is None:
            return
        # pyserial waits 0.3 s after closing a socket, and leaves it open when the far end went first.
        link = getattr(port, "_socket", None)
        if link is not None:
            port.is_open = False
            link.close()
            return
        with suppress(serial.SerialException, OSError):
            port.close()

    def _opened(self) -> Any:
        if self._port is None:
            try:
                self._port = serial.serial_for_url(
                    self._address, baudrate=self._baud, timeout=_POLL, write_timeout=self._timeout
                )
            except (serial.SerialException, OSError, ValueError) as error:
                raise InstrumentError(
                    f"{self._name} cannot be opened ({error}): "
                    "correct 'port', plug it in, or close the program that uses it."
                ) from None
        return self._port

    def _failed(self, sentence: str) -> InstrumentError:
        self.close()
        return InstrumentError(f"{self._name} {sentence}.")

    def _late(self, asked: str, reply: bytes) -> str:
        within = f"within {self._timeout:g} s"
        if not reply:
            return f"did not answer {asked!r} {within}: is it switched on, and are 'port' and 'baud' right?"
        if reply.endswith(b"\r"):
            return (
                f"answered {asked!r} with {reply[-60:]!r}, which ends in a carriage return, not in a "
                "line feed: set its terminator to LF"
            )
        return f"answered {asked!r} with {reply[-60:]!r} and no line end {within}: check its terminator"
