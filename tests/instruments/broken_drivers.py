"""Drivers that each break one promise; `breaks` names the tests that must notice, and no other may.

Not collected with the suite: test_conformance.py runs this file as a test run of its own.
"""

import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from haploop.base.arrays import ComplexArray, FloatArray
from haploop.base.clock import Clock, VirtualClock
from haploop.base.errors import InstrumentError, LimitError
from haploop.instruments import (
    Amplifier,
    Block,
    Daq,
    Operator,
    Relay,
    Stream,
    Vibrometer,
    conformance,
    load_rig_file,
)
from haploop.instruments.amplifier.e413 import E413
from haploop.instruments.conformance import Fired
from haploop.instruments.daq import StreamRequest
from haploop.instruments.daq.ni_daqmx import NiDaq
from haploop.instruments.generator.role import Generator
from haploop.instruments.generator.scpi_generator import Keysight33500
from haploop.instruments.operator.console import Console
from haploop.instruments.operator.role import Request
from haploop.instruments.player.sound_card import SoundCard
from haploop.instruments.relay.yocto import Yocto
from haploop.instruments.vibrometer.pdv100 import Pdv100
from haploop.mocks.daq.twin import DaqTwin
from haploop.mocks.generator import KEYSIGHT_33500, Box
from haploop.mocks.people import OperatorTwin
from haploop.mocks.plant import Plant
from haploop.mocks.relay import BoxFault, RelayTwin
from haploop.mocks.transport import DirectLine
from tests.instruments.player.on_a_sound_card import OnASoundCard
from tests.instruments.relay.contacts import Contacts

PATCHES = {"A": 1, "B": 2, "D": 8}


def breaks(suite: type[Any], *tests: str) -> Callable[[type[Any]], type[Any]]:
    """Run a suite on a broken driver: exactly these of its tests must fail."""

    def put(driver: type[Any]) -> type[Any]:
        name = f"Test{driver.__name__}"
        globals()[name] = type(name, (suite,), {"kind": driver, "breaks": {f"test_{test}" for test in tests}})
        return driver

    return put


class Board(RelayTwin):
    """A good twin; `again` is what a second connection to its box finds."""

    def __init__(self) -> None:
        self.bench = Contacts(PATCHES)
        super().__init__(Yocto.Settings(patches=PATCHES), self.bench)

    def again(self) -> Relay:
        other = type(self).__new__(type(self))
        other.__dict__.update(self.__dict__, _released=False)
        return other


class BrokenRelay(conformance.RelayConformance):
    capabilities = ("reopen", "contacts")
    faults = ("stuck",)
    deadline = 2.0
    kind: type[Board]
    breaks: ClassVar[set[str]]

    @pytest.fixture
    def relay(self) -> Relay:
        self.board = self.kind()
        return self.board

    def reopen(self) -> Relay:
        return self.board.again()

    def contacts(self) -> Collection[str]:
        return self.board.bench.closed()

    def clock(self) -> Clock:
        return self.board.bench.clock

    @contextmanager
    def fault(self, kind: str) -> Iterator[Fired]:
        fault = BoxFault("stuck", channel=2)
        self.board.box.faults.append(fault)
        yield fault
        self.board.box.faults.clear()


class TestNothingBroken(BrokenRelay):
    kind = Board
    breaks: ClassVar[set[str]] = set()


@breaks(BrokenRelay, "connects_exactly_these_patches", "contacts_have_settled_when_connect_returns")
class LeavesOthersConnected(Board):
    def _connect(self, patches: Collection[str]) -> None:
        super()._connect(patches and {*patches, *self.connected()})


@breaks(
    BrokenRelay,
    "the_dead_man_opens_a_box_that_is_left_alone",
    "close_may_be_called_again",
    "a_fault_is_one_error_in_time",
)
class BelievesItself(Board):
    asked: frozenset[str] = frozenset()

    def _connect(self, patches: Collection[str]) -> None:
        with suppress(InstrumentError):
            super()._connect(patches)
        self.asked = frozenset(patches)

    def connected(self) -> frozenset[str]:
        return self.asked


@breaks(BrokenRelay, "an_unknown_patch_changes_nothing")
class SwitchesBeforeItLooks(Board):
    def _connect(self, patches: Collection[str]) -> None:
        known = [p for p in patches if p in self.patches]
        super()._connect(known)
        super()._connect(patches)


@breaks(BrokenRelay, "an_unknown_patch_changes_nothing")
class RaisesWhatItLikes(Board):
    def _connect(self, patches: Collection[str]) -> None:
        for patch in patches:
            PATCHES[patch]
        super()._connect(patches)


@breaks(BrokenRelay, "close_may_be_called_again", "a_fault_is_one_error_in_time")
class WritesAnEssay(Board):
    def _connect(self, patches: Collection[str]) -> None:
        try:
            super()._connect(patches)
        except InstrumentError as error:
            raise InstrumentError(f"{error}\nTraceback: ...") from None


@breaks(BrokenRelay, "opening_changes_no_channel", "closing_changes_no_channel")
class ResetsWhenOpened(Board):
    def again(self) -> Relay:
        other = super().again()
        other.connect(())
        return other


@breaks(BrokenRelay, "opening_changes_no_channel", "closing_changes_no_channel")
class OpensTheBoxOnClose(Board):
    def close(self) -> None:
        if not self._released:
            self.connect(())
        super().close()


@breaks(BrokenRelay, "close_may_be_called_again")
class ClosesOnce(Board):
    def close(self) -> None:
        self._check_open()
        super().close()


@breaks(BrokenRelay, "the_dead_man_opens_a_box_that_is_left_alone")
class HasNoDeadMan(Board):
    def __init__(self) -> None:
        super().__init__()
        self.box.pulse = lambda channel, length, delay=0.0: self.box.set_state(channel, True)

    def _connect(self, patches: Collection[str]) -> None:
        dead_man, self.dead_man = self.dead_man, np.inf
        super()._connect(patches)
        self.dead_man = dead_man


@breaks(BrokenRelay, "renewing_puts_the_dead_man_off")
class ForgetsToRenew(Board):
    def _renew(self) -> None:
        pass


class TestHangs(BrokenRelay):
    deadline = 0.3

    class kind(Board):  # noqa: N801
        def _connect(self, patches: Collection[str]) -> None:
            if self.box.faults:
                threading.Event().wait()
            super()._connect(patches)

    breaks: ClassVar = {"test_a_fault_is_one_error_in_time"}


class Cards(DaqTwin):
    """A good twin on a plant whose patch A is connected."""

    def __init__(self) -> None:
        plant = Plant(load_rig_file("simulated"), VirtualClock())
        plant.switch("A", True, 0.0)
        at = {"force": ("Dev1/ai0", 10), "laser": ("Dev2/ai0", 5), "drive": ("Dev2/ai1", 10)}
        settings = {
            "devices": {"Dev1": "PCI-6034E", "Dev2": "PCIe-6321"},
            "channels": {name: {"terminal": terminal, "range": v} for name, (terminal, v) in at.items()},
            "outputs": {"amplifier": {"terminal": "Dev2/ao0", "range": 8}},
        }
        super().__init__(NiDaq.Settings.model_validate(settings), plant)


class Changed(Stream):
    """A good stream whose blocks are changed on their way."""

    def __init__(self, stream: Stream, change: Callable[[Iterator[Block]], Iterator[Block]]) -> None:
        self.channels, self.rate_hz = stream.channels, stream.rate_hz
        self.delays, self.full_scale = stream.delays, stream.full_scale
        self._stream, self._change = stream, change

    def __iter__(self) -> Iterator[Block]:
        return self._change(iter(self._stream))

    def close(self) -> None:
        self._stream.close()


class BrokenDaq(conformance.DaqConformance):
    capabilities = ("outputs", "loop")
    channels = ("laser", "force", "drive")
    outputs = ("amplifier",)
    loop = ("amplifier", "drive")
    loop_gain = 0.5
    output_range = 8.0
    kind: type[Daq]
    breaks: ClassVar[set[str]]

    @pytest.fixture
    def daq(self) -> Daq:
        return self.kind()


@breaks(BrokenDaq, "a_finite_stream_delivers_exactly_its_samples")
class LosesABlock(Cards):
    def _stream(self, request: StreamRequest) -> Stream:
        return Changed(super()._stream(request), lambda blocks: (b for b in blocks if b.first != 64))


@breaks(
    BrokenDaq,
    "outputs_that_are_held_play_and_rest",
    "a_finite_stream_delivers_exactly_its_samples",
    "each_stream_counts_from_zero",
    "a_row_is_its_channels",
    "plays_on_the_clock_edge_of_sample_0",
)
class HidesALostBlock(Cards):
    """The index goes on as if nothing had happened: only the count of samples can tell."""

    def _stream(self, request: StreamRequest) -> Stream:
        def change(blocks: Iterator[Block]) -> Iterator[Block]:
            lost = 0
            for number, block in enumerate(blocks):
                if number == 1:
                    lost = block.volts.shape[1]
                else:
                    yield Block(block.first - lost, block.volts, block.overload)

        return Changed(super()._stream(request), change)


@breaks(BrokenDaq, "rows_keep_the_order_asked_for", "a_row_is_its_channels")
class PrefersItsOwnOrder(Cards):
    def _stream(self, request: StreamRequest) -> Stream:
        stream = super()._stream(replace(request, channels=tuple(sorted(request.channels))))
        stream.channels = request.channels
        return stream


@breaks(
    BrokenDaq,
    "outputs_that_are_held_play_and_rest",
    "a_row_is_its_channels",
    "plays_on_the_clock_edge_of_sample_0",
)
class PlaysLate(Cards):
    def _stream(self, request: StreamRequest) -> Stream:
        late = {name: np.concatenate([np.zeros(5), wave]) for name, wave in request.play.items()}
        return super()._stream(replace(request, play=late))


@breaks(BrokenDaq, "a_waveform_that_cannot_be_played_is_refused")
class ClipsInSilence(Cards):
    def _refuse(self, request: StreamRequest) -> None:
        super()._refuse(replace(request, play={name: np.zeros(1) for name in request.play}))


@breaks(BrokenDaq, "a_waveform_that_cannot_be_played_is_refused")
class RefusesTooLate(Cards):
    def _stream(self, request: StreamRequest) -> Stream:
        try:
            return super()._stream(request)
        except LimitError:
            good = {name: np.full(5, 1.0) for name in request.play}
            list(super()._stream(replace(request, play=good)))
            raise


@breaks(
    BrokenDaq,
    "outputs_that_are_held_play_and_rest",
    "an_output_holds_its_last_sample_until_the_stream_is_closed",
    "an_exception_leaves_the_output_at_zero",
    "zero_stops_what_plays",
)
class LeavesTheOutputOn(Cards):
    def zero(self) -> None:
        pass


@breaks(BrokenDaq, "an_unknown_channel_is_refused")
class PassesOverWhatItDoesNotKnow(Cards):
    def _stream(self, request: StreamRequest) -> Stream:
        known = tuple(c for c in request.channels if c in BrokenDaq.channels)
        return super()._stream(replace(request, channels=known))


class BrokenVibrometer(conformance.VibrometerConformance):
    faults = ("unplugged",)
    breaks: ClassVar[set[str]]

    @pytest.fixture
    def vibrometer(self) -> Vibrometer:
        return self.kind(Pdv100.Settings(channel="laser"))

    class kind(Pdv100):  # noqa: N801
        def signal_level(self) -> float | None:
            raise InstrumentError("The laser was lost: check its cable.")

    @contextmanager
    def fault(self, kind: str) -> Iterator[Fired]:
        yield SimpleNamespace(fired=1)


@breaks(BrokenVibrometer, "range_and_scale_belong_together", "signal_level_is_a_share")
class SpeaksMillimetres(BrokenVibrometer.kind):
    def __init__(self, settings: Pdv100.Settings) -> None:
        super().__init__(settings)
        self.scale *= 1000


@breaks(
    BrokenVibrometer,
    "response_is_that_of_its_bandwidth_and_delay",
    "signal_level_is_a_share",
    "a_fault_is_one_error_in_time",
)
class ForgetsItsDelay(Pdv100):
    def response(self, frequencies: FloatArray) -> ComplexArray:
        return np.asarray(np.abs(super().response(frequencies)), dtype=np.complex128)

    def signal_level(self) -> float:
        return 87.0


class TestMultipliesByItsGain(conformance.AmplifierConformance):
    class kind(E413):  # noqa: N801
        def to_input(self, drive: FloatArray) -> FloatArray:
            drive *= 50
            return drive

    breaks: ClassVar = {"test_input_is_the_drive_over_the_gain", "test_input_stays_within_a_dac"}

    @pytest.fixture
    def amplifier(self) -> Amplifier:
        return self.kind(E413.Settings(input="amplifier"))


class TestAnswersInWords(conformance.OperatorConformance):
    class kind(OperatorTwin):  # noqa: N801
        def confirm(self, request: Request) -> bool:
            return "yes"

    breaks: ClassVar = {"test_answers_yes_or_no"}

    @pytest.fixture
    def operator(self) -> Operator:
        return self.kind(Console.Settings(), Plant(load_rig_file("simulated"), VirtualClock()))


class TestIsOnWhenArmed(conformance.GeneratorConformance):
    class kind(Keysight33500):  # noqa: N801
        def arm(self) -> None:
            super().arm()
            self.trigger()

    breaks: ClassVar = {"test_configuring_leaves_the_output_off", "test_plays_only_when_triggered_and_stops"}

    @pytest.fixture
    def generator(self) -> Generator:
        nothing = {"drive": lambda node, source: None, "advance": lambda until: None}
        plant: Any = SimpleNamespace(clock=VirtualClock(), **nothing)
        settings = self.kind.Settings(resource="TCPIP::127.0.0.1::5025::SOCKET", output="amplifier")
        return self.kind(settings, plant.clock, DirectLine(Box(KEYSIGHT_33500, plant, "amplifier").answer))


@breaks(
    OnASoundCard, "a_play_that_is_cut_short_is_an_error", "an_error_of_the_body_counts", "stop_ends_a_play"
)
class PlaysOn(SoundCard):
    def stop(self) -> None:
        self._stream = None


@breaks(OnASoundCard, "what_cannot_be_played_is_refused")
class ClipsWhatIsTooLoud(SoundCard):
    def _samples(self, volts: FloatArray, rate_hz: float) -> FloatArray:
        return super()._samples(np.clip(volts, -0.5, 0.5), rate_hz)


@breaks(
    OnASoundCard, "a_play_that_is_cut_short_is_an_error", "stop_ends_a_play", "a_fault_is_one_error_in_time"
)
class TakesEveryPlayForWhole(SoundCard):
    @contextmanager
    def _play(self, volts: FloatArray, rate_hz: float) -> Iterator[None]:
        with suppress(InstrumentError), super()._play(volts, rate_hz):
            yield


class TestOffersWhatNobodyKnows(TestMultipliesByItsGain):
    capabilities = ("reopne",)
    breaks: ClassVar = {name for name in dir(conformance.AmplifierConformance) if name.startswith("test_")}


class TestAFaultThatNeverStrikes(BrokenVibrometer):
    """The driver is right for another reason than the one that is tested."""

    @contextmanager
    def fault(self, kind: str) -> Iterator[Fired]:
        yield SimpleNamespace(fired=0)

    breaks: ClassVar = {"test_signal_level_is_a_share", "test_a_fault_is_one_error_in_time"}


def broken() -> dict[str, set[str]]:
    """What each class of this file must fail."""
    return {name: kind.breaks for name, kind in globals().items() if name.startswith("Test")}
