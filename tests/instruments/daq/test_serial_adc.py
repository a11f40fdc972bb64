"""Boards that stream samples: as the only DAQ, along with another one, on twin and wire, with what goes
wrong."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from haploop.base.clock import VirtualClock
from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.base.validation import validate
from haploop.instruments import Daq, RigFile, load_rig_file
from haploop.instruments.conformance import DaqConformance, Fired, bypass_interlock
from haploop.instruments.daq import CombinedDaq
from haploop.instruments.daq.serial_adc import SerialAdc
from haploop.mocks.daq import Card, CardTwin
from haploop.mocks.daq.serial_adc import Board, BoardServer, twin
from haploop.mocks.plant import Faults, Plant
from tests.raising import raises
from tests.rig_files import changed

SIMULATED = load_rig_file("simulated")
TEXT = {"separator": ",", "columns": 2}
BINARY = {"struct": "<Hhhh", "sync": "AA55", "checksum": "sum8"}


def settings(**changes: Any) -> SerialAdc.Settings:
    """Three channels in binary frames that are counted, 1000 a second."""
    channels = {
        "gauge0": {"column": 2, "scale": 10 / 2**15, "range": 10},
        "laser": {"column": 3, "scale": 5 / 2**15, "range": 5},
        "load": {"column": 4, "scale": 0.02 / 2**15, "range": 0.02},
    }
    board = {"port": "COM7", "rate_hz": 1000, "frame": BINARY, "counter": 1, "channels": channels}
    return SerialAdc.Settings.model_validate(board | changes)


def hx711(**changes: Any) -> SerialAdc.Settings:
    """A load cell's board: 80 lines a second, with the time of its own that nobody needs."""
    load = {"load": {"column": 2, "scale": 20e-3 / 2**23, "range": 0.02}}
    return settings(**({"rate_hz": 80, "frame": TEXT, "counter": None, "channels": load} | changes))


def with_faults(*faults: dict[str, Any]) -> RigFile:
    return changed(SIMULATED, simulation={"faults": faults})


def plant(*faults: dict[str, Any]) -> Plant:
    return Plant(with_faults(*faults), VirtualClock())


def board_of(daq: SerialAdc) -> Board:
    return daq._line.board


# As the only DAQ


class _OnlyDaq(DaqConformance):
    channels = ("gauge0", "laser", "load")
    faults = ("lost", "damaged", "silent", "daq-overrun")
    board: Board

    @contextmanager
    def fault(self, kind: str) -> Iterator[Fired]:
        board = self.board
        ahead = board._sent + 60
        if kind == "lost":
            board.loses = frozenset({ahead})
        elif kind == "damaged":
            board.damages = frozenset({ahead})
        elif kind == "silent":
            board.silent_from = ahead
        else:
            fault = {"kind": kind, "after": board.plant.clock.now() + 0.1}
            board.plant.faults = Faults.of_file(with_faults(fault))
        yield SimpleNamespace(fired=1)


class TestTwin(_OnlyDaq):
    @pytest.fixture
    def daq(self) -> Daq:
        daq = twin(settings(), plant())
        self.board = board_of(daq)
        return daq


class TestWire(_OnlyDaq):
    """The real driver and the real pyserial, on a socket."""

    capabilities = ()

    @pytest.fixture
    def daq(self) -> Iterator[Daq]:
        self.board = Board(settings(), plant())
        with BoardServer(self.board) as server, ExitStack() as opened:
            daq = SerialAdc.open(settings(port=f"socket://{server.address}"), self.board.plant.clock)
            opened.callback(daq.close)
            yield daq


def test_a_board_that_is_unplugged_is_one_sentence():
    board = Board(settings(), plant())
    with BoardServer(board) as server:
        daq = SerialAdc.open(settings(port=f"socket://{server.address}"), board.plant.clock)
        with daq.stream(["load"], 1000, 100) as stream:
            blocks = iter(stream)
            next(blocks)
            server.close()
            raises(InstrumentError, r"is gone|sends nothing", list, blocks)
        daq.close()


def test_its_volts_are_those_at_its_terminals():
    world = plant()
    world.connect("gauge0", lambda times: 3 * np.sin(2 * np.pi * 10 * times))
    daq = twin(settings(), world)
    board = board_of(daq)
    with daq.stream(["gauge0"], 1000, 100, 2000) as stream:
        begin = daq.end
        volts = stream.capture().volts[0]
    times = np.array([board.sampled(begin + k) for k in range(2000)])
    assert np.abs(volts - 3 * np.sin(2 * np.pi * 10 * times)).max() < 4 * 10 / 2**15


def test_a_rate_that_is_not_the_boards_is_told():
    daq = twin(hx711(), plant())
    with pytest.raises(ConfigurationError, match=r"sends 80 frames a second, and 100 were.*rate_hz = 80"):
        daq.stream(["load"], 100, 10)
    told = pytest.raises(ConfigurationError, match=r"sends 78\.9\d frames a second.*write rate_hz = 78\.9")
    with daq.stream(["load"], 80, 40) as stream, told:
        list(stream)


def test_lines_that_are_lost_without_a_counter_are_noticed_later():
    daq = twin(hx711(), plant())
    board = board_of(daq)
    board.drift = 1e-6
    board.loses = frozenset(range(1000, 1008))
    told = pytest.raises(InstrumentError, match="lost or damaged 8 frames")
    with daq.stream(["load"], 80, 40) as stream, told:
        list(stream)


def test_a_board_that_says_other_things_is_one_sentence():
    world = plant()
    board = Board(hx711(frame={"separator": ";", "columns": 2}), world)
    daq = SerialAdc(hx711(), world.clock, twin(hx711(), world)._line)
    daq._line.board = board
    with daq.stream(["load"], 80, 8) as stream, pytest.raises(InstrumentError, match="lost or damaged"):
        list(stream)
    daq = SerialAdc(hx711(), world.clock, daq._line)
    with pytest.raises(InstrumentError, match=r"reads as 'frame' says \(\d+ were damaged\)"):
        for _ in range(1000):
            daq.at(["load"], np.array([world.clock.now()])) if daq.lost > 50 else daq.follow(0)
            world.clock.sleep(0.1)


# Along with another one


class Both:
    """A card that samples a signal at 5 kHz, and a board that samples the same one on its own clock."""

    def __init__(self, own: SerialAdc.Settings, *faults: dict[str, Any]) -> None:
        self.plant = plant(*faults)
        self.plant.connect("gauge0", self.signal)
        self.plant.connect("switch", lambda times: 5.0 * ((times % 4.0) > 2.0))
        channels = {"laser": 5.0, "switch": 10.0, "drive": 10.0}
        card = Card("ACME 16", channels, 100_000.0, {"amplifier": 8.0}, device="Dev2")
        self.card = CardTwin(self.plant, card)
        self.adc = twin(own, self.plant)
        self.board = board_of(self.adc)
        bypass_interlock(self.card)
        self.daq = CombinedDaq(self.card, self.adc, self.plant.clock, "laser")

    @staticmethod
    def signal(times: np.ndarray) -> np.ndarray:
        return 4 * np.sin(2 * np.pi * 0.7 * times) + np.sin(2 * np.pi * 2.3 * times)


def slow(**changes: Any) -> SerialAdc.Settings:
    """Signal and counter at 80 Hz."""
    frame = {"struct": "<Hh", "sync": "AA55", "checksum": "crc16"}
    gauge = {"gauge0": {"column": 2, "scale": 10 / 2**15, "range": 10}}
    return settings(**({"rate_hz": 80, "frame": frame, "channels": gauge} | changes))


class TestAlongside(DaqConformance):
    capabilities = ("outputs", "loop")
    channels = ("gauge0", "laser", "drive")
    outputs = ("amplifier",)
    output_range = 8.0
    loop = ("amplifier", "drive")
    loop_gain = 0.5
    faults = ("many lost", "silent", "daq-overrun")

    @pytest.fixture
    def daq(self) -> Daq:
        self.both = Both(slow())
        self.both.plant.switch("A", True, 0.0)
        return self.both.daq

    @contextmanager
    def fault(self, kind: str) -> Iterator[Fired]:
        board = self.both.board
        self.both.adc.settle()
        if kind == "many lost":
            board.loses = frozenset(range(board._sent + 3, board._sent + 13))
        elif kind == "silent":
            board.silent_from = board._sent + 3
        else:
            board.plant.faults = Faults.of_file(with_faults({"kind": kind, "device": "Dev2"}))
        yield SimpleNamespace(fired=1)


@pytest.mark.parametrize(("drift", "seed"), [(-0.08, 0), (-0.013, 1), (0.02, 2)])
def test_its_samples_are_placed_within_what_is_stated(drift, seed, full):
    for number in range(5) if full else (seed,):
        both = Both(slow())
        both.board._rng = np.random.default_rng(number)
        both.board.drift = drift
        with both.daq.stream(["laser", "gauge0"], 5000, 500, 50_000) as stream:
            begin = both.plant.clock.now()
            volts = stream.capture().volts[1]
        late = lateness(volts, begin)
        assert abs(late) < both.adc.uncertainty and both.adc.uncertainty == pytest.approx(0.01)
        assert abs(late) < 3e-3  # the shortest delay is declared as it is


def lateness(volts: np.ndarray, begin: float) -> float:
    """By how much the signal's samples are late (s)."""
    tried = np.linspace(-0.06, 0.06, 241)
    times = begin + np.arange(0, len(volts), 25) / 5000
    left = [np.std(volts[::25] - Both.signal(times - late)) for late in tried]
    best = int(np.argmin(left))
    assert left[best] < 0.1
    return float(tried[best])


@pytest.mark.long
@pytest.mark.parametrize("latency", [0.002, 0.030])
def test_an_edge_that_both_see_measures_the_latency(latency):
    """The board is later, or earlier, than the rig file says."""
    frame = {"struct": "<HhB", "sync": "AA55", "checksum": "crc16"}
    both = Both(slow(frame=frame, latency=0.015, edge={"channel": "switch", "column": 3}))
    both.board.latency = latency
    errors = []
    for _ in range(2):
        with both.daq.stream(["gauge0"], 5000, 500, 100_000) as stream:
            begin = both.plant.clock.now()
            errors.append(lateness(stream.capture().volts[0], begin))
    assert errors[0] == pytest.approx(latency - 0.015, abs=2e-3)
    assert both.adc.uncertainty == pytest.approx(0.5 / 80, rel=0.05)
    assert abs(errors[1]) < both.adc.uncertainty


def test_a_few_lost_frames_are_bridged_and_told():
    both = Both(slow())
    both.adc.settle()
    ahead = both.board._sent
    both.board.loses = frozenset({ahead + 200, ahead + 400, ahead + 401})
    both.board.damages = frozenset({ahead + 300})
    assert {r.name: r.value for r in both.adc.read()} == {"frames lost": 0, "time uncertainty": 0.01}
    assert not both.adc.read()
    with both.daq.stream(["laser", "gauge0"], 5000, 500, 50_000) as stream:
        begin = both.plant.clock.now()
        assert abs(lateness(stream.capture().volts[1], begin)) < 3e-3
    (told,) = both.adc.read()
    assert (told.name, told.value, told.unit) == ("frames lost", 4, "frames")


def test_a_gap_is_an_error_and_no_straight_line():
    both = Both(slow())
    both.adc.settle()
    both.board.loses = frozenset(range(both.board._sent + 200, both.board._sent + 206))
    told = pytest.raises(InstrumentError, match=r"lost 6 frames in a row \(0.08\d+ s\).*'bridge' in \[adc\]")
    with both.daq.stream(["laser", "gauge0"], 5000, 500, 50_000) as stream, told:
        stream.capture()


def test_the_daqs_own_channels_need_no_board():
    both = Both(slow())
    both.board.silent_from = 0
    with both.daq.stream(["laser"], 5000, 500, 1000, {"amplifier": np.zeros(1000)}) as stream:
        assert stream.capture().volts.shape == (1, 1000)
    with pytest.raises(InstrumentError, match="sends nothing that reads as 'frame' says: check 'port'"):
        both.daq.stream(["laser", "gauge0"], 5000, 500, 1000)
    assert both.daq.cards(["laser", "gauge0"]) == {"Dev2": ["laser", "gauge0"]}


def test_a_silent_board_is_waited_for_once_as_long_as_its_program_may_take_to_start():
    both, waited = Both(slow()), []
    both.board.silent_from = 0
    for _ in range(2):
        begin = both.plant.clock.now()
        raises(InstrumentError, "sends nothing", both.adc.settle)
        waited.append(both.plant.clock.now() - begin)
    assert waited == pytest.approx([10.0, 2.0], abs=0.1)


@pytest.mark.parametrize(("changes", "says"), [
    ({"channels": {}}, "channels must have 1 or more entries"),
    ({"channels": {"a": {"column": 9, "range": 1}}}, "channels.a is column 9, and a frame has 4"),
    ({"channels": {"a": {"column": 2}}}, "the key 'channels.a.range' is missing"),
    ({"channels": {"a": {"column": 2, "range": 1, "scale": 0}}}, "a scale of 0 would lose"),
    ({"channels": {n: {"column": 2, "range": 1} for n in "ab"}}, "column 2 has two names, 'a' and 'b'"),
    ({"counter": 2}, "column 2 is the counter and 'gauge0': keep one"),
    ({"counter": 7}, "counter is column 7, and a frame has 4"),
    ({"edge": {"channel": "switch", "column": 8}}, "edge is column 8, and a frame has 4"),
    ({"edge": {"column": 4}}, "the key 'edge.channel' is missing"),
    ({"rate_hz": 0}, "rate_hz must be above 0"),
    ({"baud": 9600}, "1000 frames a second are 110000 baud, and baud is 9600: raise baud"),
    ({"baud": 10}, "baud must be 300 or more"),
    ({"frame": {"struct": "<hh"}}, "binary frames need sync"),
    ({"terminal": "Dev1/ai0"}, "unknown key 'terminal'"),
    ({"latency": -1}, "latency must be 0 or more"),
])  # fmt: skip
def test_a_wrong_table_is_one_sentence(changes, says):
    given = settings().model_dump() | {"frame": BINARY} | changes
    refused = raises(ConfigurationError, says, validate, SerialAdc.Settings, given, "[adc] of lab.toml")
    assert "\n" not in refused and refused[-1] in ".?"
