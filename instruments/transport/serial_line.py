"""Serial ports: lines of text, and bytes that an instrument sends by itself."""

from __future__ import annotations

import errno
import os
import re
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Annotated, Any, Literal, Protocol

import serial
from pydantic import AfterValidator, Field

from ...base.bounded import Strict
from ...base.clock import Clock, RealClock
from ...base.errors import InstrumentError
from ...base.threads import Flag, Inbox
from ..tape import Failure, TapedLine
from .text_line import Port, TextLine

_POLL = 0.02
"""Time-out of one read (s): pyserial's is fixed while the port is open."""


def _stop_bits(bits: float) -> float:
    if bits not in (1, 1.5, 2):
        raise ValueError("use 1, 1.5 or 2")
    return bits


class SerialSettings(Strict):
    """How a serial port is opened, beside its name and rate: keys of an instrument's table."""

    parity: Literal["none", "even", "odd", "mark", "space"] = "none"
    data_bits: Literal[7, 8] = 8
    stop_bits: Annotated[float, Field(strict=True), AfterValidator(_stop_bits)] = 1
    handshake: Literal["none", "rts-cts", "dsr-dtr", "xon-xoff"] = "none"
    dtr: bool | None = None
    """State of DTR from the opening on; None: as the system does. Some boards restart when it rises."""
    rts: bool | None = None
    """State of RTS, likewise."""
    open_wait: Annotated[float, Field(strict=True, ge=0, le=30)] = 0.0
    """Time from opening the port to the first command (s), for a board that restarts meanwhile."""

    def opened(self, port: str, baud: int, timeout: float, write_timeout: float) -> Any:
        """Open a port, by pyserial. Raises serial.SerialException, OSError, ValueError."""
        made = serial.serial_for_url(
            port,
            do_not_open=True,
            baudrate=baud,
            bytesize=self.data_bits,
            parity=_PARITIES[self.parity],
            stopbits=self.stop_bits,
            rtscts=self.handshake == "rts-cts",
            dsrdtr=self.handshake == "dsr-dtr",
            xonxoff=self.handshake == "xon-xoff",
            timeout=timeout,
            write_timeout=write_timeout,
        )
        # Before the port is open, so that a line never has the other state.
        if self.dtr is not None:
            made.dtr = self.dtr
        if self.rts is not None:
            made.rts = self.rts
        made.open()
        if self.open_wait:
            RealClock().sleep(self.open_wait)
            made.reset_input_buffer()
        return made


_PARITIES = {
    "none": serial.PARITY_NONE,
    "even": serial.PARITY_EVEN,
    "odd": serial.PARITY_ODD,
    "mark": serial.PARITY_MARK,
    "space": serial.PARITY_SPACE,
}
_USUAL = SerialSettings()


class SerialLine(TextLine):
    """See `TextLine`. `port` is a device's name (COM3) or any URL of pyserial's (socket://HOST:PORT)."""

    def __init__(
        self,
        name: str,
        port: str,
        baud: int,
        timeout: float,
        *,
        how: SerialSettings = _USUAL,
        end: bytes = b"\n",
    ) -> None:
        def connect() -> Port:
            try:
                return _SerialPort(how.opened(port, baud, _POLL, timeout))
            except (serial.SerialException, OSError, ValueError) as error:
                raise ConnectionError(f"{serial_trouble(error)}; {serial_remedy(error)}") from None

        super().__init__(f"{name} at {port}", connect, "its 'port' and 'baud'", timeout, end)


class _SerialPort(Port):
    def __init__(self, port: Any) -> None:
        self._port = port

    def send(self, data: bytes) -> None:
        try:
            self._port.reset_input_buffer()
            self._port.write(data)
        except (serial.SerialException, OSError) as error:
            raise ConnectionError(serial_trouble(error)) from None

    def receive(self, wait: float) -> bytes:
        try:
            return bytes(self._port.read(1))
        except (serial.SerialException, OSError) as error:
            raise ConnectionError(serial_trouble(error)) from None

    def close(self) -> None:
        close_port(self._port)


def close_port(port: Any) -> None:
    """Close a port of pyserial, in any state; raises nothing.

    Of a socket pyserial waits 0.3 s after closing it, and leaves it open when the far end closed first.
    """
    link = getattr(port, "_socket", None)
    with suppress(serial.SerialException, OSError):
        if link is None:
            port.close()
        else:
            port.is_open = False
            link.close()


def serial_trouble(error: Exception) -> str:
    """Why a port failed, in a few words: pyserial nests the system's text, with numbers, in its own."""
    if isinstance(error, ValueError):
        return "it is no name of a serial port and no URL of one"
    number = _number(error)
    return os.strerror(number).lower() if number else "it was disconnected, or another program uses it"


def serial_remedy(error: Exception) -> str:
    """What to do about a port that cannot be opened."""
    if _number(error) in (errno.EACCES, errno.EPERM):
        return (
            "let this user open it (Debian: `sudo usermod -aG dialout $USER`, and log in again), or close "
            "the program that uses it"
        )
    return "correct 'port', plug it in, or close the program that uses it"


def _number(error: Exception) -> int | None:
    """The system's number of an error; None where it tells none."""
    said = re.search(r"Errno (\d+)|\w+Error\((\d+)", str(error))
    return getattr(error, "errno", None) or (int(said[1] or said[2]) if said else None)


# Bytes that an instrument sends by itself, each part with the time at which it came.

Arrival = tuple[float, bytes]
"""Time (s of the rig's clock) and what had come by then."""

_BYTES_POLL = 0.005
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
            self._port = serial.serial_for_url(port, baudrate=baud, timeout=_BYTES_POLL, write_timeout=1.0)
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
