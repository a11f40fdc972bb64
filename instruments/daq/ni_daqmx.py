"""NI-DAQmx cards, on the public API of NI's `nidaqmx` package.

The cards are in this computer, or behind an NI device server (`server = "host:port"`): the same
calls then travel by gRPC, with no NI driver on this side.

Several cards are one Daq: the card of the outputs is master, and the others run on its sample
clock (docs/hardware.md, "Two cards on one clock"), armed before it. That needs an RTSI cable that is
declared in NI MAX.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ...base.clock import Clock
from ...base.errors import ConfigurationError, HaploopError, InstrumentError, LimitError, TakenError
from ...base.signals import uninterrupted
from ..driver import one_name
from .ni_settings import FILTERS, NiSettings, Output, device_of
from .role import Daq, Stream, StreamRequest

if TYPE_CHECKING:
    from .ni_outputs import NiOutputs
    from .ni_sessions import Sessions
    from .ni_stream import NiStream

# NI's library is loaded when cards are opened: a simulated rig needs the settings alone.


class NiDaq(Daq):
    """See `Daq`."""

    taped = True

    class Settings(NiSettings):
        """The `[daq]` table of a rig file."""

    def __init__(self, settings: Settings, sessions: Sessions) -> None:
        self._settings = settings
        self._sessions = sessions
        self._streams: list[NiStream] = []
        # Tasks of one name: two threads that zero, or look at the outputs, at once would clear each other's.
        self._zeroing, self._reading = threading.RLock(), threading.RLock()
        from .ni_cards import find_cards  # noqa: PLC0415
        from .ni_outputs import NiOutputs  # noqa: PLC0415

        self._cards = find_cards(_products(settings), sessions, settings.server)
        homes: dict[str, dict[str, Output]] = {}
        for name, output in settings.outputs.items():
            homes.setdefault(self._cards[device_of(output.terminal)].home, {})[name] = output
        self._outputs = {home: NiOutputs(self, home, own) for home, own in homes.items()}
        self._holding = False
        self.simulated = any(card.simulated for card in self._cards.values())
        self.identity = " + ".join(
            f"{card.product} ({card.name}, serial {card.serial:X})" for card in self._cards.values()
        )

    @staticmethod
    def hardware(settings: Settings) -> tuple[str, ...]:
        """See `Driver.hardware`: each card by its serial number, whatever a rig file calls it and its server.

        A card without a number is named as the rig file does, and so is one that cannot be asked now.
        """
        # Ctrl-C would leave half of the library, which cannot be imported again.
        with uninterrupted():
            from .ni_cards import numbers_of  # noqa: PLC0415

        return _pieces(settings, numbers_of(_products(settings), settings.server))

    @property
    def pieces(self) -> tuple[str, ...]:
        """What `hardware` names, by the numbers of the cards that were opened."""
        return _pieces(self._settings, {name: card.numbers for name, card in self._cards.items()})

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Find the cards. Changes no output. `clock` is not needed: the cards have their own.

        Raises InstrumentError when the driver, the server, or a card is not there, and
        ConfigurationError when a card is not the product that the rig file says.
        """
        from .ni_sessions import Sessions  # noqa: PLC0415

        sessions = Sessions.at(settings.server)
        try:
            return cls(settings, sessions)
        except BaseException:
            sessions.close()
            raise

    def _stream(self, request: StreamRequest) -> Stream:
        from .ni_cards import Plan  # noqa: PLC0415
        from .ni_stream import NiStream  # noqa: PLC0415

        self._refuse(request)
        known, outputs = self._settings.channels, self._settings.outputs
        plan = Plan.of(
            {name: known[name].terminal for name in request.channels},
            {name: outputs[name].terminal for name in request.play},
            self._cards,
        )
        with self._reading:
            stream = NiStream(self, plan, request)
            self._streams.append(stream)
        return stream

    def cards(self, channels: Sequence[str]) -> Mapping[str, Sequence[str]]:
        """See `Daq.cards`."""
        groups: dict[str, list[str]] = {}
        for name in channels:
            channel = self._settings.channels.get(name)
            groups.setdefault(device_of(channel.terminal) if channel else "", []).append(name)
        return groups

    def filtered(self, channel: str) -> bool:
        """See `Daq.filtered`: delta-sigma converters are, and a channel whose filter the rig file states."""
        own = self._settings.channels[channel]
        return own.filter_delay is not None or self._cards[device_of(own.terminal)].product in FILTERS

    def clear_left(self) -> None:
        """See `Daq.clear_left`."""
        names = dict.fromkeys(name for card in self._cards.values() for name in (card.name, card.home))
        counted = [name for name, channel in self._settings.channels.items() if channel.counter]
        purposes = ("input", "output", "outputs", "reserved", *(f"counter {name}" for name in counted))
        self._sessions.clear_left(f"{n} {purpose}" for n in names for purpose in purposes)

    def zero(self) -> None:
        """See `Daq.zero`. Stops every play first, because a playing task reserves its outputs."""
        self._every(lambda outputs: outputs.rest())
        if not self._holding:
            self._every(lambda outputs: outputs.let_go())

    def hold(self) -> None:
        """See `Daq.hold`: a task keeps the outputs reserved."""
        self._holding = True
        self._every(lambda outputs: outputs.rest())

    def _let_go(self) -> None:
        self._holding = False
        self._every(lambda outputs: outputs.let_go())

    def _every(self, step: Callable[[NiOutputs], None]) -> None:
        """Take a step for each card's outputs: one that fails must not keep another one from it."""
        failures = []
        with self._zeroing:
            for outputs in self._outputs.values():
                for stream in self._streams:
                    stream.stopped(outputs)
                try:
                    step(outputs)
                except InstrumentError as error:
                    failures.append(error)
        if failures:
            taken = any(isinstance(error, TakenError) for error in failures)
            kind = TakenError if taken else InstrumentError
            raise kind(" ".join(str(error) for error in failures)) from failures[0]

    def outputs_read(self) -> Mapping[str, float]:
        """See `Daq.outputs_read`, through the cards' internal channels for it."""
        with self._reading:
            streaming = {home for stream in self._streams for home in stream.homes}
            return self._outputs_read({card.home for card in self._cards.values()} - streaming)

    def _outputs_read(self, homes: Collection[str]) -> dict[str, float]:
        named: dict[str, list[str]] = {}
        for name, output in self._settings.outputs.items():
            card = self._cards[device_of(output.terminal)]
            if card.reads_outputs and card.home in homes:
                named.setdefault(card.name, []).append(name)
        read: dict[str, float] = {}
        for device, names in named.items():
            with self.talking_to(device), self.task(f"{device} outputs") as task:
                for name in names:
                    terminal = self._settings.outputs[name].terminal
                    # Full scale, whatever the rig file allows: another program may put out more.
                    task.ai_channels.add_ai_voltage_chan(
                        f"{device}/_{terminal.partition('/')[2]}_vs_aognd", min_val=-10.0, max_val=10.0
                    )
                volts = task.read()
            read |= zip(names, volts if isinstance(volts, list) else [volts], strict=True)
        return read

    def close(self) -> None:
        """See `Daq.close`."""
        for stream in list(self._streams):
            stream.release()
        with suppress(InstrumentError):  # the server is gone, and has its own way with tasks
            self._let_go()
        self._sessions.close()

    # For streams

    def task(self, purpose: str) -> Any:
        """See `Sessions.task`."""
        return self._sessions.task(purpose)

    def add_output(self, task: Any, output: Output) -> None:
        """Give a task an output; a card whose range is narrower than the library's +-10 V refuses those."""
        low = 0.0 if self._cards[device_of(output.terminal)].unipolar else -output.range
        task.ao_channels.add_ao_voltage_chan(output.terminal, min_val=low, max_val=output.range)

    def read_back(self, home: str) -> Mapping[str, float]:
        """Volts on the outputs of a card or chassis, by name, where no input of it runs any more."""
        with self._reading, suppress(HaploopError):
            return self._outputs_read({home})
        return {}

    def outputs_at(self, home: str) -> NiOutputs:
        """The outputs of a card or chassis."""
        return self._outputs[home]

    def done(self, outputs: NiOutputs) -> None:
        """Free outputs whose play is over, unless they are held."""
        if not self._holding:
            outputs.let_go()

    def forget(self, stream: NiStream) -> None:
        """Remove a stream that has released its tasks."""
        if stream in self._streams:
            self._streams.remove(stream)

    @contextmanager
    def talking_to(self, device: str) -> Iterator[None]:
        """Turn any error of NI's library into one sentence about `device`."""
        from .ni_cards import translated, understood  # noqa: PLC0415

        with understood(device), translated(device, self._settings.server):
            yield

    # Checks

    def _refuse(self, request: StreamRequest) -> None:
        channels, play, outputs = request.channels, request.play, self._settings.outputs
        request.refuse_unknown(self._settings.channels, outputs)
        if not channels or len(set(channels)) != len(channels):
            raise ConfigurationError("A stream needs at least one channel, and each channel once.")
        if request.block < 1 or (request.samples is not None and request.samples < 2):
            raise ConfigurationError("A block has 1 sample or more, a finite stream 2 or more.")
        if 0 in map(len, play.values()):
            raise LimitError("A waveform has a sample or more.")
        for name, volts in play.items():
            largest = np.abs(volts).max()
            # NaN compares as false with everything.
            if not largest <= outputs[name].range:
                raise LimitError(
                    f"The waveform for {name!r} reaches {largest:g} V, and the output's range is "
                    f"+-{outputs[name].range:g} V."
                )


def _pieces(settings: NiDaq.Settings, numbers: Mapping[str, Collection[str]]) -> tuple[str, ...]:
    """Each card by its numbers, and one that has none by its name and server."""
    here = one_name(settings.server or "this computer")
    return tuple(
        piece for name in _products(settings) for piece in numbers.get(name) or [f"{here} {name.lower()}"]
    )


def _products(settings: NiDaq.Settings) -> dict[str, str | None]:
    """Product of every card that a rig file names; None where the file gives none."""
    used = [channel.terminal for channel in settings.channels.values()]
    used += [output.terminal for output in settings.outputs.values()]
    names = dict.fromkeys([*(device_of(terminal) for terminal in used), *settings.devices])
    return {name: settings.devices.get(name) for name in names}
