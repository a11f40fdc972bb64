"""Lines of text to and from an instrument over any transport, each with a hard deadline."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol

from ...base.clock import Clock, RealClock
from ...base.errors import InstrumentError
from ..tape import Failure, taped_line

_LONGEST = 4096
"""Longest reply (bytes)."""


_ENDS = (
    (b"\r\n", "a carriage return and a line feed", "CR LF"),
    (b"\r", "a carriage return", "CR"),
    (b"\n", "a line feed", "LF"),
)
"""Ends of a line, and their names."""


class Line(Protocol):
    """A connection that carries lines of ASCII text."""

    def send(self, text: str) -> None:
        """Send one line. Raises InstrumentError."""

    def receive(self, asked: str) -> str:
        """Receive the next line without its end; `asked` is its command, for the error message.

        Raises InstrumentError when no complete line of ASCII arrives within the deadline.
        """

    def close(self) -> None:
        """Close the connection. May be called again."""


class Port(ABC):
    """Bytes to and from one instrument. Each method raises ConnectionError, with the reason."""

    @abstractmethod
    def send(self, data: bytes) -> None:
        """Discard unread input, then send."""

    @abstractmethod
    def receive(self, wait: float) -> bytes:
        """Receive one byte or more; nothing when none arrives within `wait` seconds."""

    @abstractmethod
    def close(self) -> None:
        """Close the port, in any state; raises nothing."""


class _NotOpenedError(ConnectionError):
    """The port cannot be opened."""


_FAILURES = (Failure(_NotOpenedError), Failure(ConnectionError))


class TextLine:
    """See `Line`. `connect` opens the port when it is first needed.

    After a failure the port is closed and the next line opens it again, so that a late reply is
    not taken for the answer to a later query, and a reconnected instrument is found. `settings` names
    the settings to check ("'port' and 'baud'"), for error messages.
    """

    def __init__(
        self, name: str, connect: Callable[[], Port], settings: str, timeout: float, end: bytes = b"\n"
    ) -> None:
        """`end` ends each line, in both directions."""
        self._name = name
        self._connect = connect
        self._settings = settings
        self._timeout = timeout
        self._end = end
        self._clock: Clock = RealClock()
        self._port: Port | None = None
        self._line = taped_line()

    def send(self, text: str) -> None:
        """See `Line.send`."""
        data = text.encode("ascii") + self._end
        try:
            self._line.call("send", lambda: self._opened().send(data), data, failures=_FAILURES)
        except _NotOpenedError as error:
            raise InstrumentError(f"{self._name} cannot be opened ({error}).") from None
        except ConnectionError as error:
            raise self._failed(f"cannot be sent {text!r} ({error}): check its cable and power") from None

    def receive(self, asked: str) -> str:
        """See `Line.receive`."""
        reply: bytes
        try:
            reply = self._line.call("receive", self._received, failures=_FAILURES)
        except _NotOpenedError as error:
            raise InstrumentError(f"{self._name} cannot be opened ({error}).") from None
        except ConnectionError as error:
            raise self._failed(f"was lost after {asked!r} ({error}): check its cable and power") from None
        if len(reply) > _LONGEST:
            raise self._failed(f"answered {asked!r} with {_LONGEST} bytes and no end: check {self._settings}")
        if not reply.endswith(self._end):
            raise self._failed(self._late(asked, reply))
        try:
            text = reply.decode("ascii").strip()
        except UnicodeDecodeError:
            text = ""
        if not text.isprintable() or not text:
            raise self._failed(
                f"answered {asked!r} with {reply[:60]!r}, which is no text: check {self._settings}"
            )
        return text

    def close(self) -> None:
        """See `Line.close`."""
        port, self._port = self._port, None
        if port is not None:
            port.close()

    def _received(self) -> bytes:
        """Bytes up to a line's end, or those that came before the deadline, or too many."""
        port = self._opened()
        deadline = self._clock.now() + self._timeout
        reply = b""
        while not reply.endswith(self._end) and len(reply) <= _LONGEST:
            left = deadline - self._clock.now()
            if left <= 0:
                break
            reply += port.receive(left)
        return reply

    def _opened(self) -> Port:
        if self._port is None:
            try:
                self._port = self._connect()
            except ConnectionError as error:
                raise _NotOpenedError(*error.args) from None
        return self._port

    def _failed(self, sentence: str) -> InstrumentError:
        self.close()
        return InstrumentError(f"{self._name} {sentence}.")

    def _late(self, asked: str, reply: bytes) -> str:
        within = f"within {self._timeout:g} s"
        if not reply:
            return f"did not answer {asked!r} {within}: is it switched on, and is {self._settings} right?"
        found = next((name for end, name, _ in _ENDS if reply.endswith(end)), None)
        if found is not None:
            wanted, short = next((name, short) for end, name, short in _ENDS if end == self._end)
            return (
                f"answered {asked!r} with {reply[-60:]!r}, which ends in {found}, not in {wanted}: "
                f"set its terminator to {short}"
            )
        return f"answered {asked!r} with {reply[-60:]!r} and no line end {within}: check its terminator"
