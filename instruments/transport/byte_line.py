"""Bytes that an instrument sends by itself, each part with the time at which it came."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Protocol

import serial

from ...base.clock import Clock
from ...base.errors import InstrumentError
from ...base.flag import Flag
from ...base.inbox import Inbox
from ..tape import Failure, TapedLine
from .serial_line import close_port, serial_remedy, serial_trouble

Arrival = tuple[float, bytes]
"""Time (s of the rig's clock) and what had come by then."""

_POLL = 0.005
"""Time-out of one read (s), and so the largest error of a time."""


class ByteLine(Protocol):
    """A line on which an instrument sends by itself."""

    def arrived(self, wait: float) -> list[Arrival]:
        """Return what has come since the last call, after at most `wait` s of real time for the first.

        Raises InstrumentError when the line is gone, after all that had come before.
        """

    def send(self, data: bytes) -> None:
        """Send bytes. Raises InstrumentError."""

    def close(self) -> None:
        """Close the line. May be called again."""


class SerialBytes:
    """See `ByteLine`. `port` is a device's name (COM3) or any URL of pyserial's (socket://HOST:PORT).

    A thread does nothing but read, so that the times are right however busy the program is.
    """

    def __init__(self, name: str, port: str, baud: int, clock: Clock) -> None:
        self._name, self._clock = f"{name} at {port}", clock
        try:
            self._port = serial.serial_for_url(port, baudrate=baud, timeout=_POLL, write_timeout=1.0)
        except (serial.SerialException, OSError, ValueError) as error:
            raise InstrumentError(
                f"The {self._name} cannot be opened ({serial_trouble(error)}): {serial_remedy(error)}."
            ) from None
        self._inbox: Inbox[Arrival] = Inbox()
        self._closed = Flag()
        self._gone: str | None = None
        self._thread = threading.Thread(target=self._read, name="haploop-bytes", daemon=True)
        self._thread.start()

    def arrived(self, wait: float) -> list[Arrival]:
        """See `ByteLine.arrived`."""
        if not len(self._inbox) and not self._inbox.ended:
            self._inbox.wait(wait)
        came = [self._inbox.take() for _ in range(len(self._inbox))]
        if not came and self._gone is not None and not self._closed.is_set():
            raise InstrumentError(
                f"The {self._name} is gone ({self._gone}): check its cable, and open the rig again."
            )
        return came

    def send(self, data: bytes) -> None:
        """See `ByteLine.send`."""
        try:
            self._port.write(data)
        except (serial.SerialException, OSError) as error:
            raise InstrumentError(f"The {self._name} takes no commands ({serial_trouble(error)}).") from None

    def close(self) -> None:
        """See `ByteLine.close`."""
        if self._closed.is_set():
            return
        self._closed.set()
        self._thread.join(1.0)
        close_port(self._port)

    def _read(self) -> None:
        try:
            while not self._closed.is_set():
                data = self._port.read(4096)
                if data:
                    self._inbox.put((self._clock.now(), bytes(data)))
        except (serial.SerialException, OSError, TypeError) as error:
            self._gone = serial_trouble(error)
            self._inbox.end()


_FAILURES = (Failure(InstrumentError),)


class TapedBytes:
    """See `ByteLine`: one on a line that a tape listens to or answers. `connect` opens the real one."""

    def __init__(self, line: TapedLine, connect: Callable[[], ByteLine]) -> None:
        self._line = line
        self._real: ByteLine | None = None

        def opened() -> None:
            self._real = connect()

        line.call("open", opened, failures=_FAILURES)

    def arrived(self, wait: float) -> list[Arrival]:
        """See `ByteLine.arrived`."""
        found: list[Arrival] = self._line.call("arrived", lambda: self._far.arrived(wait), failures=_FAILURES)
        return found

    def send(self, data: bytes) -> None:
        """See `ByteLine.send`."""
        self._line.call("send", lambda: self._far.send(data), data, failures=_FAILURES)

    def close(self) -> None:
        """See `ByteLine.close`."""
        if self._real is not None:
            self._real.close()

    @property
    def _far(self) -> ByteLine:
        assert self._real is not None, "a player calls nothing"
        return self._real
