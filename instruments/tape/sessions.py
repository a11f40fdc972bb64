"""The tape of this program's session, for all rigs that are opened in a context."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from ...base.errors import ConfigurationError
from .player import Player
from .recorder import Recorder

_current: ContextVar[Recorder | Player | None] = ContextVar("haploop_session", default=None)


def current() -> Recorder | Player | None:
    """What rigs that are opened now are recorded by, or played from."""
    return _current.get()


@contextmanager
def recorded(path: str | Path) -> Iterator[Recorder]:
    """Record every call between rigs that are opened in this context and their devices, into a new file.

    A program's own calls, of nidaqmx or pyserial, pass it by: without any call of a rig it warns, and leaves
    no file. Raises ConfigurationError when the file exists or cannot be written, and DataError at its end
    when the tape could not be written to its end.
    """
    with recording_of(path) as recorder:
        yield recorder
    if not recorder.calls:
        # The third frame is the caller's: contextlib's lies between.
        warnings.warn(
            f"Nothing was recorded, and {path} was not written: no call passed through a rig of haploop. "
            "Open one inside recorded(...). The calls of a program that uses nidaqmx by itself are recorded "
            "on simulated cards: `haploop twin ni --device Dev1=PCIe-6363 --tape FILE.tape -- COMMAND`.",
            stacklevel=3,
        )


@contextmanager
def recording_of(path: str | Path) -> Iterator[Recorder]:
    """As `recorded`, and says nothing when nothing was recorded."""
    with Recorder(Path(path)) as recorder, _entered(recorder):
        yield recorder


@contextmanager
def played(path: str | Path) -> Iterator[Player]:
    """Play a tape to all rigs that are opened in this context with `simulate="tape:FILE"`.

    One rig alone needs no such context. Raises ConfigurationError, DataError; TapeError for a difference.
    """
    with Player(Path(path)) as player, _entered(player):
        yield player


@contextmanager
def _entered(deck: Recorder | Player) -> Iterator[None]:
    if _current.get() is not None:
        raise ConfigurationError("One tape is in use already: end it first.")
    token = _current.set(deck)
    try:
        yield
    finally:
        _current.reset(token)
