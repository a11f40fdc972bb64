"""What was played on each piece of hardware in the last minute, and how warm its coils are.

A play is counted before it begins, with its whole length, so that a killed program's counts as well. Times
are of the clock that runs since the computer was started (`RealClock`), which its programs share and nobody
can set.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from contextlib import suppress
from pathlib import Path

from ...base.clock import Clock
from ...base.errors import DataError
from ...base.json_files import as_file, of_file
from ..limits import Limits
from . import machine

MINUTE = 60.0
"""Window of the duty (s)."""
_DUTY = "duty"
_OLD = 86_400.0
"""Age of a file of a piece that is not used any more (s)."""

Span = tuple[float, float]
"""Begin and end of a play."""


def plays_of(folder: Path, hardware: Collection[str], now: float) -> list[Span]:
    """Plays of the last minute on any of these pieces, in seconds of the clock, in order of their ends.

    `now` is the present. A file that cannot be read counts as a minute of playing that has just ended. A play
    that ends in the future (its program was killed, or the computer has been started again since) counts as
    if it had just ended. A file of either kind is replaced by that. The caller holds the hardware's lock.
    """
    found: set[Span] = set()
    for piece in hardware:
        path = folder / machine.file_for(piece, "duty")
        try:
            spans = _parsed_spans(machine.read(path))
        except FileNotFoundError:
            continue
        except (OSError, ValueError):
            spans, past = [], [(now - MINUTE, now)]
        else:
            past = [(start - max(0.0, stop - now), min(stop, now)) for start, stop in spans]
        if past != spans:
            with suppress(OSError):
                machine.write(path, _formatted(past))
        found.update(past)
    return sorted((span for span in found if span[1] > now - MINUTE), key=lambda span: span[1])


def count_plays(folder: Path, hardware: Collection[str], plays: Iterable[Span]) -> None:
    """Keep these plays (seconds of the clock) for all these pieces, instead of what was kept.

    The caller holds the lock of the hardware. Raises DataError when one cannot be written.
    """
    content = _formatted(plays)
    for piece in sorted(hardware):
        path = folder / machine.file_for(piece, "duty")
        try:
            machine.write(path, content)
        except OSError as error:
            raise DataError(
                f"What is played cannot be counted in {path} ({error.strerror}), and nothing is played "
                "without that: free disk space, or remove what is there under this name."
            ) from None


def clear_old(folder: Path, now: float) -> None:
    """Remove the files of pieces on which nothing was played for a day."""
    for path in folder.glob("*.duty"):
        with suppress(OSError, ValueError):
            if all(stop < now - _OLD for _, stop in _parsed_spans(machine.read(path))):
                path.unlink()


def _formatted(plays: Iterable[Span]) -> bytes:
    return as_file(_DUTY, [[round(start, 3), round(stop, 3)] for start, stop in plays])[0].encode()


def _parsed_spans(content: bytes) -> list[Span]:
    """Raises ValueError for anything else than what `_formatted` makes."""
    spans = []
    listed = of_file(_DUTY, content)
    if not isinstance(listed, list):
        raise ValueError("no list")
    for entry in listed:
        if not (isinstance(entry, list) and len(entry) == 2 and all(type(x) in (int, float) for x in entry)):
            raise ValueError("no span")
        start, stop = map(float, entry)
        if not (math.isfinite(start) and math.isfinite(stop) and start <= stop):
            raise ValueError("no time")
        spans.append((start, stop))
    return spans


# How warm the coils on each piece of hardware are, for every program that plays on it.
#
# A coil's smoothed dissipation (see `coil`) falls exponentially at rest, so one number and its time say all
# that earlier plays have left. It is kept before a play begins, as it will be at its end, so that a killed
# program's heat counts as well. Times are those of `duty`. All coils of a rig are counted as one that had
# every play.

_HEAT = "heat"

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
            at, watts = _parsed_warmth(machine.read(folder / machine.file_for(piece, _HEAT)))
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
    content = as_file(_HEAT, [round(warmth[0], 3), warmth[1]])[0].encode()
    for piece in sorted(hardware):
        path = folder / machine.file_for(piece, _HEAT)
        try:
            machine.write(path, content)
        except OSError as error:
            raise DataError(
                f"What a play heats cannot be counted in {path} ({error.strerror}), and nothing is played "
                "without that: free disk space, or remove what is there under this name."
            ) from None


def _parsed_warmth(content: bytes) -> Warmth:
    """Raises ValueError for anything else than what `keep_warmth` writes."""
    told = of_file(_HEAT, content)
    if not (isinstance(told, list) and len(told) == 2 and all(type(x) in (int, float) for x in told)):
        raise ValueError("no warmth")
    at, watts = map(float, told)
    if not (math.isfinite(at) and 0 <= watts < math.inf):
        raise ValueError("no warmth")
    return at, watts
