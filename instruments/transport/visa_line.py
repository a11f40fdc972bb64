"""Lines of text over VISA: USB, GPIB, VXI-11, or a raw socket."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from .text_line import Port, TextLine


class VisaLine(TextLine):
    """See `TextLine`. `resource` is a VISA name, `library` the VISA library: empty for the default."""

    def __init__(self, name: str, resource: str, library: str, timeout: float) -> None:
        def connect() -> Port:
            import pyvisa  # noqa: PLC0415  slow to load, and a simulated rig needs none

            # The manager is shared by the whole process and stays: closing it would close every session.
            try:
                session: Any = pyvisa.ResourceManager(library).open_resource(
                    resource, open_timeout=round(1e3 * timeout)
                )
                session.timeout = 1e3 * timeout
                session.read_termination = session.write_termination = "\n"
            except Exception as error:  # pyvisa-py raises bare Exceptions too
                reason = " ".join(str(error).split()).rstrip(".")
                raise ConnectionError(f"{reason}; {_remedy(reason)}") from None
            return _Session(session, pyvisa)

        super().__init__(f"{name} at {resource}", connect, "its 'resource'", timeout)


def _remedy(reason: str) -> str:
    """What to do about a resource that cannot be opened."""
    for library, kind in (("PyUSB", "usb"), ("gpib", "gpib")):
        if library in reason:
            return (
                f"without a vendor's VISA a resource of {kind.upper()} needs {_NEEDS[kind]}: pip install "
                f"\"haploop[{kind}]\", or install NI-VISA or Keysight's IO Libraries and leave 'visa' out"
            )
    if any(word in reason for word in ("RSRC_LOCKED", "RSRC_BUSY", "NPERMISSION")):
        return "close the program that uses it, or let this user open it"
    return "correct 'resource', switch it on, or install a VISA library (NI-VISA, Keysight's IO Libraries)"


_NEEDS = {"usb": "PyUSB and the system's libusb", "gpib": "gpib-ctypes and the card's own driver"}


class _Session(Port):
    def __init__(self, session: Any, visa: Any) -> None:
        self._session = session
        self._visa = visa

    def send(self, data: bytes) -> None:
        try:
            self._session.write_raw(data)
        except (self._visa.Error, OSError) as error:
            raise ConnectionError(str(error)) from None

    def receive(self, wait: float) -> bytes:
        try:
            self._session.timeout = max(1.0, 1e3 * wait)
            if self._session.resource_class == "SOCKET":
                # Byte by byte, so that with a wrong terminator the received bytes can be quoted.
                return bytes(self._session.read_bytes(1))
            return bytes(self._session.read_raw())
        except self._visa.VisaIOError as error:
            if error.error_code == self._visa.constants.StatusCode.error_timeout:
                return b""
            raise ConnectionError(str(error)) from None
        except (self._visa.Error, OSError) as error:
            raise ConnectionError(str(error)) from None

    def close(self) -> None:
        with suppress(self._visa.Error, OSError):
            self._session.close()
