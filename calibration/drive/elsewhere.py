"""What a drive does at other points than its own, at the same time: buttons of their own, or silence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from ...instruments.arrays import FloatArray

if TYPE_CHECKING:
    from ...acquisition import Representative

__all__ = ["NOWHERE", "Elsewhere", "Wanted"]

Wanted: TypeAlias = "Mapping[str, Representative | None]"
"""What is wanted at other points: a press that is to be played there, or None for silence."""

NOWHERE: Wanted = {}


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """A point with a button of its own, in the words of `Drive`; or a silent one, whose target is zero."""

    point: str
    button: str
    """Name of the button; empty for a point that is to be silent."""
    target: FloatArray
    scale: float
    carrier_hz: float
    in_band: float
    sources: tuple[tuple[str, str], ...]
    unreached: str
    expected: tuple[float, float]
    """Rms error expected over the target's rms: as calibrated, and after the drift that is planned against.
    Of a silent point it is all motion, over the target of the drive's own point."""
    known_to: float
    """Standard deviation of the responses there, over them (rms)."""
    known_from: str
    """Source of the responses there, in words."""
