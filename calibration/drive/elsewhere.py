"""What a drive does at other points than its own, at the same time: buttons of their own, or silence."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from ...acquisition import load_press
from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError

if TYPE_CHECKING:
    from ...acquisition import AverageMethod, Representative

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


def load_elsewhere(
    also: Iterable[tuple[str, str | Path]],
    quiet_at: Iterable[str],
    times: Iterable[tuple[str, float]] = (),
    method: AverageMethod = "automatic",
) -> Wanted:
    """Read what is wanted at other points: `also` is points with a file of their press each, or with several
    recordings of it; the points `quiet_at` are to be silent; `times` are sizes of presses over the
    drive's own.

    Raises ConfigurationError for a point that is both, or a size without a press; and what `load_press`
    raises.
    """
    files: dict[str, list[str | Path]] = {}
    for point, path in also:
        files.setdefault(point, []).append(path)
    silent, sizes = dict.fromkeys(quiet_at), dict(times)
    if both := sorted(files.keys() & silent.keys()):
        raise ConfigurationError(f"Point {both[0]} cannot be silent and play a press: leave one out.")
    if nowhere := sorted(sizes.keys() - files.keys()):
        raise ConfigurationError(f"A size is given for point {nowhere[0]}, and no press to play there.")
    presses = {point: (load_press(paths, method), sizes.get(point, 1.0)) for point, paths in files.items()}
    return {**presses, **silent}


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
