"""Simulated relay box for any protocol, and the Yocto-MaxiCoupler's twin."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...base.clock import Clock
from ...instruments.relay import ChannelRelay, ChannelState
from ...instruments.relay.yocto import Yocto
from ..plant import Faults, OnRelay, RelayFailure, Switched, Switches

_LATENCY = (3e-3, 10e-3)
"""Limits of the random delay from command to the box's processor (s; estimate: USB and HTTP)."""
_OPERATE = 1e-3
"""Delay from the processor to the contact (s; estimate: 0.5 to 2 ms)."""


class Contacts(Protocol):
    """The part of the plant that a box uses."""

    @property
    def clock(self) -> Clock:
        """The plant's time."""

    def rng(self, name: str) -> np.random.Generator:
        """Return the plant's seeded random generator for one of its parts."""

    @property
    def faults(self) -> Faults:
        """The plant's faults; the box calls `OnRelay.relay` of those at the relay."""

    def wire(self, box: Switches) -> None:
        """Connect a box's contacts to the patches; each step to `until` first calls `box.take(until)`."""


class Misbehaviour(Protocol):
    """A cause of failures, as the box sees it."""

    def fires(self, kind: RelayFailure, channel: int) -> bool:
        """Return True when a channel fails in this way now, and count the failure."""


@dataclass
class BoxFault:
    """A failure of one channel (see `RelayFailure`), added to `SimulatedBox.faults` by hand."""

    kind: RelayFailure
    channel: int
    times: float = math.inf
    """Number of times that it fires."""
    fired: int = 0

    def fires(self, kind: RelayFailure, channel: int) -> bool:
        """See `Misbehaviour.fires`."""
        fires = (kind, channel) == (self.kind, self.channel) and self.fired < self.times
        self.fired += fires
        return fires


@dataclass(frozen=True)
class _PlantFault:
    """Adapter of a plant's fault, which acts on patches, to the box, which has channels."""

    fault: OnRelay
    patches: Mapping[int, str]
    clock: Clock

    def fires(self, kind: RelayFailure, channel: int) -> bool:
        """See `Misbehaviour.fires`."""
        patch = self.patches.get(channel)
        return patch is not None and self.fault.relay(kind, patch, self.clock.now())


@dataclass
class _Channel:
    """State of one channel. Times are the plant's (s); infinite means never."""

    closed: bool = False
    pulse_end: float = math.inf
    limit: float = math.inf
    """Longest time closed (s); renewed pulses do not extend it. The product's behaviour is not known; this
    interpretation of maxTimeOnStateB is the hardest on a driver."""
    limit_end: float = math.inf
    open_limit: float = math.inf
    """Longest time open (s), after which it closes by itself: maxTimeOnStateA."""
    open_end: float = math.inf
    delayed: float = math.inf
    delayed_length: float = 0.0

    def next_event(self) -> float:
        return min(self.pulse_end, self.limit_end, self.open_end, self.delayed)


class SimulatedBox:
    """Channels with pulse timers, whose contacts switch patches of the plant.

    `channels` maps each wired channel to its patch, `numbers` lists all channels (eight by default;
    docs/hardware.md, "Relay box"). Commands arrive late and in order, and queries queue behind them, so
    that a read-back is never older than the last command; the contacts follow after a delay. Events are
    computed when a method is called. The box does not call the plant: `take` reports the contacts, so a
    plant may call it while it holds its own lock. Safe to share between threads. Times are in seconds of
    `clock`.
    """

    def __init__(
        self,
        channels: Mapping[int, str],
        clock: Clock,
        rng: np.random.Generator,
        numbers: Iterable[int] = range(1, 9),
    ) -> None:
        self.faults: list[Misbehaviour] = []
        self._patches = dict(channels)
        self._clock = clock
        self._rng = rng
        self._lock = threading.Lock()
        self._channels = {number: _Channel() for number in numbers}
        self._arriving: list[tuple[float, Callable[[float], None]]] = []
        self._switched: list[Switched] = []
        self._latest = -math.inf

    def set_state(self, channel: int, closed: bool) -> None:
        """Close a channel until the next command (or until its limit), or open it."""
        self._send(channel, lambda at: self._set(channel, closed, at))

    def toggle(self, channel: int) -> None:
        """Close an open channel, or open a closed one."""
        self._send(channel, lambda at: self._set(channel, not self._channels[channel].closed, at))

    def pulse(self, channel: int, length: float, delay: float = 0.0) -> None:
        """Close a channel for `length` s, after `delay` s; it then opens by itself."""

        def begin(at: float) -> None:
            if delay > 0:
                self._channels[channel].delayed = at + delay
                self._channels[channel].delayed_length = length
            else:
                self._set(channel, length > 0, at, length)

        self._send(channel, begin)

    def limit(self, channel: int, longest: float) -> None:
        """Open the channel `longest` s after it next closes; 0 removes the limit."""

        def begin(_at: float) -> None:
            self._channels[channel].limit = longest or math.inf

        self._send(channel, begin)

    def limit_open(self, channel: int, longest: float) -> None:
        """Close the channel `longest` s after it next opens; 0 removes the limit."""

        def begin(_at: float) -> None:
            self._channels[channel].open_limit = longest or math.inf

        self._send(channel, begin)

    def open_limits(self) -> dict[int, float]:
        """Return the longest time that each channel stays open (s); infinite without a limit."""
        with self._lock:
            self._arrive()
            return {n: c.open_limit for n, c in self._channels.items()}

    def states(self) -> dict[int, ChannelState]:
        """Return the states that the box reports now; `remaining` is from the pulse timer."""
        with self._lock:
            now = self._arrive()
            return {n: ChannelState(c.closed, c.pulse_end - now) for n, c in self._channels.items()}

    def limits(self) -> dict[int, float]:
        """Return the longest time that each channel may stay closed (s); infinite without a limit."""
        with self._lock:
            self._arrive()
            return {n: c.limit for n, c in self._channels.items()}

    def delays(self) -> dict[int, float]:
        """Return the time until each channel's delayed pulse begins (s); infinite without one."""
        with self._lock:
            now = self._arrive()
            return {n: c.delayed - now for n, c in self._channels.items()}

    def take(self, until: float) -> list[Switched]:
        """Return, once, each contact that switches as a result of events up to `until` (s)."""
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
        """Process all events until a query sent now reaches the box, and return that time (s).

        Looking ahead of the clock is safe here, because no later command can overtake the query.
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
                self._set(number, channel.open_end == timer, timer)

    def _set(self, number: int, closed: bool, at: float, length: float = math.inf) -> None:
        channel = self._channels[number]
        channel.delayed = math.inf
        if channel.closed != closed and self._fires("stuck", number):
            channel.pulse_end = channel.limit_end = channel.open_end = math.inf
            return
        if not closed:
            channel.limit_end = math.inf
            channel.open_end = at + channel.open_limit if channel.closed else channel.open_end
        else:
            channel.open_end = math.inf
            channel.limit_end = channel.limit_end if channel.closed else at + channel.limit
        channel.pulse_end = at + length if closed else math.inf
        if channel.closed != closed:
            channel.closed = closed
            if number in self._patches and not self._fires("welded", number):
                self._switched.append((self._patches[number], closed, at + _OPERATE))

    def _fires(self, kind: RelayFailure, channel: int) -> bool:
        return any(fault.fires(kind, channel) for fault in self.faults)


def box_in(plant: Contacts, patches: Mapping[str, int], numbers: Iterable[int] = range(1, 9)) -> SimulatedBox:
    """Create a box wired to a plant, with each patch on its channel."""
    wiring = {channel: patch for patch, channel in patches.items()}
    box = SimulatedBox(wiring, plant.clock, plant.rng("relay"), numbers)
    box.faults.extend(_PlantFault(fault, wiring, plant.clock) for fault in plant.faults.at(OnRelay))
    plant.wire(box)
    return box


class BoxAdapter:
    """Adapter of a `SimulatedBox` to the `RelayBoard` of a twin: called directly, without a protocol."""

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
