"""Twin of NI's cards: `CardTwin` with NI's products, timing and sentences.

Simulated NI cards (`nidaqmx_twin`) as the wire of a rig.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError, HaploopError
from ...base.wording import did_you_mean
from ...instruments.daq import StreamRequest
from ...instruments.daq.ni_daqmx import NiDaq
from ...instruments.daq.ni_sentences import (
    cut_off,
    other_rate,
    refused,
    shared_rates,
    unclocked,
    unshared,
    zeroed,
)
from ...instruments.daq.ni_settings import Channel, device_of
from ...nidaqmx_twin.converter import LOST, STOPPED
from ...nidaqmx_twin.nodes import PlayStopped, SamplesLost
from ...nidaqmx_twin.products import Product, convert_interval, described, input_range
from ..plant import Plant
from .card_twin import Card, CardTwin

_NO_CABLE = -89125
"""NI's error for cards without a trigger line between them."""
_UNSUPPORTED, _TOO_FAST, _TOO_SLOW = -200077, -200332, -200331
"""NI's errors for what a product does not support, and for rates that it has not."""
_SAME = 1e-6
"""Largest relative difference of two clocks that are one, as the driver's."""
_PLAYED = 1e-3
"""Largest relative difference from the rate that a waveform was made for, as the driver's."""


class DaqTwin(CardTwin):
    """See `CardTwin`: the cards of a rig file."""

    def __init__(self, settings: NiDaq.Settings, plant: Plant) -> None:
        self._settings = settings
        known = described(settings.products)
        self._products = {device: _product(device, name, known) for device, name in settings.devices.items()}
        _refuse_terminals(settings, self._products)
        super().__init__(plant, *(_card(name, p, settings) for name, p in self._products.items()))

    def filtered(self, channel: str) -> bool:
        """See `Daq.filtered`."""
        stated = self._settings.channels[channel].filter_delay is not None
        return stated or self._products[self._card_of[channel].device].delta_sigma

    def _range(self, card: Card, channel: str) -> float:
        """Return the card's next wider range (+- V), as the driver chooses it; what a counter may count."""
        if channel in card.counters:
            return card.channels[channel]
        product, wanted = self._products[card.device], card.channels[channel]
        full_scale = input_range(product, wanted)
        if full_scale is None:
            raise ConfigurationError(
                f"The channel {channel!r} asks for +-{wanted:g} V, and the widest range of a {product.name} "
                f"is +-{max(product.ai_ranges, default=0):g} V."
            )
        return full_scale

    def _delays(self, card: Card, rate_hz: float, channels: Sequence[str]) -> FloatArray:
        product, count = self._products[card.device], len(channels)
        interval = convert_interval(product, rate_hz, count)
        if self._settings.ai_conv_rate is not None and not product.ai_simultaneous:
            interval = 1 / self._settings.ai_conv_rate
        return np.arange(count, dtype=np.float64) * interval - product.filter_delay(rate_hz)

    def _rate(self, request: StreamRequest) -> float:
        """The rate of a delta-sigma converter among the cards, which is the clock of all."""
        rate_hz = request.rate_hz
        used = {self._card_of[c].device for c in request.channels if c in self._card_of}
        products = [self._products[device] for device in sorted(used)]
        own = max((p.sample_rate(rate_hz) for p in products if p.delta_sigma), default=rate_hz)
        for device in sorted(used):
            if own < self._products[device].ai_rate_least_hz * (1 - 1e-3):
                raise refused(device, _TOO_SLOW, f"{rate_hz:g} Hz is below what it has.")
        own = self._shared(request, own)
        if not abs(own / rate_hz - 1) <= (_PLAYED if request.play else 1.0):
            raise other_rate(" and ".join(sorted(used)), own, rate_hz)
        return own

    def _shared(self, request: StreamRequest, own: float) -> float:
        """The rate of the master's clock, which is not `own` of a delta-sigma converter on another card.

        Raises ConfigurationError, as the driver does, where that converter has not the master's rate.
        """
        homes: dict[str, list[Product]] = {}
        for channel in request.channels:
            card = self._card_of.get(channel)  # an unknown one is refused later
            if card is not None and channel not in card.counters:
                homes.setdefault(_home(card.device), []).append(self._products[card.device])
        playing = next((_home(self._home_of[n].device) for n in request.play if n in self._home_of), "")
        if not homes:
            return own
        master = playing if playing in homes else next(iter(homes))
        if any(product.delta_sigma for product in homes[master]):
            return own
        timebase, asked = homes[master][0].clock_hz, request.rate_hz
        rate_hz = timebase / max(1, round(timebase / asked))
        for home, products in homes.items():
            for product in products:
                if product.delta_sigma and not abs(product.sample_rate(rate_hz) / rate_hz - 1) <= _SAME:
                    rates = shared_rates(timebase, product.ai_rate_hz, asked)
                    raise unshared(home, product.sample_rate(rate_hz), master, rate_hz, rates)
        return own

    def _lost(self, card: Card, lost: SamplesLost) -> HaploopError:
        return refused(card.device, LOST[lost.how], str(lost))

    def _ended(self, card: Card, stopped: PlayStopped, played: int) -> HaploopError:
        if stopped.how in STOPPED:
            return refused(card.device, STOPPED[stopped.how], "")
        return cut_off(card.device, played)

    def _zeroed(self, cards: Sequence[Card]) -> HaploopError:
        return zeroed(" and ".join(card.device for card in cards))

    def _refuse(self, request: StreamRequest) -> None:
        super()._refuse(request)
        if all(channel in self._card_of[channel].counters for channel in request.channels):
            raise unclocked(request.channels)
        for name in request.play:
            card = self._home_of[name]
            most = self._products[card.device].ao_rate_hz
            if request.rate_hz > most * (1 + 1e-9):
                raise refused(card.device, _TOO_FAST if most else _UNSUPPORTED, (
                    f"Its outputs take {most:g} values per second, not {request.rate_hz:g}."
                    if most
                    else f"The outputs of a {card.name} have no sample clock."
                ))  # fmt: skip
        used = {self._card_of[channel].device for channel in request.channels}
        if len(used) > 1 and not self._plant.has_rtsi():
            first = next(device for device in self._products if device in used)
            raise refused(first, _NO_CABLE, "")


def _home(device: str) -> str:
    """Device whose clock a card uses: of a module its chassis."""
    return re.sub(r"Mod\d+$", "", device)


def _card(device: str, product: Product, settings: NiDaq.Settings) -> Card:
    """Describe a card with the rig file's names of its terminals."""
    return Card(
        name=product.name,
        device=device,
        channels={n: c.range for n, c in settings.channels.items() if device_of(c.terminal) == device},
        outputs={n: o.range for n, o in settings.outputs.items() if device_of(o.terminal) == device},
        ai_rate_hz=product.ai_rate_hz,
        ai_rate_single_hz=product.ai_rate_single_hz,
        ai_simultaneous=product.ai_simultaneous,
        ai_bits=product.ai_bits,
        ai_noise=product.ai_noise,
        ao_bits=product.ao_bits,
        ao_range=product.ao_range,
        ao_unipolar=product.ao_unipolar,
        counters=tuple(n for n, c in settings.channels.items() if c.counter),
    )


def _product(device: str, name: str, known: Mapping[str, Product]) -> Product:
    if name not in known:
        raise ConfigurationError(
            f"There is no twin of {name!r} ({device}): describe it in [daq.products]; "
            + did_you_mean(name, known, "there are")
        )
    return known[name]


def _refuse_terminals(settings: NiDaq.Settings, products: Mapping[str, Product]) -> None:
    """Raise the driver's error for a terminal, or a use of one, that its product has not."""
    for name, channel in settings.channels.items():
        device = device_of(channel.terminal)
        product = products.get(device)
        fault = _unfit(product, channel) if product is not None else None
        if fault is not None:
            raise refused(device, _UNSUPPORTED, f"{name}: {fault}")
    for name, output in settings.outputs.items():
        device = device_of(output.terminal)
        product = products.get(device)
        number = re.fullmatch(r"ao(\d+)", output.terminal.partition("/")[2].lower())
        if product is not None and (number is None or int(number[1]) >= product.ao_channels):
            raise refused(device, -200170, f"{name}: a {product.name} has {product.ao_channels} outputs.")


def _unfit(product: Product, channel: Channel) -> str | None:
    """Say why a channel of a rig file does not fit the product, in a sentence; None when it fits."""
    tail = channel.terminal.partition("/")[2].lower()
    if channel.counter is not None:
        number = int("".join(c for c in tail if c.isdecimal()))
        return None if number < product.counters else f"a {product.name} has {product.counters} counters."
    count = max(product.ai_single_ended, product.ai_differential)
    names = list(product.ai_names) or [f"ai{i}" for i in range(count)]
    if tail not in names:
        own = f"inputs {names[0]} to {names[-1]}" if names else "no inputs"
        return f"a {product.name} has {own}, no {tail}."
    number = int(tail.removeprefix("ai")) if tail.startswith("ai") else 0
    has: dict[str, tuple[object, tuple[object, ...]]] = {
        "configuration": (channel.config, ("default", *product.configurations(number))),
        "coupling": (channel.coupling, (None, *product.ai_couplings)),
        # What a sensor requires (AI.Excit.Val), which need not be what is supplied (AI.Excit.ActualVal):
        # MathWorks, "Acquire IEPE Data", asks an NI 9234, of 2 mA, for 4 mA.
        "excitation (A)": (None if product.ai_excitation else channel.excitation, (None,)),
        "bridge excitation (V)": (
            channel.bridge and channel.bridge_excitation, (None, *product.ai_bridge_excitation)
        ),
    }  # fmt: skip
    for what, (asked, taken) in has.items():
        if asked not in taken:
            listed = ", ".join(str(value) for value in taken if value is not None) or "none"
            return f"{tail} of a {product.name} has the {what} {listed}, not {asked}."
    if channel.bridge is None and product.ai_measures and "VOLTAGE" not in product.ai_measures:
        return f"a {product.name} does not measure volts: say what its inputs supply (bridge)."
    return None


# NI wire of a rig: its cards, with their terminals connected as in the rig file.


@contextmanager
def wire(settings: NiDaq.Settings, plant: Plant) -> Iterator[dict[str, Any]]:
    """Serve the cards of `settings` on `plant`; yield the setting that points the driver at them.

    Channels and outputs are nodes of the plant with the same names.
    """
    from ...nidaqmx_twin import NiServer, inventory_of  # noqa: PLC0415  gRPC, which no twin needs

    for name, channel in settings.channels.items():
        plant.sample_by(name, device_of(channel.terminal))
    inventory = inventory_of(settings.devices, described(settings.products))
    wiring, rtsi = wiring_of(settings), plant.has_rtsi()
    with NiServer(inventory, plant, wiring, rtsi=rtsi, seed=plant.settings.seed) as server:
        yield {"server": server.address}


def wiring_of(settings: NiDaq.Settings) -> dict[str, str]:
    """Return the plant's node for each terminal of the cards."""
    inputs = {channel.terminal: name for name, channel in settings.channels.items()}
    return inputs | {output.terminal: name for name, output in settings.outputs.items()}
