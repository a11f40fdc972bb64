"""Tests of the RB-8 with haploop's conformance suite and pytest plugin only."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from haploop_acme.relay import AcmeRelay
from haploop_acme.twin import reply, twin

from haploop.base.clock import Clock, VirtualClock
from haploop.base.errors import InstrumentError
from haploop.instruments import Relay, Rig, load_rig_file
from haploop.instruments.conformance import Fired, RelayConformance
from haploop.mocks.plant import Plant
from haploop.mocks.relay import box_in
from haploop.mocks.transport import DirectLine, LineServer, ReplyFault

RIG = load_rig_file(Path(__file__).parents[1] / "acme.toml")
SETTINGS = AcmeRelay.Settings(port="", patches={"A": 1, "B": 2, "C": 3, "D": 4}, rating=60, timeout=0.2)


class OnAPlant(RelayConformance):
    plant: Plant

    def contacts(self) -> Collection[str]:
        return self.plant.truth.closed

    def clock(self) -> Clock:
        return self.plant.clock


class TestTwin(OnAPlant):
    capabilities = ("contacts",)

    @pytest.fixture
    def relay(self) -> Relay:
        self.plant = Plant(RIG, VirtualClock())
        return twin(SETTINGS, self.plant)


class TestDriver(OnAPlant):
    """The real driver, through a socket with faults."""

    capabilities = ("contacts", "reopen")
    faults = ("silence", "garbled", "truncated", "disconnect", "terminator")
    deadline = 3.0

    @pytest.fixture
    def relay(self) -> Iterator[Relay]:
        self.plant = Plant(RIG, VirtualClock())
        box = box_in(self.plant, SETTINGS.patches)
        with LineServer(lambda line: reply(box, line)) as self.server:
            relay = self.reopen()
            yield relay
            relay.close()

    def reopen(self) -> Relay:
        settings = SETTINGS.model_copy(update={"port": f"socket://{self.server.address}"})
        return AcmeRelay.open(settings, self.plant.clock)

    @contextmanager
    def fault(self, kind: str) -> Iterator[Fired]:
        fault = ReplyFault(kind)  # type: ignore[arg-type]
        self.server.faults.append(fault)
        yield fault
        self.server.faults.remove(fault)


@pytest.mark.parametrize("answer", ["8 relays", "1 2 3", "0 0 0 0 0 0 0 x", "0 0 0 0 0 0 0 -1"])
def test_no_answer_is_taken_for_a_state_that_is_none(answer: str) -> None:
    line = DirectLine(lambda asked: ["ACME RB-8 1.4" if asked == "ID" else answer])
    with pytest.raises(InstrumentError, match="'READ'"):
        AcmeRelay(SETTINGS, VirtualClock(), line).connected()


def test_another_product_is_refused() -> None:
    with pytest.raises(InstrumentError, match="OFV-5000"):
        AcmeRelay(SETTINGS, VirtualClock(), DirectLine(lambda _asked: ["OFV-5000"]))


@pytest.mark.requires("table", "drive")
def test_a_drive_reaches_the_patch_on_any_rig(rig: Rig) -> None:
    """The same test on the twin, through the wire, and on the hardware."""
    t = np.arange(10_000) / rig.table.rate_hz
    drive = 20 * np.sin(2 * np.pi * 200 * t) * np.hanning(len(t))
    capture = rig.excite(drive, ["A"], ["drive"])
    assert np.abs(capture.volts[0] * 100).max() == pytest.approx(20, rel=0.05)
    assert rig.relay.connected() == frozenset()


@pytest.mark.requires("simulation")
def test_only_that_patch_is_connected(rig: Rig) -> None:
    rig.relay.connect(["C"])
    assert rig.simulation is not None
    assert rig.simulation.truth.closed == {"C"}
