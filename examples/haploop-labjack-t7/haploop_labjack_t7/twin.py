"""Twin of the T7: haploop's twin of any card, with the T7's figures."""

from __future__ import annotations

from haploop.instruments.daq import StreamRequest
from haploop.mocks.daq import Card, CardTwin
from haploop.mocks.plant import Plant

from .driver import DAC, FASTEST, LabJackT7

NOISE = 0.3e-3
"""Of the inputs at +-10 V and full speed (V rms; estimate: one code of 16 bits)."""


class T7Twin(CardTwin):
    def __init__(self, settings: LabJackT7.Settings, plant: Plant) -> None:
        self._settings = settings
        card = Card(
            name="LabJack T7",
            channels={name: float(channel.range) for name, channel in settings.channels.items()},
            outputs={name: output.highest for name, output in settings.outputs.items()},
            ai_rate_hz=FASTEST,
            ai_noise=NOISE,
            ao_bits=13,  # 12 for each sign
            ao_range=DAC,
        )
        super().__init__(plant, card)

    def _refuse(self, request: StreamRequest) -> None:
        """Refuse what the driver refuses, in its words."""
        self._settings.refuse(request)
