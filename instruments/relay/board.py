"""The logic of every relay box with numbered channels: switch over in order, read back, keep alive.

`ChannelRelay` is the logic, and a `RelayBoard` its port to one product. A driver's board speaks the
product's protocol; a twin's is an adapter to a simulated box.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Protocol

from pydantic import Field, field_validator

from ...base.bounded import Positive, Strict
from ...base.clock import Clock
from ...base.errors import ConfigurationError, InstrumentError
from .role import Relay

_PATIENCE = 0.1
"""Time for a command to show in the read-back (s): ten times that of USB (docs/hardware.md, "Relay box")."""

_MILLISECOND = 1e-3


class BoardSettings(Strict):
    """Keys of the `[relay]` table common to all boards."""

    patches: Annotated[dict[str, int], Field(min_length=1)]
    """Channel of each patch."""
    rating: Positive
    """Highest voltage that a channel may switch (V peak)."""
    settle: Positive = 0.02
    """Settling time of the contacts after the box has reported a change, and interval of read-backs (s).
    The whole chain takes less than 10 ms (paper; docs/hardware.md, "Relay box")."""
    patience: Annotated[float, Field(strict=True, gt=0, le=5)] | None = None
    """Time for a command to show in the read-back (s); None: 0.1 s, and for a hub in the network 1 s."""

    @property
    def waits(self) -> float:
        """The `patience`, or its default (s)."""
        return self.patience or _PATIENCE

    @field_validator("patches")
    @classmethod
    def _one_patch_each(cls, patches: dict[str, int]) -> dict[str, int]:
        channels = list(patches.values())
        twice = [c for c in channels if channels.count(c) > 1]
        if twice:
            raise ValueError(f"channel {twice[0]} is given to more than one patch")
        return patches


@dataclass(frozen=True)
class ChannelState:
    """One channel as the board reports it."""

    closed: bool
    remaining: float = math.inf
    """Time until the board opens it by itself (s); infinite without a timer."""


class RelayBoard(Protocol):
    """The port to one product. Every method raises InstrumentError, within a deadline, when it fails."""

    identity: str
    dead_man: float
    """Seconds that `close_channel` lasts; infinite for a board that cannot open by itself."""

    def states(self) -> Mapping[int, ChannelState]:
        """State of every channel, as the board itself reports it."""

    def open_channel(self, channel: int) -> None:
        """Command a channel to open."""

    def close_channel(self, channel: int) -> None:
        """Command a channel to close, or to stay closed, for `dead_man` seconds from now on."""

    def release(self) -> None:
        """Close the connection, if there is one. May be called again."""


class ChannelRelay(Relay):
    """See `Relay`. Break before make; a state counts only once it is read back.

    Channels that no patch is wired to are left alone. After an error nothing is renewed, so that
    the board's dead-man opens all closed channels.
    """

    def __init__(self, settings: BoardSettings, clock: Clock, board: RelayBoard) -> None:
        self.identity = board.identity
        self.patches = tuple(settings.patches)
        self.rating = settings.rating
        self.dead_man = board.dead_man
        self._channels = settings.patches
        self._settle = settings.settle
        self._waits = settings.waits
        self._clock = clock
        self._board = board
        self._held: frozenset[str] = frozenset()
        self._released = False
        # A renewal that runs in another thread must not close what has just been opened.
        self._switching = threading.RLock()

    def _connect(self, patches: Collection[str]) -> None:
        wanted = frozenset(patches)
        unknown = sorted(wanted - set(self._channels))
        if unknown:
            raise ConfigurationError(
                f"{self.identity} has no patch {unknown[0]!r}: the rig file wires "
                f"{', '.join(self._channels)}."
            )
        self._check_open()
        with self._switching:
            self._held = frozenset()
            others = [p for p in self._channels if p not in wanted]
            # What has rested open needs no time to open: a finger would feel the wait before its drive. To
            # open everything is always commanded, whatever the box reports.
            if not wanted or any(state.closed for state in self._states(others).values()):
                self._open(others)
                self._expect(others, frozenset())
            for patch in sorted(wanted):
                self._board.close_channel(self._channels[patch])
            self._expect(self._channels, wanted)
            self._held = wanted

    def connected(self) -> frozenset[str]:
        """See `Relay.connected`."""
        self._check_open()
        states = self._states(self._channels)
        return frozenset(patch for patch, state in states.items() if state.closed)

    def _renew(self) -> None:
        """A channel that opened by itself is not closed again: the drive may be on."""
        with self._switching:
            if self._held:
                self._renew_held()

    def _renew_held(self) -> None:
        self._check_open()
        held, self._held = self._held, frozenset()
        for patch, state in self._states(self._channels).items():
            if state.closed != (patch in held):
                now = "closed" if state.closed else "open"
                raise InstrumentError(
                    f"{self._name(patch)} reads {now} though it was left "
                    f"{'open' if state.closed else 'closed'}: "
                    f"was it not renewed for {self.dead_man:g} s, or is another program using the box?"
                )
        for patch in sorted(held):
            self._board.close_channel(self._channels[patch])
        self._held = held

    def close(self) -> None:
        """See `Relay.close`."""
        self._held = frozenset()
        self._released = True
        self._board.release()

    def _open(self, patches: Iterable[str]) -> None:
        """Command every patch to open, even after an error, then raise the first error."""
        failures = []
        for patch in patches:
            try:
                self._board.open_channel(self._channels[patch])
            except InstrumentError as error:
                failures.append(error)
        if failures:
            raise failures[0]

    def _expect(self, patches: Collection[str], held: Collection[str]) -> None:
        """Check that of these patches exactly `held` read closed, their dead-man running; then settle."""

        def complaint() -> str:
            states = self._states(patches)
            for patch, state in states.items():
                if state.closed != (patch in held):
                    told, read = ("close", "open") if patch in held else ("open", "closed")
                    return (
                        f"{self._name(patch)} was told to {told} but reads {read}: "
                        "check the box and its cable."
                    )
                if state.closed and state.remaining > self.dead_man + _MILLISECOND:
                    return (
                        f"{self._name(patch)} is closed, but its dead-man of {self.dead_man:g} s "
                        "is not running: update the firmware of the box, or replace it."
                    )
            return ""

        if patches:
            read_back(complaint, self._clock, self._settle, self._waits)
            # The board reports its own state; the contacts follow.
            self._clock.sleep(self._settle)

    def _states(self, patches: Iterable[str]) -> dict[str, ChannelState]:
        states = self._board.states()
        missing = [p for p in patches if self._channels[p] not in states]
        if missing:
            raise InstrumentError(f"{self._name(missing[0])}: the box has no such channel.")
        return {p: states[self._channels[p]] for p in patches}

    def _name(self, patch: str) -> str:
        return f"{self.identity}: channel {self._channels[patch]} (patch {patch})"

    def _check_open(self) -> None:
        if self._released:
            raise InstrumentError(f"{self.identity} has been closed; open the rig again.")


def read_back(complaint: Callable[[], str], clock: Clock, pause: float, patience: float) -> None:
    """Poll every `pause` seconds until `complaint` reports no fault of a command's effect.

    Raises InstrumentError with the complaint when it persists for `patience` seconds.
    """
    deadline = clock.now() + max(patience, 2 * pause)
    while sentence := complaint():
        if clock.now() >= deadline:
            raise InstrumentError(sentence)
        clock.sleep(pause)
