"""Our own instruments run the suites that we ship; and the suites notice drivers that break promises."""

import io
import re
import subprocess
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from types import SimpleNamespace
from typing import Any, ClassVar

import pytest
from nidaqmx.error_codes import DAQmxErrors

from haploop.base.clock import Clock, VirtualClock
from haploop.instruments import Amplifier, Daq, Operator, Relay, Vibrometer, conformance, load_rig_file
from haploop.instruments.amplifier.analog import AnalogAmplifier
from haploop.instruments.amplifier.e413 import E413
from haploop.instruments.conformance import Fired
from haploop.instruments.daq.ni_daqmx import NiDaq
from haploop.instruments.generator import Arbitrary, Generator
from haploop.instruments.generator.scpi_generator import Dg1000z, Keysight33500, ScpiGenerator
from haploop.instruments.operator.console import Console
from haploop.instruments.relay.serial_relay import SerialRelay
from haploop.instruments.relay.yocto import Yocto
from haploop.instruments.vibrometer.analog import AnalogVibrometer
from haploop.instruments.vibrometer.ofv5000 import Ofv5000
from haploop.instruments.vibrometer.pdv100 import Pdv100
from haploop.mocks.daq.twin import DaqTwin
from haploop.mocks.generator import DG1000Z, KEYSIGHT_33500, Box, Product
from haploop.mocks.people import OperatorTwin
from haploop.mocks.plant import Faults, LaserHead, Plant
from haploop.mocks.relay import BoxFault, RelayTwin, SimulatedBox, box_in
from haploop.mocks.relay.serial_relay import SerialRelayTwin, SerialRelayWire
from haploop.mocks.relay.yocto_hub import YoctoHub
from haploop.mocks.transport import DirectLine, LineServer, ReplyFault
from haploop.mocks.vibrometer import Controller
from haploop.nidaqmx_twin import NiServer, inventory_of
from tests.instruments import broken_drivers
from tests.instruments.player.on_a_sound_card import OnASoundCard
from tests.instruments.relay.contacts import Contacts
from tests.nidaqmx_twin import ni_client
from tests.rig_files import changed

BOX_FAULTS = ("lost", "stuck")
LINE_FAULTS = ("silence", "drip", "garbled", "truncated", "disconnect")
TIMEOUT = 0.2


@contextmanager
def put(fault: Any, faults: list[Any]) -> Iterator[Fired]:
    faults.append(fault)
    try:
        yield fault
    finally:
        faults.remove(fault)


# Relays


class BoxConformance(conformance.RelayConformance):
    """A box whose contacts can be looked at, on a plant that is nothing but contacts."""

    capabilities: ClassVar[tuple[str, ...]] = ("reopen", "contacts")
    faults: ClassVar[tuple[str, ...]] = BOX_FAULTS
    patches: ClassVar[dict[str, int]]
    bench: Contacts
    box: SimulatedBox
    far: Any = None
    """The hub or board at the other end of the line, if there is a line."""

    def contacts(self) -> Collection[str]:
        return self.bench.closed()

    def clock(self) -> Clock:
        return self.bench.clock

    def fault(self, kind: str) -> AbstractContextManager[Fired]:
        if kind in BOX_FAULTS:
            return put(BoxFault(kind, channel=self.patches["B"]), self.box.faults)
        return put(ReplyFault(kind, delay=0.15), self.far.faults)


class OverALine(BoxConformance):
    faults = BOX_FAULTS + LINE_FAULTS
    deadline = 3.0

    @pytest.fixture
    def relay(self) -> Iterator[Relay]:
        self.bench = Contacts(self.patches)
        self.box = box_in(self.bench, self.patches, range(9))
        with ExitStack() as self.opened, self.serve() as self.far:
            yield self.reopen()
            # Let go of the box before it goes.
            self.opened.close()

    def serve(self) -> AbstractContextManager[Any]:
        raise NotImplementedError

    def connected(self) -> Relay:
        raise NotImplementedError

    def reopen(self) -> Relay:
        relay = self.connected()
        self.opened.callback(relay.close)
        return relay


class TestYocto(OverALine):
    patches: ClassVar = {"A": 1, "B": 2, "D": 8}
    faults = (*OverALine.faults, "not found", "password")

    def serve(self) -> YoctoHub:
        return YoctoHub(self.box)

    def connected(self) -> Relay:
        return Yocto.open(yocto(self.patches, hub=self.far.url), self.bench.clock)


class Twin(BoxConformance):
    capabilities = ("contacts",)
    made: ClassVar[Callable[..., Any]]

    @pytest.fixture
    def relay(self) -> Relay:
        self.bench = Contacts(self.patches)
        twin: Any = type(self).made(self.patches, self.bench)
        self.box = twin.box
        return twin


class TestYoctoTwin(Twin):
    patches: ClassVar = {"A": 1, "B": 2, "D": 8}
    made = staticmethod(lambda patches, bench: RelayTwin(yocto(patches), bench))


class TestSerialRelay(OverALine):
    patches: ClassVar = {"A": 0, "B": 1, "D": 7}
    faults = (*OverALine.faults, "terminator")

    def serve(self) -> SerialRelayWire:
        return SerialRelayWire(self.box)

    def connected(self) -> Relay:
        return SerialRelay.open(board(self.patches, port=self.far.url), self.bench.clock)


class TestSerialRelayTwin(Twin):
    patches: ClassVar = {"A": 0, "B": 1, "D": 7}
    made = staticmethod(lambda patches, bench: SerialRelayTwin(board(patches), bench))


def yocto(patches: dict[str, int], **more: object) -> Yocto.Settings:
    # A thread of its own answers each request: on a busy machine that may wait.
    return Yocto.Settings.model_validate({"patches": patches, "timeout": 5 * TIMEOUT, **more})


def board(patches: dict[str, int], **more: object) -> SerialRelay.Settings:
    return SerialRelay.Settings.model_validate(
        {"patches": patches, "rating": 60, "port": "COM5", "timeout": TIMEOUT, **more}
    )


# DAQs

SIMULATED = load_rig_file("simulated")
CARDS = {"Dev1": "PCI-6034E", "Dev2": "PCIe-6321"}


class CardsConformance(conformance.DaqConformance):
    """Two cards on one clock; an output of the second is wired to an input of it."""

    channels = ("laser", "force", "drive")
    outputs = ("amplifier",)
    loop = ("amplifier", "drive")
    output_range = 8.0
    rate_hz = 5000.0


class TestNiDaq(CardsConformance):
    capabilities = ("outputs", "loop", "reopen")
    faults = (
        *(f"SAMPLES_{which}_AVAILABLE" for which in ("NO_LONGER", "NOT_YET")),
        "INPUT_FIFO_OVERFLOW",
        "server gone",
    )

    @pytest.fixture
    def daq(self) -> Iterator[Daq]:
        self.bench = ni_client.Bench()
        wiring = {"Dev1/ai0": "tone", "Dev2/ai0": "tone", "Dev2/ai1": "loop", "Dev2/ao0": "out"}
        with (
            NiServer(inventory_of(CARDS), self.bench, wiring, rtsi=True) as self.server,
            ExitStack() as self.opened,
        ):
            yield self.reopen()

    def reopen(self) -> Daq:
        daq = NiDaq.open(cards(server=self.server.address), self.bench.clock)
        self.opened.callback(daq.close)
        return daq

    @contextmanager
    def fault(self, kind: str) -> Iterator[Fired]:
        # The server does not say whether it has answered so: without, nothing would be refused.
        if kind == "server gone":
            self.server.close()
        else:
            self.server.inject("Dev2", DAQmxErrors[kind])
        yield SimpleNamespace(fired=1)


class TestDaqTwin(CardsConformance):
    """On the whole plant: amplifier, patch A and the divider lie between output and input."""

    capabilities = ("outputs", "loop")
    loop_gain = 0.5
    """50 of the amplifier through 1:100 of the divider."""

    faults = ("daq-overrun", "daq-overflow", "rtsi-missing")

    @pytest.fixture
    def daq(self) -> Daq:
        self.plant = Plant(SIMULATED, VirtualClock())
        self.plant.switch("A", True, 0.0)
        return DaqTwin(cards(), self.plant)

    @contextmanager
    def fault(self, kind: str) -> Iterator[Fired]:
        self.plant.faults = Faults.of_file(changed(SIMULATED, simulation={"faults": ({"kind": kind},)}))
        yield self.plant.faults[0]


def cards(**more: object) -> NiDaq.Settings:
    channels = {
        "force": {"terminal": "Dev1/ai0", "range": 10, "config": "diff"},
        "laser": {"terminal": "Dev2/ai0", "range": 5, "config": "rse"},
        "drive": {"terminal": "Dev2/ai1", "range": 10, "config": "rse"},
    }
    outputs = {"amplifier": {"terminal": "Dev2/ao0", "range": 8}}
    return NiDaq.Settings.model_validate({"devices": CARDS, "channels": channels, "outputs": outputs} | more)


# Vibrometers


class TestAnalogVibrometer(conformance.VibrometerConformance):
    SHOWS: ClassVar = {
        "velocity": {"scale": 0.005, "range": 0.02, "delay": 1e-3},
        "displacement": {"scale": 5e-6, "range": 2e-5, "delay": 1e-4},
        "acceleration": {"scale": 98, "range": 490, "mass": 0.002, "high_pass_hz": 0.5},
        "gravity": {"quantity": "acceleration", "scale": 30, "range": 35, "mass": 0.002, "zero": 1.98},
    }

    @pytest.fixture(params=list(SHOWS))
    def vibrometer(self, request: pytest.FixtureRequest) -> Vibrometer:
        named = {"name": "a head", "source": "its data sheet", "channel": "laser", "bandwidth_hz": 10e3}
        settings = named | {"quantity": request.param} | self.SHOWS[request.param]
        return AnalogVibrometer.open(AnalogVibrometer.Settings.model_validate(settings), VirtualClock())


class TestPdv100(conformance.VibrometerConformance):
    @pytest.fixture(params=[(0.02, 1000), (0.5, 22000)], ids=str)
    def vibrometer(self, request: pytest.FixtureRequest) -> Vibrometer:
        full_scale, low_pass_hz = request.param
        settings = Pdv100.Settings(channel="laser", range=full_scale, low_pass_hz=low_pass_hz)
        return Pdv100.open(settings, VirtualClock())


class TestOfv5000(conformance.VibrometerConformance):
    capabilities = ("reopen", "level")
    faults = (*LINE_FAULTS, "terminator")
    deadline = 3.0

    @pytest.fixture
    def vibrometer(self) -> Iterator[Vibrometer]:
        with LineServer(controller().answer) as self.server, ExitStack() as self.opened:
            yield self.reopen()
            self.opened.close()

    def reopen(self) -> Vibrometer:
        laser = Ofv5000.open(ofv(port=f"socket://{self.server.address}"), VirtualClock())
        self.opened.callback(laser.close)
        return laser

    def fault(self, kind: str) -> AbstractContextManager[Fired]:
        return put(ReplyFault(kind, delay=0.15), self.server.faults)


class TestOfv5000Twin(conformance.VibrometerConformance):
    capabilities = ("reopen", "level")

    @pytest.fixture
    def vibrometer(self) -> Vibrometer:
        self.controller = controller()
        return self.reopen()

    def reopen(self) -> Vibrometer:
        return Ofv5000(ofv(), VirtualClock(), DirectLine(self.controller.answer))


def controller() -> Controller:
    return Controller(LaserHead(0.05, 0.005, 20e3, 12.3e-6), "VeloDec,0", 10.0, VirtualClock())


def ofv(**more: object) -> Ofv5000.Settings:
    return Ofv5000.Settings.model_validate(
        {"port": "COM3", "channel": "laser", "scale": 0.005, "timeout": TIMEOUT, **more}
    )


# Generators


class FamilyConformance(conformance.GeneratorConformance):
    capabilities = ("reopen",)
    faults = LINE_FAULTS
    deadline = 5.0
    driver: type[ScpiGenerator]
    product: Product

    @pytest.fixture
    def generator(self) -> Iterator[Generator]:
        nothing = {"drive": lambda node, source: None, "advance": lambda until: None}
        self.bench: Any = SimpleNamespace(clock=VirtualClock(), **nothing)
        box = Box(self.product, self.bench, "amplifier")
        with LineServer(box.answer) as self.server, ExitStack() as self.opened:
            yield self.reopen()
            self.opened.close()

    def reopen(self) -> Generator:
        resource = f"TCPIP::127.0.0.1::{self.server.port}::SOCKET"
        basic = {"output": "amplifier", "timeout": TIMEOUT, "visa": "@py"}
        settings = self.driver.Settings.model_validate({"resource": resource, **basic})
        generator = self.driver.open(settings, self.bench.clock)
        self.opened.callback(generator.close)
        return generator

    def fault(self, kind: str) -> AbstractContextManager[Fired]:
        return put(ReplyFault(kind, delay=0.15), self.server.faults)


class TestKeysight33500(FamilyConformance):
    waveforms = (*FamilyConformance.waveforms, Arbitrary([0, 0.1, 0.3, 0, -0.3, -0.2, -0.1, 0], 5000))
    driver = Keysight33500
    product = KEYSIGHT_33500


class TestDg1000z(FamilyConformance):
    driver = Dg1000z
    product = DG1000Z


# Players


class TestSoundCardTwin(OnASoundCard):
    """The real driver's class, through the twin of the library that it plays with."""


# Amplifier and operators


class TestAnalogAmplifier(conformance.AmplifierConformance):
    @pytest.fixture(params=[False, True])
    def amplifier(self, request: pytest.FixtureRequest) -> Amplifier:
        figures = {"gain": 20, "min": -30, "max": 150, "current_peak": 0.3, "current_average": 0.235}
        named = {"name": "PDu150CL", "source": "its data sheet", "input": "amplifier"}
        settings = AnalogAmplifier.Settings(**named, **figures, slew=38e6, inverting=request.param)
        return AnalogAmplifier.open(settings, VirtualClock())


class TestE413(conformance.AmplifierConformance):
    @pytest.fixture
    def amplifier(self) -> Amplifier:
        return E413.open(E413.Settings(input="amplifier"), VirtualClock())


class TestConsole(conformance.OperatorConformance):
    @pytest.fixture
    def operator(self, monkeypatch: pytest.MonkeyPatch) -> Operator:
        monkeypatch.setattr("sys.stdin", io.StringIO("yes\n" * 10))
        return Console()


class TestOperatorTwin(conformance.OperatorConformance):
    @pytest.fixture
    def operator(self) -> Operator:
        clock = VirtualClock()
        return OperatorTwin(Console.Settings(), Plant(SIMULATED, clock))


# And the suites themselves


@pytest.fixture(scope="module")
def verdicts() -> dict[str, set[str]]:
    """The tests that each broken driver has failed, from one run over all of them."""
    command = [sys.executable, "-m", "pytest", "-n", "0", "-rfE", "--tb=no", "-p", "no:cacheprovider"]
    run = subprocess.run([*command, broken_drivers.__file__], capture_output=True, text=True, check=False)
    assert run.returncode == pytest.ExitCode.TESTS_FAILED, run.stdout + run.stderr
    failed: dict[str, set[str]] = {name: set() for name in broken_drivers.broken()}
    for kind, test in re.findall(r"^(?:FAILED|ERROR) \S*::(\w+)::(\w+)", run.stdout, re.MULTILINE):
        failed[kind].add(test)
    return failed


@pytest.mark.parametrize("name", broken_drivers.broken())
def test_a_broken_driver_fails_exactly_what_it_breaks(name, verdicts):
    assert verdicts[name] == broken_drivers.broken()[name]
