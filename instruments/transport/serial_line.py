"""Lines of text over a serial port."""

from __future__ import annotations

import errno
import os
import re
from contextlib import suppress
from typing import Annotated, Any, Literal

import serial
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ...base.clock import RealClock
from .text_line import Port, TextLine

_POLL = 0.02
"""Time-out of one read (s): pyserial's is fixed while the port is open."""


def _stop_bits(bits: float) -> float:
    if bits not in (1, 1.5, 2):
        raise ValueError("use 1, 1.5 or 2")
    return bits


class SerialSettings(BaseModel):
    """How a serial port is opened, beside its name and rate: keys of an instrument's table."""

    model_config = ConfigDict(frozen=True, extra="forbid")

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
