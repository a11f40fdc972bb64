"""The boundary at which a driver hands a call to its device, and the recorder that writes it down.

The calling thread turns a call into text; a thread of its own packs and writes, so that a reader never waits
for a disk. A tape that cannot be written stops, and says so at its end: what it records goes on.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from ...base.clock import Clock, RealClock
from ...base.errors import ConfigurationError, DataError
from ...base.threads import Inbox
from .tape_file import KIND, VERSION, Handles, TapeWriter, as_json

# The boundary at which a driver hands a call to its device: with a tape, without, or played back.


@dataclass(frozen=True)
class Failure:
    """An exception that a call may raise, and how it is made again."""

    kind: type[BaseException]
    told: Callable[[Any], tuple[Any, ...]] = lambda error: tuple(
        part if isinstance(part, int | float) else str(part) for part in error.args
    )
    """Arguments with which it is made again."""
    made: Callable[..., BaseException] | None = None
    """Makes it, if not its class."""


@dataclass(frozen=True)
class Call:
    """One call to a device, before it is made."""

    role: str
    """Role of the instrument in the rig file."""
    what: str
    given: tuple[Any, ...] = ()
    filled: tuple[NDArray[Any], ...] = ()
    """Arrays that the device fills; what they held before is no part of the call."""
    failures: tuple[Failure, ...] = ()
    hidden: Mapping[str, str] = field(default_factory=dict)
    """Texts that do not go on the tape, and what stands for each."""
    order: object = None
    """Whose order of calls it belongs to: None for the thread's, else that of an object whose calls come from
    any thread. Its order may end on the tape: a player answers None then."""


class Deck(Protocol):
    """What calls pass through: a recorder or a player."""

    playing: bool

    def pass_on(self, call: Call, make: Callable[[], Any]) -> Any:
        """Return a call's answer, or raise its error."""


_here: ContextVar[tuple[Deck, str] | None] = ContextVar("haploop_tape", default=None)


class TapedLine:
    """A driver's way to its device. Without a tape it makes each call, and does nothing else."""

    def __init__(self, deck: Deck | None, role: str) -> None:
        self._deck, self._role = deck, role

    @property
    def playing(self) -> bool:
        """True when a tape answers, and no device is there."""
        return self._deck is not None and self._deck.playing

    @property
    def taped(self) -> bool:
        """True when calls go to a tape or come from one."""
        return self._deck is not None

    def call(
        self,
        what: str,
        make: Callable[[], Any],
        *given: Any,
        filled: tuple[NDArray[Any], ...] = (),
        failures: tuple[Failure, ...] = (),
        hidden: Mapping[str, str] | None = None,
        order: object = None,
    ) -> Any:
        """Call a device: `make` does it, `what` and `given` say it. Returns and raises as `make` does."""
        if self._deck is None:
            return make()
        call = Call(self._role, what, given, filled, failures, hidden or {}, order)
        return self._deck.pass_on(call, make)


class Proxied:
    """An object of a device's library, whose every method is called through a line.

    A player has no such object: there `target` is the `Handle` that the tape gave. `one_of_many` says in each
    call which object is meant.
    """

    def __init__(
        self,
        line: TapedLine,
        target: Any,
        *,
        failures: tuple[Failure, ...] = (),
        hidden: Mapping[str, str] | None = None,
        fills: Callable[[str], bool] = lambda _name: False,
        one_of_many: bool = False,
    ) -> None:
        self._line, self._target = line, target
        self._failures, self._hidden, self._fills = failures, hidden, fills
        self._named = (target,) if one_of_many else ()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)

        def method(*args: Any, **named: Any) -> Any:
            arrays = _arrays(args) if self._fills(name) else ()
            said = tuple(a for a in args if not any(a is array for array in arrays))
            return self._line.call(
                name,
                lambda: getattr(self._target, name)(*args, **named),
                *self._named,
                *said,
                *([named] if named else []),
                filled=arrays,
                failures=self._failures,
                hidden=self._hidden,
            )

        return method


def _arrays(args: tuple[Any, ...]) -> tuple[NDArray[Any], ...]:
    return tuple(part for part in args if isinstance(part, np.ndarray))


def taped_line() -> TapedLine:
    """The line of the instrument that is being opened: a driver takes it once, in `open`."""
    found = _here.get()
    return TapedLine(None, "") if found is None else TapedLine(*found)


@contextlib.contextmanager
def on_line(deck: Deck | None, role: str) -> Iterator[None]:
    """Let drivers that are opened in this context find the deck by `taped_line`."""
    token = _here.set(None if deck is None else (deck, role))
    try:
        yield
    finally:
        _here.reset(token)


_OFTEN = 0.25
"""Longest time between two flushes while calls are made (s)."""


class Recorder:
    """See `Deck`. A context that writes `path`, a new file; without a call, none is left."""

    playing = False

    def __init__(self, path: Path) -> None:
        """Begin the file. Raises ConfigurationError when it exists or cannot be written."""
        self.path = path
        self.calls = 0
        """Calls so far."""
        self._clock: Clock = RealClock()
        self._handles = Handles()
        self._orders: dict[object, int] = {}
        self._lock = threading.Lock()
        self._lines: Inbox[Mapping[str, Any] | None] = Inbox()
        self._failure: OSError | None = None
        try:
            self._writer = TapeWriter(path)
        except OSError as error:
            why = "exists" if isinstance(error, FileExistsError) else (error.strerror or "").lower()
            raise ConfigurationError(f"The tape {path} cannot be written ({why}): name a new file.") from None
        self._thread = threading.Thread(target=self._write, name="haploop-tape", daemon=True)

    def begin(self, rig: str, mode: str | None, clock: Clock) -> None:
        """Note that a rig is opened: its file as JSON, how it is simulated, and its clock."""
        self._clock = clock
        self._lines.put({"is": "rig", "mode": mode, "real": clock.real, "at": clock.now(), "rig": rig})

    def opening(self, role: str, changes: Mapping[str, Any]) -> None:
        """Note that a driver is opened, with these settings other than the rig file's (a wire's address)."""
        self._lines.put({"is": "open", "role": role, "changes": dict(changes)})

    def pass_on(self, call: Call, make: Callable[[], Any]) -> Any:
        """See `Deck`."""
        # Before the call: NI's library may be given the same array again by then.
        given = as_json(call.given, self._handles, call.hidden)
        begun = self._clock.now()
        try:
            answer = make()
        except BaseException as error:
            self._note(call, given, begun, {"error": self._told(call, error)})
            raise
        told: dict[str, Any] = {"got": as_json(answer, self._handles, call.hidden)}
        if call.filled:
            told["filled"] = [as_json(array, self._handles, {}) for array in call.filled]
        self._note(call, given, begun, told)
        return answer

    def __enter__(self) -> Self:
        self._thread.start()
        software = f"haploop {metadata.version('haploop')}"
        started = datetime.now(UTC).isoformat(timespec="seconds")
        self._lines.put({"format": KIND, "version": VERSION, "software": software, "started": started})
        return self

    def __exit__(self, _kind: object, error: object, _trace: object) -> None:
        self._lines.put(None)
        self._thread.join()
        if not self.calls and self._failure is None:
            self.path.unlink(missing_ok=True)
        if self._failure is not None and error is None:
            why = (self._failure.strerror or str(self._failure)).lower()
            raise DataError(f"The tape {self.path} ends early ({why}); everything else was done.")

    def _told(self, call: Call, error: BaseException) -> list[Any]:
        known = next((f for f in call.failures if type(error) is f.kind), None)
        known = known or next((f for f in call.failures if isinstance(error, f.kind)), None)
        name = known.kind.__name__ if known else ""
        args = known.told(error) if known else (type(error).__name__, str(error))
        return [name, as_json(list(args), self._handles, call.hidden)]

    def _note(self, call: Call, given: Any, begun: float, told: Mapping[str, Any]) -> None:
        now = self._clock.now()
        thread = threading.current_thread()
        order = thread if call.order is None else call.order
        with self._lock:
            number = self._orders.get(order)
            if number is None:
                number = self._orders[order] = len(self._orders)
                name = thread.name if order is thread else call.what
                self._lines.put({"is": "thread", "thread": number, "name": name})
            self.calls += 1
            said = {"is": "call", "n": self.calls, "thread": number, "at": now, "took": round(now - begun, 6)}
            self._lines.put({**said, "role": call.role, "do": call.what, "with": given["t"], **told})

    def _write(self) -> None:
        count, flushed, dirty = 0, 0.0, False
        while True:
            waiting = self._lines.wait()
            now = RealClock().now()
            if self._failure is None and dirty and (not waiting or now - flushed > _OFTEN):
                self._safely(self._writer.flush)
                flushed, dirty = now, False
            if not waiting:
                continue
            said = self._lines.take()
            if said is None:
                self._safely(partial(self._writer.write, {"is": "end", "lines": count}))
                self._safely(self._writer.close)
                if self._failure is not None:
                    with suppress(OSError):
                        self._writer.close()
                return
            self._safely(partial(self._writer.write, said))
            count, dirty = count + 1, True

    def _safely(self, step: Callable[[], None]) -> None:
        """Take a step, unless one has failed."""
        if self._failure is None:
            try:
                step()
            except OSError as error:
                self._failure = error
