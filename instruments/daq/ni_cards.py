"""NI cards: their errors, the properties that they report, and the tasks and channels of a stream on them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Self

from nidaqmx.constants import (
    AngleUnits,
    BridgeConfiguration,
    BridgeUnits,
    Coupling,
    EncoderType,
    ExcitationSource,
    ProductCategory,
    TerminalConfiguration,
)
from nidaqmx.errors import DaqError, DaqNotFoundError, DaqNotSupportedError, RpcError

from ...base.errors import ConfigurationError, HaploopError, InstrumentError
from ...base.signals import uninterrupted
from .ni_sentences import first_line, refused, unclocked
from .ni_sessions import Sessions
from .ni_settings import Channel, NiSettings, device_of

# Translate exceptions of NI's library into one sentence each.


@contextmanager
def translated(device: str, server: str | None) -> Iterator[None]:
    """Turn any error of NI's library into one sentence about `device`.

    Raises InstrumentError, or ConfigurationError for a cause in the rig file. The loss of a device
    server (host:port) is not a DAQmx error, and has its own sentence.
    """
    try:
        yield
    except DaqError as error:
        raise refused(device, error.error_code, str(error)) from error
    except (DaqNotFoundError, DaqNotSupportedError):
        raise InstrumentError(
            "The NI-DAQmx driver is not installed on this computer: install it from ni.com, or name "
            'the computer that has it as server = "host:port" in [daq].'
        ) from None
    except RpcError as error:
        raise InstrumentError(
            f"The NI device server at {server} failed while {device} was used: "
            f"{first_line(str(error))} Restart the server, and check the outputs."
        ) from error


@contextmanager
def understood(device: str) -> Iterator[None]:
    """Turn an exception of NI's library at an invalid answer into one sentence about `device`.

    An answer that is too long, or that holds a value unknown to the library, is not an error of NI's
    but any exception of Python. Raises InstrumentError. Must be entered before `translated`.
    """
    try:
        yield
    except HaploopError:
        raise
    except Exception as error:
        said = first_line(f"{type(error).__name__}: {error}".rstrip(": "))
        raise InstrumentError(
            f"{device} answered what NI's library cannot make sense of. {said} Restart the driver or device "
            "server, and see that its version and the library's belong together."
        ) from error


_PATIENCE = 5.0
"""Time for a device server to answer when it is asked for its cards' numbers (s)."""
_READ_OUTPUTS = (ProductCategory.M_SERIES_DAQ, ProductCategory.X_SERIES_DAQ)
"""Families with internal channels `_aoN_vs_aognd` (docs/hardware.md, "All NI cards")."""


@dataclass(frozen=True)
class Card:
    """Properties that a card reports."""

    name: str
    product: str
    serial: int
    simulated: bool
    home: str
    """Device whose clocks its tasks use: the card itself, or the chassis of a module."""
    simultaneous: bool
    reads_outputs: bool = False
    """True when it has internal channels for the volts of its outputs."""
    unipolar: bool = False
    """True when its outputs do not go below 0 V."""
    numbers: tuple[str, ...] = ()
    """Its product and serial number, and its chassis'; none where it has no number."""


def find_cards(products: Mapping[str, str | None], sessions: Sessions, server: str | None) -> dict[str, Card]:
    """Find cards by name; `products` gives the required product of each, or None.

    Raises InstrumentError when one is missing, and ConfigurationError when one is another product.
    """
    cards = {}
    for name, wanted in products.items():
        with understood(name), translated(name, server):
            system = sessions.system()
            present = system.devices.device_names
            found = next((p for p in present if p.lower() == name.lower()), None)
            if found is None:
                raise InstrumentError(
                    f"There is no NI device {name!r}; the system lists "
                    f"{', '.join(present) or 'none at all'}. Check its name in NI MAX."
                )
            cards[name] = _card(system.devices[found], name)
        if wanted and wanted != cards[name].product:
            raise ConfigurationError(
                f"{name} is a {cards[name].product}, and the rig file says {wanted}: correct devices "
                "in [daq], or the device's name in NI MAX."
            )
    return cards


def numbers_of(names: Iterable[str], server: str | None) -> dict[str, tuple[str, ...]]:
    """Product and serial number of each card, by its name; of a module its chassis' too.

    Modules share the clocks of a chassis. A card that is missing or does not answer is left out. One without
    a number (0, as a device that NI's driver simulates may report) has none here.
    """
    found: dict[str, tuple[str, ...]] = {}
    with (
        # grpc's channel keeps Python from ending when Ctrl-C comes while it connects or is closed.
        uninterrupted(),
        suppress(HaploopError),
        closing(Sessions.asking(server, _PATIENCE)) as sessions,
        understood("NI-DAQmx"),
        translated("NI-DAQmx", server),
    ):
        devices = sessions.system().devices
        present = {name.lower(): name for name in devices.device_names}
        for name in names:
            if name.lower() in present:
                found[name] = _numbers(devices[present[name.lower()]])
    return found


@dataclass(frozen=True)
class Plan:
    """The tasks of a stream: (device of the clock, channel names), the master's first."""

    inputs: tuple[tuple[str, tuple[str, ...]], ...]
    counters: tuple[tuple[str, str], ...]
    """(device of the clock, channel name) of each channel that counts."""
    output: str | None
    cards: Mapping[str, Card]

    @classmethod
    def of(cls, channels: Mapping[str, str], outputs: Mapping[str, str], cards: Mapping[str, Card]) -> Self:
        """Choose the master, and assign the channels and outputs (terminals by name) to tasks.

        Raises ConfigurationError for outputs of several cards.
        """
        homes: dict[str, list[str]] = {}
        counters = {name: t for name, t in channels.items() if "ctr" in t.partition("/")[2].lower()}
        for name, terminal in channels.items():
            if name in counters:
                continue
            homes.setdefault(cards[device_of(terminal)].home, []).append(name)
        playing = {cards[device_of(terminal)].home for terminal in outputs.values()}
        if len(playing) > 1:
            raise ConfigurationError(
                f"The outputs {', '.join(outputs)} lie on several cards: one card must play them together."
            )
        if not homes:
            raise unclocked(list(counters))
        preferred = next(iter(playing), None)
        master = preferred if preferred in homes else next(iter(homes))
        order = [master, *(home for home in homes if home != master)]
        counting = tuple((cards[device_of(terminal)].home, name) for name, terminal in counters.items())
        return cls(tuple((home, tuple(homes[home])) for home in order), counting, preferred, cards)

    @property
    def master(self) -> str:
        """Device whose sample clock all tasks use."""
        return self.inputs[0][0]

    def scanning(self, names: Iterable[str], settings: NiSettings) -> list[Card]:
        """Cards that convert these channels one after the other."""
        used = dict.fromkeys(device_of(settings.channels[name].terminal) for name in names)
        return [self.cards[device] for device in used if not self.cards[device].simultaneous]

    def conversions(self, task: Any) -> tuple[list[float], list[str]]:
        """Delay of each channel's conversion after the clock edge (s), in the task's order; its product."""
        before: dict[str, int] = {}
        delays: list[float] = []
        products: list[str] = []
        for channel in task.ai_channels:
            name = device_of(channel.physical_channel.name)
            card = next((card for key, card in self.cards.items() if key.lower() == name.lower()), None)
            if card is None:
                raise InstrumentError(f"A task has a channel of {name!r}, which it was not given: try again.")
            index = before[name] = before.get(name, -1) + 1
            interval = 0.0
            if index and not card.simultaneous:
                timing = task.timing if card.home == card.name else task.timing[card.name]
                interval = 1 / believed(card.name, "convert rate (Hz)", float(timing.ai_conv_rate), 1.0, 1e9)
            delays.append(index * interval)
            products.append(card.product)
        return delays, products


def believed(device: str, what: str, value: float, low: float, high: float) -> float:
    """Return a value that a card reports. Raises InstrumentError outside `low` to `high`."""
    if not low <= value <= high:
        raise InstrumentError(
            f"{device} says that its {what} is {value:g}, which cannot be: restart the driver or the device "
            "server."
        )
    return value


def _card(device: Any, name: str) -> Card:
    return Card(
        name=name,
        product=str(device.product_type),
        serial=int(device.serial_num),
        simulated=bool(device.is_simulated),
        home=str(device.compact_daq_chassis_device.name) if _is_module(device) else name,
        # A module without inputs has no such property.
        simultaneous=len(device.ai_physical_chans) > 0 and bool(device.ai_simultaneous_sampling_supported),
        reads_outputs=device.product_category in _READ_OUTPUTS,
        unipolar=len(device.ao_physical_chans) > 0 and min(device.ao_voltage_rngs, default=-1.0) >= 0,
        numbers=_numbers(device),
    )


def _numbers(device: Any) -> tuple[str, ...]:
    parts = [device, device.compact_daq_chassis_device] if _is_module(device) else [device]
    return tuple(f"{part.product_type} {part.serial_num:X}" for part in parts if part.serial_num)


def _is_module(device: Any) -> bool:
    return bool(device.product_category == ProductCategory.C_SERIES_MODULE)


# Channels of NI's input tasks as a rig file describes them: coupling, excitation, bridges, counters.
#
# Whatever an input supplies, its rows are volts at the terminal: a bridge is read as a ratio and multiplied
# by its excitation, and the sensor's own description says what the volts mean.

_CONFIGS = {
    "default": TerminalConfiguration.DEFAULT,
    "diff": TerminalConfiguration.DIFF,
    "rse": TerminalConfiguration.RSE,
    "nrse": TerminalConfiguration.NRSE,
    "pseudodiff": TerminalConfiguration.PSEUDO_DIFF,
}
_COUPLINGS = {"ac": Coupling.AC, "dc": Coupling.DC}
_BRIDGES = {
    "full": BridgeConfiguration.FULL_BRIDGE,
    "half": BridgeConfiguration.HALF_BRIDGE,
    "quarter": BridgeConfiguration.QUARTER_BRIDGE,
}


def factor(channel: Channel) -> float:
    """Volts at the terminal for one unit that the driver reads."""
    return channel.bridge_excitation if channel.bridge is not None else 1.0


def add_input(task: Any, channel: Channel) -> None:
    """Give a task an analog input."""
    limit = channel.range / factor(channel)
    if channel.bridge is not None:
        added = task.ai_channels.add_ai_bridge_chan(
            channel.terminal,
            min_val=-limit,
            max_val=limit,
            units=BridgeUnits.VOLTS_PER_VOLT,
            bridge_config=_BRIDGES[channel.bridge],
            voltage_excit_source=ExcitationSource.INTERNAL,
            voltage_excit_val=channel.bridge_excitation,
            nominal_bridge_resistance=channel.bridge_resistance,
        )
    else:
        added = task.ai_channels.add_ai_voltage_chan(
            channel.terminal, terminal_config=_CONFIGS[channel.config], min_val=-limit, max_val=limit
        )
    if channel.coupling is not None:
        added.ai_coupling = _COUPLINGS[channel.coupling]
    if channel.excitation is not None:
        added.ai_excit_src = ExcitationSource.INTERNAL
        added.ai_excit_val = channel.excitation


def add_counter(task: Any, channel: Channel) -> None:
    """Give a task a counter."""
    if channel.counter == "encoder":
        # In ticks: quarter periods, whatever a turn has of them.
        task.ci_channels.add_ci_ang_encoder_chan(
            channel.terminal, decoding_type=EncoderType.X_4, units=AngleUnits.TICKS
        )
    else:
        task.ci_channels.add_ci_count_edges_chan(channel.terminal)
