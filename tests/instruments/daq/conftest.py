"""Two NI cards on a simulated device server, with a plant of two nodes behind them."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from haploop.instruments.conformance import bypass_interlock
from haploop.instruments.daq.ni_daqmx import NiDaq
from haploop.nidaqmx_twin import NiServer, inventory_of
from tests.nidaqmx_twin.ni_client import Bench

CARDS = {"Dev1": "PCI-6034E", "Dev2": "PCIe-6321"}
TONES, LOOPS = ("Dev1/ai0", "Dev1/ai1", "Dev2/ai0"), ("Dev2/ai1", "Dev2/ai2")
WIRING = dict.fromkeys(TONES, "tone") | dict.fromkeys(LOOPS, "loop") | {"Dev2/ao0": "out"}
LSB = 20 / 2**16
"""Volts per code in a range of +-10 V."""


def settings(**changes: Any) -> NiDaq.Settings:
    channels = {
        "force": {"terminal": "Dev1/ai0", "range": 10, "config": "diff"},
        "torque": {"terminal": "Dev1/ai1", "range": 5, "config": "diff"},
        "laser": {"terminal": "Dev2/ai0", "range": 5, "config": "rse"},
        "drive": {"terminal": "Dev2/ai1", "range": 10, "config": "rse"},
        "echo": {"terminal": "Dev2/ai2", "range": 4, "config": "nrse"},
    }
    outputs = {"amplifier": {"terminal": "Dev2/ao0", "range": 8}}
    return NiDaq.Settings.model_validate(
        {"devices": CARDS, "channels": channels, "outputs": outputs} | changes
    )


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def server(bench: Bench) -> Iterator[NiServer]:
    with NiServer(inventory_of(CARDS), bench, WIRING, rtsi=True) as server:
        yield server


@pytest.fixture
def daq(server: NiServer, bench: Bench) -> Iterator[NiDaq]:
    with opened(server, bench) as daq:
        yield daq


@contextmanager
def opened(server: NiServer, bench: Bench, **changes: Any) -> Iterator[NiDaq]:
    daq = NiDaq.open(settings(server=server.address, **changes), bench.clock)
    bypass_interlock(daq)
    try:
        yield daq
    finally:
        daq.close()


def tone(first: float, rate_hz: float, count: int, delay: float = 0.0) -> Any:
    return 3 * np.sin(2 * np.pi * 10 * (first + np.arange(count) / rate_hz + delay))
