"""DAQmx errors as the wire raises them: a code of NI's and a sentence."""

from __future__ import annotations

from nidaqmx.error_codes import DAQmxErrors, DAQmxWarnings

__all__ = ["DAQmxErrors", "DaqmxError", "error_string"]


class DaqmxError(Exception):
    """A call that the driver refuses. Travels to the client as gRPC status and trailing metadata."""

    def __init__(self, code: DAQmxErrors, text: str, *, read: int | None = None) -> None:
        super().__init__(f"{text}\n\nStatus Code: {code.value}")
        self.code = code.value
        self.read = read
        """Samples per channel that a failed read delivered; None for a call that is not a read."""


def error_string(code: int) -> str:
    """What the driver says about a code, in words made of NI's own name for it."""
    for table in (DAQmxErrors, DAQmxWarnings):
        try:
            name = table(code).name
        except ValueError:
            continue
        return f"{name.replace('_', ' ').capitalize()}.\n\nStatus Code: {code}"
    return ""
