"""Twin of NI's cards: `CardTwin` with NI's products, timing and sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...instruments.arrays import FloatArray
from ...instruments.daq.ni_daqmx import NiDaq
from ...instruments.daq.ni_sentences import cut_off, refused, zeroed
from ...instruments.daq.ni_settings import device_of
from ...instruments.errors import ConfigurationError, HaploopError
from ..plant import Plant, PlayStopped, SamplesLost
from .card_twin import Card, CardTwin
from .converter import LOST, STOPPED
from .products import PRODUCTS, Product, convert_interval, input_range

__all__ = ["DaqTwin"]


_NO_CABLE = -89125
"""NI's error for cards without a trigger line between them."""


class DaqTwin(CardTwin):
    """See `CardTwin`: the cards of a rig file."""

    def __init__(self, settings: NiDaq.Settings, plant: Plant) -> None:
        self._settings = settings
        self._products = {device: _product(device, name) for device, name in settings.devices.items()}
        super().__init__(plant, *(_card(name, p, settings) for name, p in self._products.items()))

    def _range(self, card: Card, channel: str) -> float:
        """Return the card's next wider range (+- V), as the driver chooses it."""
        product, wanted = self._products[card.device], card.channels[channel]
        full_scale = input_range(product, wanted)
        if full_scale is None:
            raise ConfigurationError(
                f"The channel {channel!r} asks for +-{wanted:g} V, and the widest range of a {product.name} "
                f"is +-{max(product.ai_ranges, default=0):g} V."
            )
        return full_scale

    def _delays(self, card: Card, rate_hz: float, count: int) -> FloatArray:
        interval = convert_interval(self._products[card.device], rate_hz, count)
        return np.arange(count, dtype=np.float64) * interval

    def _lost(self, card: Card, lost: SamplesLost) -> HaploopError:
        return refused(card.device, LOST[lost.how], str(lost))

    def _ended(self, card: Card, stopped: PlayStopped, played: int) -> HaploopError:
        if stopped.how in STOPPED:
            return refused(card.device, STOPPED[stopped.how], "")
        return cut_off(card.device, played)

    def _zeroed(self, cards: Sequence[Card]) -> HaploopError:
        return zeroed(" and ".join(card.device for card in cards))

    def _refuse(self, channels: Sequence[str], rate_hz: float, play: Mapping[str, FloatArray]) -> None:
        super()._refuse(channels, rate_hz, play)
        used = {self._card_of[channel].device for channel in channels}
        if len(used) > 1 and not self._plant.has_rtsi():
            first = next(device for device in self._products if device in used)
            raise refused(first, _NO_CABLE, "")


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
    )


def _product(device: str, name: str) -> Product:
    if name not in PRODUCTS:
        raise ConfigurationError(
            f"There is no twin of {name!r} ({device}); there are {', '.join(sorted(PRODUCTS))}."
        )
    return PRODUCTS[name]
