"""Plays a tape back: answers every call from the file, and makes none.

Each thread of the session has its own order of calls, and threads have none between them: who was first is
chance. So a thread is matched, at its first call, with a thread of the tape that begins with that call, and
keeps to it. Where a call is another than the tape's, all further calls fail with the same sentence.

The time is the tape's: that of the newest call that was answered, moved on by waits.
"""

from __future__ import annotations

import json
import math
import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np

from ...base.clock import VirtualClock
from ...base.errors import DataError, InstrumentError
from ...base.threads import Flag
from .recorder import Call
from .tape_file import Handles, TapeLines, as_json, from_json

_LOOK = 0.005
"""Interval of looks at the tape's time (s)."""
_SHOWN = 160
"""Longest description of a call (characters)."""


class TapeError(InstrumentError):
    """A tape holds another call than the one that is asked for, or none."""


class TapeClock(VirtualClock):
    """The time of the tape: it moves on to that of each call, and waits take none."""

    def __init__(self, start: float, real: bool, next_call: Callable[[], float]) -> None:
        super().__init__(start)
        self.real = real
        self._next_call = next_call

    def wait(self, event: Flag, duration: float) -> bool:
        """See `Clock.wait`. Ends when the tape reaches this thread's next call, or by the event.

        What repeats a call by time then asks as often as on the tape, however busy this computer is, or that
        of the tape was.
        """
        while not event.wait(_LOOK):
            if self.now() >= self._next_call():
                return False
        return True


@dataclass
class Opening:
    """A rig that was opened while the tape was written."""

    rig: str
    """Its file as JSON."""
    mode: str | None
    start: float
    real: bool
    changes: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    """Settings of drivers that were others than the file's, by role."""


@dataclass
class _Track:
    """The calls of one thread of the tape."""

    name: str
    calls: deque[Mapping[str, Any]] = field(default_factory=deque)
    taken: bool = False


class Player:
    """See `Deck`. A context; raises at its end where a difference was found that nobody has told."""

    playing = True

    def __init__(self, path: Path) -> None:
        """Read and verify the tape. Raises ConfigurationError, DataError."""
        self.path = path
        found = TapeLines.of(path)
        self.whole = found.whole
        """False for a tape that was cut off: its calls are right, and there were more."""
        self.openings: list[Opening] = []
        self._tracks: dict[int, _Track] = {}
        try:
            self.calls = sum(map(self._take, found.lines))
        except (LookupError, TypeError, ValueError):
            raise DataError(f"The tape {path} was written by another version of haploop.") from None
        if not self.openings:
            raise DataError(f"The tape {path} holds no rig: no instrument was opened while it was written.")
        self.answered = 0
        """Calls answered so far, of `calls`."""
        self.difference = ""
        """Sentence about the first call that differs."""
        self._mine: dict[object, _Track] = {}
        self._handles = Handles()
        self._lock = threading.Lock()
        self._opened = 0
        self._clock = TapeClock(0.0, False, self._next_of_this_thread)

    def begin(self) -> tuple[Opening, TapeClock]:
        """Go on to the next rig of the tape, or stay at its last; return it, and its clock."""
        opening = self.openings[min(self._opened, len(self.openings) - 1)]
        self._opened += 1
        self._clock = TapeClock(opening.start, opening.real, self._next_of_this_thread)
        return opening, self._clock

    def pass_on(self, call: Call, make: Callable[[], Any]) -> Any:
        """See `Deck`. Raises TapeError for a call that the tape does not hold."""
        given = as_json(call.given, self._handles, call.hidden)["t"]
        with self._lock:
            if self.difference:
                raise TapeError(self.difference)
            said = self._next(call, given)
            if said is None:
                return None
            self.answered += 1
        try:
            self._clock.sleep_until(float(said["at"]))
            error = _error_of(call, said["error"]) if "error" in said else None
            for array, told in zip(call.filled, said.get("filled", []), strict=error is None):
                array[...] = from_json(told)
            answer = None if error else from_json(said["got"])
        except (LookupError, TypeError, ValueError) as problem:
            told = " ".join(str(problem).split())[:_SHOWN]
            raise TapeError(
                f"The answer to call {said.get('n')} on the tape {self.path} cannot be read ({told}): was "
                "the tape written by another version of haploop?"
            ) from None
        if error is not None:
            raise error
        return answer

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: object, error: object, _trace: object) -> None:
        if self.difference and error is None:
            raise TapeError(self.difference)

    def _take(self, said: Mapping[str, Any]) -> bool:
        """Sort a line of the tape in; True for a call."""
        match said["is"]:
            case "rig":
                self.openings.append(
                    Opening(said["rig"], said["mode"], float(said["at"]), bool(said["real"]))
                )
            case "open":
                self.openings[-1].changes[said["role"]] = dict(said["changes"])
            case "thread":
                self._tracks[said["thread"]] = _Track(said["name"])
            case "call":
                self._tracks[said["thread"]].calls.append(said)
                return True
        return False

    def _next(self, call: Call, given: list[Any]) -> Mapping[str, Any] | None:
        asked = _key(call.role, call.what, given)
        thread = threading.current_thread()
        order = thread if call.order is None else call.order
        track = self._mine.get(order) or self._first(asked, thread.name)
        if call.order is not None and (track is None or not track.calls):
            return None
        if track is None or not track.calls or _key_of(track.calls[0]) != asked:
            self.difference = self._told(_shown(call.role, call.what, given), track, given)
            raise TapeError(self.difference)
        self._mine[order], track.taken = track, True
        return track.calls.popleft()

    def _next_of_this_thread(self) -> float:
        """When the tape has the next call of the thread that asks (s); infinity for none."""
        thread = threading.current_thread()
        with self._lock:
            track = self._mine.get(thread)
            if track is None:
                track = next((t for t in self._free() if t.name == thread.name), None)
            return float(track.calls[0]["at"]) if track is not None and track.calls else math.inf

    def _free(self) -> list[_Track]:
        """Threads of the tape that no thread of the session has been matched with."""
        return [track for track in self._tracks.values() if not track.taken and track.calls]

    def _first(self, asked: str, name: str) -> _Track | None:
        """The unmatched thread of the tape that begins with this call: of the same name, if there is."""
        fits = [track for track in self._free() if _key_of(track.calls[0]) == asked]
        return next((t for t in [*(t for t in fits if t.name == name), *fits]), None)

    def _told(self, shown: str, track: _Track | None, given: list[Any]) -> str:
        sentence = f"The tape {self.path} holds another call than is asked for after {self.answered} calls"
        if track is None:
            held = "; ".join(_shown_of(t.calls[0]) for t in self._free()[:3]) or "nothing more"
            return f"{sentence}. Asked: {shown}. A thread of the tape begins with: {held}."
        if not track.calls:
            end = "ends there" if self.whole else "was cut off there"
            return f"{sentence}. Asked: {shown}. The tape {end}, or this thread of it does ({track.name})."
        first = track.calls[0]
        place = f"call {first['n']}, at {first['at']:.3f} s"
        return (
            f"{sentence}. Asked: {shown}. On the tape ({place}): {_shown_of(first)}{_unlike(given, first)}."
        )


def _key(role: str, what: str, given: list[Any]) -> str:
    return json.dumps([role, what, given])


def _key_of(said: Mapping[str, Any]) -> str:
    return _key(said["role"], said["do"], said["with"])


def _shown_of(said: Mapping[str, Any]) -> str:
    return _shown(said["role"], said["do"], said["with"])


def _shown(role: str, what: str, given: list[Any]) -> str:
    text = f"{role} {what}({', '.join(_short(part) for part in given)})"
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def _short(told: Any) -> str:
    match told:
        case {"a": [str(kind), list(shape), str()]}:
            return f"array of {' x '.join(map(str, shape))} {np.dtype(kind).name}"
        case {"o": int(number)}:
            return f"object {number}"
        case {"b": str(text)}:
            return repr(text.encode("latin-1"))
        case {"t": list(parts)}:
            return f"({', '.join(map(_short, parts))})"
    return repr(told)


def _unlike(given: list[Any], held: Mapping[str, Any]) -> str:
    """Where two arrays of one call differ, which look alike in the sentence."""
    for mine, theirs in zip(given, held["with"], strict=False):
        if mine != theirs and isinstance(mine, dict) and "a" in mine and _short(mine) == _short(theirs):
            a, b = np.ravel(from_json(mine)), np.ravel(from_json(theirs))
            first = int(np.argmax(a != b))
            return f", whose value {first} is {b[first]:.9g}, not {a[first]:.9g}"
    return ""


def _error_of(call: Call, told: list[Any]) -> BaseException:
    name, args = told
    for failure in call.failures:
        if failure.kind.__name__ == name:
            return (failure.made or failure.kind)(*from_json(args))
    kind, sentence = [*map(str, args), "", ""][:2]
    if kind in ("KeyboardInterrupt", "SystemExit", "_Stopped", "_Terminated"):
        return TapeError(f"The session on the tape was interrupted in {call.role} {call.what}.")
    return InstrumentError(f"{call.role} {call.what} failed on the tape: {kind}: {sentence}.")
