"""Lines of text over a serial port."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from typing import Any

import serial

from .text_line import Port, TextLine

__all__ = ["SerialLine", "serial_trouble"]

_POLL = 0.02
"""Time-out of one read (s): pyserial's is fixed while the port is open."""


class SerialLine(TextLine):
    """See `TextLine`. `port` is a device's name (COM3) or any URL of pyserial's (socket://HOST:PORT)."""

    def __init__(self, name: str, port: str, baud: int, timeout: float) -> None:
        def connect() -> Port:
            try:
                return _SerialPort(
                    serial.serial_for_url(port, baudrate=baud, timeout=_POLL, write_timeout=timeout)
                )
            except (serial.SerialException, OSError, ValueError) as error:
                raise ConnectionError(
                    f"{serial_trouble(error)}; correct 'port', plug it in, or close the program that uses it"
                ) from None

        super().__init__(f"{name} at {port}", connect, "its 'port' and 'baud'", timeout)


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
        # pyserial waits 0.3 s after closing a socket, and leaves it open when the far end closed first.
        link = getattr(self._port, "_socket", None)
        if link is not None:
            self._port.is_open = False
            link.close()
            return
        with suppress(serial.SerialException, OSError):
            self._port.close()


def serial_trouble(error: Exception) -> str:
    """Why a port failed, in a few words: pyserial nests the system's text, with numbers, in its own."""
    if isinstance(error, ValueError):
        return "it is no name of a serial port and no URL of one"
    said = re.search(r"Errno (\d+)|\w+Error\((\d+)", str(error))
    number = getattr(error, "errno", None) or (int(said[1] or said[2]) if said else None)
    return os.strerror(number).lower() if number else "it was disconnected, or another program uses it"
