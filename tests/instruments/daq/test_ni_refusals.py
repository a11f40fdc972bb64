"""What the NI driver refuses, and the sentence in which it does: cards, servers, channels and requests."""

import re
import signal
from collections.abc import Callable
from typing import Any

import grpc
import nidaqmx
import numpy as np
import pytest

from haploop.base.clock import RealClock
from haploop.base.errors import ConfigurationError, InstrumentError, LimitError
from haploop.instruments import open_rig
from haploop.instruments.conformance import bypass_interlock
from haploop.instruments.daq.ni_daqmx import NiDaq
from haploop.nidaqmx_twin import NiServer, inventory_of
from tests.instruments.daq.conftest import CARDS, WIRING, opened, settings
from tests.nidaqmx_twin.ni_client import Bench, connected
from tests.raising import raises, raising


def test_cards_without_a_cable(bench):
    with NiServer(inventory_of(CARDS), bench, WIRING) as server, opened(server, bench) as daq:
        with pytest.raises(InstrumentError, match="connect a RTSI cable, and declare it"):
            daq.stream(["laser", "force"], 5000, 100)
        # Nothing stays reserved.
        with daq.stream(["force"], 5000, 100, 200) as stream:
            stream.capture()


def test_card_in_use(server, daq):
    with connected(server) as options, nidaqmx.Task(grpc_options=options) as task:
        task.ai_channels.add_ai_voltage_chan("Dev2/ai7")
        task.timing.cfg_samp_clk_timing(1000)
        task.start()
        raises(InstrumentError, "Dev2 is in use by another program", daq.stream, ["laser"], 5000, 100)


def test_server_that_dies(bench):
    server = NiServer(inventory_of(CARDS), bench, WIRING, rtsi=True)
    daq = NiDaq.open(settings(server=server.address), bench.clock)
    bypass_interlock(daq)
    stream = daq.stream(["laser", "force"], 5000, 100, None, {"amplifier": np.ones(1000)})
    blocks = iter(stream)
    next(blocks)
    server.close()
    raises(InstrumentError, r"NI device server at .* failed while Dev2 was used", next, blocks)
    raises(InstrumentError, "", stream.close)
    raises(InstrumentError, "", daq.zero)
    daq.close()
    daq.close()


def test_ctrl_c_comes_after_a_call_and_within_a_slice_of_connecting(monkeypatch):
    """Within a call of grpc it left a lock locked, for which the safe state then waited in vain."""
    whole: list[str] = []

    def stopped(outcome: Exception | None = None) -> Callable[..., Any]:
        def call(*_: object, **__: object) -> None:
            signal.raise_signal(signal.SIGINT)
            whole.append("whole")
            if outcome is not None:
                raise outcome

        return call

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with NiServer(inventory_of(CARDS), Bench(), WIRING) as server:
            address = settings(server=server.address)
            with monkeypatch.context() as patch:
                patch.setattr("grpc._channel._UnaryUnaryMultiCallable.with_call", stopped())
                raises(KeyboardInterrupt, "", NiDaq.open, address, RealClock())
            with monkeypatch.context() as patch:
                patch.setattr(
                    "grpc._utilities._ChannelReadyFuture.result", stopped(grpc.FutureTimeoutError())
                )
                raises(KeyboardInterrupt, "", NiDaq.open, address, RealClock())
        assert whole == 2 * ["whole"]
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_connection_for_which_no_thread_can_be_started(monkeypatch):
    monkeypatch.setattr(grpc, "channel_ready_future", raising(RuntimeError("can't start new thread")))
    raises(RuntimeError, "can't start new thread", NiDaq.open, settings(server="127.0.0.1:9"), RealClock())


def channel(terminal: str, range: float = 10, config: str = "rse") -> dict[str, Any]:
    return {"channels": {"a": {"terminal": terminal, "range": range, "config": config}}}


@pytest.mark.parametrize(("changes", "request_", "says"), [
    (channel("Dev2/ai77"), lambda d: d.stream(["a"], 5000, 100), "Dev2 does not have a terminal"),
    (channel("Dev2/ai0", range=11), lambda d: d.stream(["a"], 5000, 100), "no range of .-11 V"),
    (channel("Dev2/ai9", config="diff"), lambda d: d.stream(["a"], 5000, 100), "configuration DIFF"),
    ({}, lambda d: d.stream(["laser", "laser"], 5000, 100), "each channel once"),
    ({}, lambda d: d.stream(["laser"], 1e6, 100), "cannot sample that fast"),
    ({}, lambda d: d.stream(["laser"], 5e3, 9, 9, {"x": np.ones(9)}), "no channel 'x'"),
    ({}, lambda d: d.stream(["laser"], 5e3, 9, 9, {"amplifier": np.full(9, 9.0)}), "reaches 9 V"),
])  # fmt: skip
def test_what_no_card_can_do_is_one_sentence(server, bench, changes, request_, says):
    with opened(server, bench, **changes) as daq, pytest.raises((ConfigurationError, LimitError), match=says):
        request_(daq)


TWO_CARDS = """
name = "two"
rate_hz = {rate}
[daq]
driver = "ni-daqmx"
devices = {{ cDAQ1Mod1 = "NI 9234", Dev1 = "{card}" }}
[daq.channels]
force = {{ terminal = "Dev1/ai0", range = 5 }}
acceleration = {{ terminal = "cDAQ1Mod1/ai1", range = 5 }}
"""


@pytest.mark.parametrize("simulate", ["twin", "wire"])
@pytest.mark.parametrize(("card", "rate", "order", "says"), [
    ("PCIe-6321", 5120, ("force", "acceleration"), "choose a rate that both cards have: 6400, 3200, 1600."),
    ("PCI-6221", 5120, ("force", "acceleration"), ""),  # 80 MHz over 15625
    ("PCIe-6321", 6400, ("force", "acceleration"), ""),
    ("PCIe-6321", 5120, ("acceleration", "force"), ""),  # the converter's clock is the other card's too
])  # fmt: skip
def test_two_cards_have_one_rate_or_a_sentence_with_theirs(card, rate, order, says, simulate, tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(TWO_CARDS.format(card=card, rate=rate), encoding="utf-8")
    with open_rig(path, simulate=simulate) as rig:
        if not says:
            with rig.daq.stream(order, rate, 100, 200) as stream:
                assert stream.rate_hz == pytest.approx(rate, rel=1e-6)
            return
        raises(ConfigurationError, re.escape(says), rig.daq.stream, order, rate, 100, 200)
