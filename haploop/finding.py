"""What `haploop doctor` says of one thing that it looked at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["Finding", "Status"]

Status = Literal["green", "yellow", "red"]


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Green is as the rig file says; yellow works, or could not be judged; red must be mended before
    the rig is used.
    """

    name: str
    instrument: str
    """The role in the rig file, or the sensor."""
    status: Status
    sentence: str
    """What was measured, and what to do about it."""
