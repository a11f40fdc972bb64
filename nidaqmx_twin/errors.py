"""DAQmx errors of the wire: NI's code and a sentence."""

from __future__ import annotations

from nidaqmx._grpc_interpreter import _ERROR_MESSAGES
from nidaqmx.error_codes import DAQmxErrors, DAQmxWarnings

__all__ = ["DAQmxErrors", "DAQmxWarnings", "DaqmxError", "error_string", "unserved", "unsupported"]


class DaqmxError(Exception):
    """Refusal of a call by the driver; sent to the client as gRPC status and trailing metadata."""

    def __init__(
        self, code: DAQmxErrors, text: str, *, read: int | None = None, written: int | None = None
    ) -> None:
        super().__init__(f"{text}\n\nStatus Code: {code.value}")
        self.code = code.value
        self.read = read
        """Samples per channel delivered by a failed read; None for other calls."""
        self.written = written
        """Samples per channel stored by a failed write; None for other calls."""


def unsupported(what: str) -> DaqmxError:
    """The error of a value that a property does not take; `what` says which."""
    return DaqmxError(
        DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
        f"Requested value is not a supported value for this property: {what}",
    )


def unserved(what: str) -> DaqmxError:
    """The error of a property that is not simulated, or not there; `what` says which."""
    return DaqmxError(DAQmxErrors.ATTR_NOT_SUPPORTED, f"Specified property is not supported: {what}")


class AlreadyExistsError(Exception):
    """Refusal of a session whose name is taken; NI's server answers with gRPC's own status for it."""


_SENTENCES = {
    DAQmxErrors.INVALID_ATTRIBUTE_VALUE: "Requested value is not a supported value for this property.",
    DAQmxErrors.INVALID_DEVICE_ID: "Device identifier is invalid.",
    DAQmxErrors.INVALID_TASK: "Task specified is invalid or does not exist.",
    DAQmxErrors.PHYSICAL_CHAN_DOES_NOT_EXIST: "Physical channel specified does not exist on this device.",
    DAQmxErrors.PAL_RESOURCE_RESERVED: "The specified resource is reserved.",
    DAQmxErrors.DEV_CANNOT_BE_ACCESSED: "Device cannot be accessed: it is no longer present in the system.",
    DAQmxErrors.WRITE_NUM_CHANS_MISMATCH: "Write cannot be performed, because the number of channels in the "
    "data does not match the number of channels in the task.",
}


def error_string(code: int) -> str:
    """Return the driver's sentence for a code; without one, words made from NI's name of the code."""
    if code in _ERROR_MESSAGES:
        return str(_ERROR_MESSAGES[DAQmxErrors(code)])
    for known, sentence in _SENTENCES.items():
        if known.value == code:
            return f"{sentence}\n\nStatus Code: {code}"
    for table in (DAQmxErrors, DAQmxWarnings):
        try:
            name = table(code).name
        except ValueError:
            continue
        return f"{name.replace('_', ' ').capitalize()}.\n\nStatus Code: {code}"
    return ""
