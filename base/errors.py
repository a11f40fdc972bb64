"""The four kinds of error that haploop raises, each with a one-sentence message.

The command line turns them into exit codes: a wrong request or
configuration is 2, an instrument that failed is 3.
"""

from __future__ import annotations


class HaploopError(Exception):
    """Base of all errors that haploop raises on purpose; `str(error)` is one clear sentence.

    For example:

        >>> try:
        ...     haploop.load("nothing.h5")
        ... except haploop.HaploopError as error:
        ...     print(error)
        There is no file nothing.h5: check the name.
    """

    exit_code = 2


class ConfigurationError(HaploopError):
    """The rig file, an argument or the installation is wrong."""


class LimitError(HaploopError):
    """A waveform was refused before anything was written, because it breaks a limit."""


class DataError(HaploopError):
    """A file or a measurement cannot be used for a step."""


class InstrumentError(HaploopError):
    """An instrument did not answer, refused a command, lost samples or read back another value.

    For example:

        >>> try:
        ...     raise haploop.InstrumentError("The relay did not answer.")
        ... except haploop.HaploopError as error:
        ...     print(error, "Exit code", error.exit_code)
        The relay did not answer. Exit code 3
    """

    exit_code = 3


class TakenError(InstrumentError):
    """Somebody else has stopped what this program played or recorded, or taken an output that it held."""
