"""What was played on each piece of hardware in the last minute, by any program: the history behind the duty.

A play is counted before it begins, with its whole length, so that a killed program's counts as well. Times
are of the clock that runs since the computer was started (`RealClock`), which its programs share and nobody
can set.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from contextlib import suppress
from pathlib import Path

from ...base.errors import DataError
from ...base.json_text import as_file, of_file
from . import machine

MINUTE = 60.0
"""Window of the duty (s)."""
_KIND = "duty"
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
            spans = _parsed(machine.read(path))
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
            if all(stop < now - _OLD for _, stop in _parsed(machine.read(path))):
                path.unlink()


def _formatted(plays: Iterable[Span]) -> bytes:
    return as_file(_KIND, [[round(start, 3), round(stop, 3)] for start, stop in plays])[0].encode()


def _parsed(content: bytes) -> list[Span]:
    """Raises ValueError for anything else than what `_formatted` makes."""
    spans = []
    listed = of_file(_KIND, content)
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
