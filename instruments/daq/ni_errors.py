"""Translate NI-DAQmx errors into one sentence each, with the remedy."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.errors import DaqError, DaqNotFoundError, DaqNotSupportedError, RpcError

from haploop.instruments.errors import ConfigurationError, HaploopError, InstrumentError

__all__ = ["cut_off", "translated", "understood"]


@contextmanager
def translated(device: str, server: str | None) -> Iterator[None]:
    """Turn any error of NI's library into one sentence about `device`.

    Raises InstrumentError, or ConfigurationError for a cause in the rig file. The loss of a device
    server (host:port) is not a DAQmx error, and has its own sentence.
    """
    try:
        yield
    except DaqError as error:
        raise _sentence(error, device) from error
    except (DaqNotFoundError, DaqNotSupportedError):
        raise InstrumentError(
            "The NI-DAQmx driver is not installed on this computer: install it from ni.com, or name "
            'the computer that has it as server = "host:port" in [daq].'
        ) from None
    except RpcError as error:
        raise InstrumentError(
            f"The NI device server at {server} failed while {device} was used: "
            f"{_first_line(str(error))} Restart the server, and check the outputs."
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
        said = _first_line(f"{type(error).__name__}: {error}".rstrip(": "))
        raise InstrumentError(
            f"{device} answered what NI's library cannot make sense of. {said} Restart the driver or device "
            "server, and see that its version and the library's belong together."
        ) from error


def cut_off(device: str, played: int) -> InstrumentError:
    """The error of a play that ended after `played` samples, before its end, without an error of NI's."""
    return InstrumentError(
        f"{device} was stopped by somebody else when it had played {played} samples: the waveform was not "
        "played whole. Close the other program and try again."
    )


_EMPTY = "Close what loads this computer and try again."
_SENTENCES = {
    DAQmxErrors.GEN_STOPPED_TO_PREVENT_REGEN_OF_OLD_SAMPLES: "{device} ran out of samples to play (-200290): "
    f"the waveform was not played whole. {_EMPTY}",
    DAQmxErrors.OUTPUT_FIFO_UNDERFLOW_2: "{device} ran out of samples to play, because its memory was not "
    f"filled in time (-200621): the waveform was not played whole. {_EMPTY}",
    DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE: "{device} lost samples, because they were not read in time "
    "(-200279): close what loads this computer, or make buffer_s in [daq] larger.",
    DAQmxErrors.INPUT_FIFO_OVERFLOW: "{device} lost samples, because its own memory overflowed (-200010): "
    "lower the rate, or use fewer channels.",
    DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE: "{device} did not deliver its samples in time (-200284): check "
    "that its sample clock runs, and the cable it comes by.",
    DAQmxErrors.SAMPLES_WILL_NEVER_BE_AVAILABLE: "{device} has no more samples (-200278): its acquisition "
    "has ended.",
    DAQmxErrors.INVALID_TASK: "The acquisition on {device} was ended by somebody else (-200088): start it "
    "again.",
    DAQmxErrors.OPERATION_ABORTED: "The acquisition on {device} was ended by somebody else (-201452): start "
    "it again.",
    DAQmxErrors.PAL_RESOURCE_RESERVED: "{device} is in use by another program or task (-50103): close it "
    "and try again.",
    DAQmxErrors.INVALID_DEVICE_ID: "There is no NI device {device} (-200220): check its name in NI MAX.",
    DAQmxErrors.TRIG_LINE_NOT_FOUND_ROUTING: "{device} has no trigger line to the other card (-89125): "
    "connect a RTSI cable, and declare it in NI MAX with both cards.",
    DAQmxErrors.ROUTE_NOT_SUPPORTED_BY_HW_ROUTING: "{device} cannot be clocked by the other card (-89136): "
    "these two products share no such route.",
    DAQmxErrors.WAIT_UNTIL_DONE_DOES_NOT_INDICATE_DONE: "{device} was not done in time (-200560).",
}
"""Meaning and remedy of each failure (trigger line: docs/hardware.md, "Two cards on one clock")."""

_CONFIGURATION = {
    DAQmxErrors.PHYSICAL_CHAN_DOES_NOT_EXIST: "does not have a terminal that the rig file names (-200170)",
    DAQmxErrors.SAMP_RATE_TOO_HIGH: "cannot sample that fast (-200332)",
    DAQmxErrors.SAMP_RATE_TOO_LOW: "cannot sample that slowly (-200331)",
    DAQmxErrors.INVALID_ATTRIBUTE_VALUE: "does not support what the rig file asks for (-200077)",
    DAQmxErrors.INVALID_AO_DATA_WRITE: "cannot put such voltages out (-200561)",
}
"""Failures caused by the rig file; NI's own message follows, because it names the value."""


def _sentence(error: DaqError, device: str) -> InstrumentError | ConfigurationError:
    code = error.error_type if isinstance(error.error_type, DAQmxErrors) else None
    if code in _SENTENCES:
        return InstrumentError(_SENTENCES[code].format(device=device))
    said = _first_line(str(error))
    if code in _CONFIGURATION:
        return ConfigurationError(f"{device} {_CONFIGURATION[code]}: {said} Correct [daq] in the rig file.")
    if error.error_code in (-201029, -201030):
        return InstrumentError(
            f"{device} cannot use the RTSI bus ({error.error_code}): declare the RTSI cable in NI MAX."
        )
    return InstrumentError(f"{device} refused ({error.error_code}): {said}")


def _first_line(text: str) -> str:
    line = text.strip().partition("\n")[0]
    return line if line.endswith(".") else f"{line}."
