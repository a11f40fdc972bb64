"""The simulated relay box, which any protocol can serve, and the Yocto-MaxiCoupler's twin."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from haploop.instruments.clock import Clock
from haploop.instruments.relay import ChannelRelay, ChannelState
from haploop.instruments.relay.yocto import Yocto

__all__ = ["BoxAdapter", "BoxFault", "Contacts", "RelayTwin", "SimulatedBox", "box_in"]

_LATENCY = (3e-3, 10e-3)
"""Seconds from the command to the box's own processor, jittered (estimate; docs/hardware.md, "Relay box")."""
_OPERATE = 1e-3
"""Seconds from there to the contact (estimate; docs/hardware.md, "Relay box")."""

Switched = tuple[str, bool, float]
"""A patch, whether its contact closed, and when (s)."""


class Contacts(Protocol):
    """The part of the plant that a box uses."""

    @property
    def clock(self) -> Clock:
        """The plant's time."""

    def rng(self, name: str) -> np.random.Generator:
        """The plant's seeded randomness for one of its parts."""

    def wire(self, box: SimulatedBox) -> None:
        """Have a box's contacts switch patches: `box.take(until)` is asked before every step to `until`."""

    def box_faults(self, patches: Mapping[str, int]) -> Sequence[BoxFault]:
        """The faults of a box whose channels are wired to patches as given."""


@dataclass
class BoxFault:
    """A misbehaviour of the box, put into `SimulatedBox.faults`.

    lost: the command never reaches the box. stuck: the channel keeps its state through commands and
    timers, and reports it. welded: the contact keeps its state while the box reports the commanded one, so
    that only the drive monitor can tell.
    """

    kind: Literal["lost", "stuck", "welded"]
    channel: int
    times: float = math.inf
    """How often it fires."""
    fired: int = 0

    def fires(self, kind: str, channel: int) -> bool:
        """Whether it fires now; if so, count it."""
        fires = (kind, channel) == (self.kind, self.channel) and self.fired < self.times
        self.fired += fires
        return fires


@dataclass
class _Channel:
    """Times are the plant's (s); infinite means never."""

    closed: bool = False
    pulse_end: float = math.inf
    limit: float = math.inf
    """Longest time closed, whatever pulses were renewed (the reading of maxTimeOnStateB that is
    hardest on a driver; what the product does is not known)."""
    limit_end: float = math.inf
    delayed: float = math.inf
    delayed_length: float = 0.0

    def next_event(self) -> float:
        return min(self.pulse_end, self.limit_end, self.delayed)


class SimulatedBox:
    """Channels with pulse timers, whose contacts switch patches of the plant.

    `channels` says which patch each wired channel switches, `numbers` which channels there are.
    Commands arrive late and in order, and questions queue behind them, so that what is read back is
    never older than what was sent; the contacts follow in time. What has happened is worked out
    when somebody asks. Contacts are reported by `take` alone, so a plant may call it while it
    holds its own lock; the box knows no plant. Safe to share between threads. Times are in seconds
    of `clock`.
    """

    def __init__(
        self,
        channels: Mapping[int, str],
        clock: Clock,
        rng: np.random.Generator,
        numbers: Iterable[int] = range(1, 9),
    ) -> None:
        self.faults: list[BoxFault] = []
        self._patches = dict(channels)
        self._clock = clock
        self._rng = rng
        self._lock = threading.Lock()
        self._channels = {number: _Channel() for number in numbers}
        self._arriving: list[tuple[float, Callable[[float], None]]] = []
        self._switched: list[Switched] = []
        self._latest = -math.inf

    def set_state(self, channel: int, closed: bool) -> None:
        """Close until told otherwise (or until the channel's limit), or open."""
        self._send(channel, lambda at: self._set(channel, closed, at))

    def toggle(self, channel: int) -> None:
        """Close an open channel, open a closed one."""
        self._send(channel, lambda at: self._set(channel, not self._channels[channel].closed, at))

    def pulse(self, channel: int, length: float, delay: float = 0.0) -> None:
        """Close for `length` seconds from now, or from `delay` seconds on; then open by itself."""

        def begin(at: float) -> None:
            if delay > 0:
                self._channels[channel].delayed = at + delay
                self._channels[channel].delayed_length = length
            else:
                self._set(channel, length > 0, at, length)

        self._send(channel, begin)

    def limit(self, channel: int, longest: float) -> None:
        """Open by itself `longest` seconds after the next time that the channel closes; 0 is never."""

        def begin(_at: float) -> None:
            self._channels[channel].limit = longest or math.inf

        self._send(channel, begin)

    def states(self) -> dict[int, ChannelState]:
        """What the box reports now; `remaining` is its pulse timer's."""
        with self._lock:
            now = self._arrive()
            return {n: ChannelState(c.closed, c.pulse_end - now) for n, c in self._channels.items()}

    def limits(self) -> dict[int, float]:
        """Seconds that each channel may stay closed; infinite without a limit."""
        with self._lock:
            self._arrive()
            return {n: c.limit for n, c in self._channels.items()}

    def delays(self) -> dict[int, float]:
        """Seconds until each channel's delayed pulse begins; infinite without one."""
        with self._lock:
            now = self._arrive()
            return {n: c.delayed - now for n, c in self._channels.items()}

    def take(self, until: float) -> list[Switched]:
        """Every contact that switches because of what happened by `until` (s), once."""
        with self._lock:
            self._run(until)
            switched, self._switched = self._switched, []
        return switched

    def _send(self, channel: int, command: Callable[[float], None]) -> None:
        with self._lock:
            if channel not in self._channels:
                raise KeyError(channel)
            arrival = self._clock.now() + float(self._rng.uniform(*_LATENCY))
            if not self._fires("lost", channel):
                self._latest = max(arrival, self._latest)
                self._arriving.append((self._latest, command))

    def _arrive(self) -> float:
        """When a question that is asked now reaches the box; everything until then has happened.

        No later command can overtake it, so looking ahead of the clock to that time is safe.
        """
        at = max(self._clock.now(), self._latest)
        self._run(at)
        return at

    def _run(self, until: float) -> None:
        while True:
            number, channel = min(self._channels.items(), key=lambda item: item[1].next_event())
            timer = channel.next_event()
            command = self._arriving[0][0] if self._arriving else math.inf
            if min(timer, command) > until:
                return
            if command <= timer:
                at, act = self._arriving.pop(0)
                act(at)
            elif channel.delayed == timer:
                self._set(number, channel.delayed_length > 0, timer, channel.delayed_length)
            else:
                self._set(number, False, timer)

    def _set(self, number: int, closed: bool, at: float, length: float = math.inf) -> None:
        channel = self._channels[number]
        channel.delayed = math.inf
        if channel.closed != closed and self._fires("stuck", number):
            channel.pulse_end = channel.limit_end = math.inf
            return
        if not closed:
            channel.limit_end = math.inf
        elif not channel.closed:
            channel.limit_end = at + channel.limit
        channel.pulse_end = at + length if closed else math.inf
        if channel.closed != closed:
            channel.closed = closed
            if number in self._patches and not self._fires("welded", number):
                self._switched.append((self._patches[number], closed, at + _OPERATE))

    def _fires(self, kind: str, channel: int) -> bool:
        return any(fault.fires(kind, channel) for fault in self.faults)


def box_in(plant: Contacts, patches: Mapping[str, int], numbers: Iterable[int] = range(1, 9)) -> SimulatedBox:
    """A box wired to a plant: each patch on its channel."""
    wiring = {channel: patch for patch, channel in patches.items()}
    box = SimulatedBox(wiring, plant.clock, plant.rng("relay"), numbers)
    box.faults.extend(plant.box_faults(patches))
    plant.wire(box)
    return box


class BoxAdapter:
    """A `SimulatedBox` as the `RelayBoard` of a twin: called directly, without a protocol."""

    def __init__(self, identity: str, box: SimulatedBox, dead_man: float) -> None:
        self.identity = identity
        self.dead_man = dead_man
        self._box = box

    def states(self) -> Mapping[int, ChannelState]:
        """See `RelayBoard.states`."""
        return self._box.states()

    def open_channel(self, channel: int) -> None:
        """See `RelayBoard.open_channel`."""
        self._box.set_state(channel, False)

    def close_channel(self, channel: int) -> None:
        """See `RelayBoard.close_channel`."""
        if math.isinf(self.dead_man):
            self._box.set_state(channel, True)
        else:
            self._box.pulse(channel, self.dead_man)

    def release(self) -> None:
        """See `RelayBoard.release`."""


class RelayTwin(ChannelRelay):
    """The twin of `haploop.instruments.relay.yocto.Yocto`, with the same settings."""

    def __init__(self, settings: Yocto.Settings, plant: Contacts) -> None:
        self.box = box_in(plant, settings.patches)
        for channel in settings.patches.values():
            self.box.limit(channel, settings.longest)
        identity = "Yocto-MaxiCoupler (twin)"
        super().__init__(settings, plant.clock, BoxAdapter(identity, self.box, settings.dead_man))
