"""A finding: the result of one test of a rig."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Status = Literal["green", "yellow", "red"]


@dataclass(frozen=True)
class Finding:
    """The result of one test.

    Green: as the rig file says. Yellow: usable, or not tested. Red: must be repaired before the rig is
    used.
    """

    name: str
    instrument: str
    """The role in the rig file, or the sensor."""
    status: Status
    sentence: str
    """The measurement, and what to do about it."""
