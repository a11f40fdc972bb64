"""How warm the coils on each piece of hardware are, for every program that plays on it.

A coil's smoothed dissipation (see `coil`) falls exponentially at rest, so one number and its time say all
that earlier plays have left. It is kept before a play begins, as it will be at its end, so that a killed
program's heat counts as well. Times are those of `duty`. All coils of a rig are counted as one that had every
play.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from pathlib import Path

from ...base.clock import Clock
from ...base.errors import DataError
from ...base.json_text import as_file, of_file
from ..limits import Limits
from . import machine

_KIND = "heat"

Warmth = tuple[float, float]
"""A time (s) and the smoothed dissipation at it (W); infinite when it is not known: all that a coil takes."""
_COLD: Warmth = (0.0, 0.0)
_ALL = 1e300
"""Stands for all that a coil takes (W); JSON has no infinity."""


class Heat:
    """How warm the coils of one rig are. `counted` is the folder that programs share; None to forget it."""

    def __init__(self, clock: Clock, hardware: Collection[str], counted: Path | None) -> None:
        self._clock, self._hardware, self._counted = clock, hardware, counted
        self._warmth = _COLD

    def recall(self) -> None:
        """Take over what other programs have left."""
        if self._counted is not None:
            self._warmth = warmth_of(self._counted, self._hardware, self._clock.now())

    def left(self, limits: Limits) -> float:
        """Smoothed dissipation (W) that is left now in the coil of these limits; 0 without one."""
        if limits.coil is None:
            return 0.0
        at, watts = self._warmth
        return limits.coil.left(watts if watts < _ALL else limits.power, self._clock.now() - at)

    def count(self, limits: Limits, own: float, seconds: float) -> None:
        """Count a play that is about to begin, which leaves `own` (W) after `seconds`. Raises DataError."""
        if limits.coil is None:
            return
        end = self._clock.now() + seconds
        self._keep((end, limits.coil.left(self.left(limits), seconds) + own))

    def ended(self, limits: Limits) -> None:
        """A play has ended now: later than counted, where its source was late. Raises DataError."""
        if limits.coil is not None:
            at, watts = self._warmth
            self._keep((max(at, self._clock.now()), watts))

    def stood(self, limits: Limits, volts: float) -> None:
        """Count volts at the coil that stood until now, nobody knows for how long. Raises DataError."""
        if limits.coil is not None:
            self._keep((self._clock.now(), max(self.left(limits), volts**2 / limits.coil.resistance)))

    def lose(self) -> None:
        """Count the coil as warm as it may be: it got volts that nobody counted. Raises DataError."""
        self._keep((self._clock.now(), _ALL))

    def _keep(self, warmth: Warmth) -> None:
        self._warmth = warmth
        if self._counted is not None:
            keep_warmth(self._counted, self._hardware, warmth)


def warmth_of(folder: Path, hardware: Collection[str], now: float) -> Warmth:
    """The warmest of these pieces. A time to come counts as now; a file that cannot be read as not known.

    The caller holds the hardware's lock.
    """
    found: list[Warmth] = [_COLD]
    for piece in hardware:
        try:
            at, watts = _parsed(machine.read(folder / machine.file_for(piece, _KIND)))
        except FileNotFoundError:
            continue
        except (OSError, ValueError):
            at, watts = now, math.inf
        found.append((min(at, now), watts))
    # With one time constant, what is warmest now need not be warmest at its own time: the latest is taken
    # with the largest, which is never less.
    return max(at for at, _ in found), max(watts for _, watts in found)


def keep_warmth(folder: Path, hardware: Collection[str], warmth: Warmth) -> None:
    """Keep how warm the coils are, for all these pieces. Raises DataError when it cannot be written."""
    content = as_file(_KIND, [round(warmth[0], 3), warmth[1]])[0].encode()
    for piece in sorted(hardware):
        path = folder / machine.file_for(piece, _KIND)
        try:
            machine.write(path, content)
        except OSError as error:
            raise DataError(
                f"What a play heats cannot be counted in {path} ({error.strerror}), and nothing is played "
                "without that: free disk space, or remove what is there under this name."
            ) from None


def _parsed(content: bytes) -> Warmth:
    """Raises ValueError for anything else than what `keep_warmth` writes."""
    told = of_file(_KIND, content)
    if not (isinstance(told, list) and len(told) == 2 and all(type(x) in (int, float) for x in told)):
        raise ValueError("no warmth")
    at, watts = map(float, told)
    if not (math.isfinite(at) and 0 <= watts < math.inf):
        raise ValueError("no warmth")
    return at, watts
