"""The four ways in which haploop fails, each with one sentence for the person who reads it.

The command line turns them into exit codes (docs/design: rule 8): a wrong request or
configuration is 2, an instrument that failed is 3.
"""

from __future__ import annotations

__all__ = ["ConfigurationError", "DataError", "HaploopError", "InstrumentError", "LimitError"]


class HaploopError(Exception):
    """Base of all errors that haploop raises on purpose; `str(error)` is one clear sentence."""

    exit_code = 2


class ConfigurationError(HaploopError):
    """The rig file, an argument or the installation is wrong."""


class LimitError(HaploopError):
    """A waveform was refused before anything was written, because it breaks a limit."""


class DataError(HaploopError):
    """A file, or what was measured, is not what the step needs."""


class InstrumentError(HaploopError):
    """An instrument did not answer, refused, lost samples or read back something else."""

    exit_code = 3
