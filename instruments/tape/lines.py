"""The boundary at which a driver hands a call to its device: with a tape, without, or played back."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray


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
