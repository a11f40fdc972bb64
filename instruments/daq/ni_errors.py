"""Translate exceptions of NI's library into one sentence each."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from nidaqmx.errors import DaqError, DaqNotFoundError, DaqNotSupportedError, RpcError

from ...base.errors import HaploopError, InstrumentError
from .ni_sentences import first_line, refused


@contextmanager
def translated(device: str, server: str | None) -> Iterator[None]:
    """Turn any error of NI's library into one sentence about `device`.

    Raises InstrumentError, or ConfigurationError for a cause in the rig file. The loss of a device
    server (host:port) is not a DAQmx error, and has its own sentence.
    """
    try:
        yield
    except DaqError as error:
        raise refused(device, error.error_code, str(error)) from error
    except (DaqNotFoundError, DaqNotSupportedError):
        raise InstrumentError(
            "The NI-DAQmx driver is not installed on this computer: install it from ni.com, or name "
            'the computer that has it as server = "host:port" in [daq].'
        ) from None
    except RpcError as error:
        raise InstrumentError(
            f"The NI device server at {server} failed while {device} was used: "
            f"{first_line(str(error))} Restart the server, and check the outputs."
        ) from error


@contextmanager
def understood(device: str) -> Iterator[None]:
    """Turn an exception of NI's library at an invalid answer into one sentence about `device`.

    An answer that is too long, or that holds a value unknown to the library, is not an error of NI's
    but any exception of Python. Raises InstrumentError. Must be entered before `translated`.
    """
    try:
        yield
    except HaploopError:
        raise
    except Exception as error:
        said = first_line(f"{type(error).__name__}: {error}".rstrip(": "))
        raise InstrumentError(
            f"{device} answered what NI's library cannot make sense of. {said} Restart the driver or device "
            "server, and see that its version and the library's belong together."
        ) from error
