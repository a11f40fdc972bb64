"""The player's conformance suite on a simulated sound card."""

from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from haploop.base.clock import Clock, VirtualClock
from haploop.instruments import Player, load_rig_file
from haploop.instruments.conformance import Fired, PlayerConformance
from haploop.instruments.player.sound_card import SoundCard
from haploop.mocks.plant.plant import Plant
from haploop.mocks.player import Card


class OnASoundCard(PlayerConformance):
    """A driver of the sound card, through the twin of the library that it plays with."""

    kind: ClassVar[type[SoundCard]] = SoundCard

    capabilities = ("output", "ac")
    faults = ("underflow", "device gone")

    @pytest.fixture
    def player(self) -> Player:
        self.plant = Plant(load_rig_file("sound-card"), VirtualClock())
        settings = SoundCard.Settings(output="line-out", volts_per_full_scale=1.4)
        self.card = Card(self.plant, settings.output, settings.channel - 1)
        return self.kind(settings, self.plant.clock, self.card)

    def clock(self) -> Clock:
        return SimpleNamespace(sleep=self._pass)

    def playing(self) -> bool:
        # What it is about to put out, the tail that its capacitor leaves aside.
        runs = self.card.jack.take(self.plant.clock.now() + 0.5)
        return any(np.abs(run.values).max() > 1e-2 for run in runs)

    @contextmanager
    def fault(self, kind: str) -> Iterator[Fired]:
        counted = SimpleNamespace(fired=0)
        if kind == "underflow":
            self.card.jack.starves_at = 4800
            yield counted
            counted.fired = int(self.card.jack.starves_at is None)
        else:

            def gone(**_settings: object) -> Any:
                counted.fired += 1
                raise self.card.PortAudioError("Device unavailable [PaErrorCode -9985]")

            self.card.OutputStream = gone
            yield counted

    def _pass(self, duration: float) -> None:
        self.plant.clock.sleep(duration)
        self.plant.advance(self.plant.clock.now())
