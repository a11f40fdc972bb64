"""The four kinds of error that haploop raises, each with a one-sentence message.

The command line turns them into exit codes: a wrong request or
configuration is 2, an instrument that failed is 3.
"""

from __future__ import annotations


class HaploopError(Exception):
    """Base of all errors that haploop raises on purpose; `str(error)` is one clear sentence."""

    exit_code = 2


class ConfigurationError(HaploopError):
    """The rig file, an argument or the installation is wrong."""


class LimitError(HaploopError):
    """A waveform was refused before anything was written, because it breaks a limit."""


class DataError(HaploopError):
    """A file or a measurement cannot be used for a step."""


class InstrumentError(HaploopError):
    """An instrument did not answer, refused a command, lost samples or read back another value."""

    exit_code = 3


class TakenError(InstrumentError):
    """Somebody else has stopped what this program played or recorded, or taken an output that it held."""
