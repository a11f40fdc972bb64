"""What a drive does at other points than its own, at the same time: buttons of their own, or silence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from ...instruments import ConfigurationError
from ...instruments.arrays import FloatArray

if TYPE_CHECKING:
    from ...acquisition import Representative

__all__ = ["NOWHERE", "Elsewhere", "Wanted", "sized"]

Wanted: TypeAlias = "Mapping[str, Representative | tuple[Representative, float] | None]"
"""What is wanted at other points: a press that is to be played there, alone or with its size over that of the
drive's own press, or None for silence."""

NOWHERE: Wanted = {}
_MOST = 100.0


def sized(wanted: Wanted) -> list[tuple[Representative | None, float]]:
    """Of each other point its press, None where it is silent, and its size over the drive's own.

    Raises ConfigurationError for a size that no press has.
    """
    each = [one if isinstance(one, tuple) else (one, 1.0) for one in wanted.values()]
    for point, (_, size) in zip(wanted, each, strict=True):
        if not 1 / _MOST <= size <= _MOST:
            raise ConfigurationError(
                f"The button at point {point} cannot be {size:g} times the size of the drive's own: it is "
                f"{1 / _MOST:g} to {_MOST:g} times."
            )
    return each


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
