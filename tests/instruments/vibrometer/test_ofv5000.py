"""The OFV-5000: its driver on a simulated controller, its serial line, and the words of its answers."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from pydantic import ValidationError

from haploop.base.clock import VirtualClock
from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.instruments import load_rig_file
from haploop.instruments.vibrometer import ofv5000
from haploop.instruments.vibrometer.ofv5000 import Command, Ofv5000
from haploop.mocks.plant import LaserHead, Plant
from haploop.mocks.transport import DirectLine, LineServer, ReplyFault
from haploop.mocks.vibrometer import Controller, twin
from tests.raising import raises

RANGE = "Get,VeloDec,0,Range"


def settings(**changes: object) -> Ofv5000.Settings:
    basic = {"port": "COM3", "channel": "laser", "scale": 0.005, "timeout": 0.2}
    return Ofv5000.Settings.model_validate(basic | changes)


def controller(clock: VirtualClock, scale: float = 0.005) -> Controller:
    return Controller(LaserHead(scale * 10, scale, 20e3, 12.3e-6), "VeloDec,0", 10.0, clock)


@dataclass
class Setup:
    clock: VirtualClock
    controller: Controller
    laser: Ofv5000


@dataclass
class Wired(Setup):
    server: LineServer

    def faulty(self, kind: str, **more: object) -> ReplyFault:
        fault = ReplyFault(kind, **more)
        self.server.faults.append(fault)
        return fault


@pytest.fixture
def setup() -> Setup:
    clock = VirtualClock()
    box = controller(clock)
    return Setup(clock, box, Ofv5000(settings(), clock, DirectLine(box.answer)))


@pytest.fixture
def wired() -> Iterator[Wired]:
    clock = VirtualClock()
    box = controller(clock)
    with LineServer(box.answer) as server:
        laser = Ofv5000.open(settings(port=f"socket://{server.address}"), clock)
        yield Wired(clock, box, laser, server)
        laser.close()


def test_reads_what_the_controller_is_set_to(setup):
    laser = setup.laser
    assert (laser.identity, laser.channel) == ("OFV-5000 Vibrometer Controller", "laser")
    assert laser.declared is None and laser.scale == 0.005 and laser.bandwidth_hz == 20e3
    assert (laser.range, laser.delay) == pytest.approx((0.05, 12.3e-6))
    assert laser.to_si(np.array([2.0]))[0] == pytest.approx(0.01)


def test_it_follows_the_controller(setup):
    for level in (0.25, 0.0):
        setup.controller.head.level = level
        assert setup.laser.signal_level() == level
    for echo in (False, True):
        setup.controller.echo = echo
        setup.laser.check_range()
        assert setup.laser.scale == setup.controller.head.scale == 0.005
        assert setup.laser.range == setup.controller.head.range == pytest.approx(0.05)
        before = setup.clock.now()
        setup.laser.autofocus()
        assert 2.5 < setup.clock.now() - before < 4


def test_a_range_changed_at_the_front_panel_is_found_by_reading_it_again(setup):
    setup.laser.check_range()
    setup.controller.head.scale = 0.05
    with pytest.raises(ConfigurationError, match=r"set to the range 50mm/s/V.* says 5mm/s/V.*\[vibrometer\]"):
        setup.laser.check_range()


def test_autofocus_gives_up_at_its_deadline(setup):
    setup.controller.focusable = False
    before = setup.clock.now()
    raises(InstrumentError, "no focus within 30 s", setup.laser.autofocus)
    assert setup.clock.now() - before < 31


def test_opening_refuses_another_range_and_changes_none(wired):
    wired.controller.head.scale = 0.05
    wanted = settings(port=f"socket://{wired.server.address}")
    raises(ConfigurationError, "is set to the range 50mm/s/V", Ofv5000.open, wanted, wired.clock)
    assert wired.controller.head.scale == 0.05
    laser = Ofv5000.connect(wanted, wired.clock)
    assert laser.scale == 0.05, "what is measured is scaled by what is set"
    wired.controller.head.scale = wanted.scale
    laser.check_range()
    assert laser.scale == wanted.scale
    laser.close()


@pytest.mark.parametrize(("kind", "sentence"), [
    ("silence", r"did not answer 'Get,VeloDec,0,Range' within 0.2 s.*'port' and 'baud'"),
    ("terminator", r"'5mm/s/V\\r'.* ends in a carriage return.*set its terminator to LF"),
    ("garbled", r"which is no text: check its 'port' and 'baud'"),
    ("drip", r"no line end within 0.2 s"),
    ("disconnect", r"was lost after 'Get,VeloDec,0,Range'.*cable"),
    ("truncated", r"was lost after 'Get,VeloDec,0,Range'"),
])  # fmt: skip
def test_a_fault_of_the_line_is_one_sentence_and_passes(wired, kind, sentence):
    fault = wired.faulty(kind, asked=RANGE, times=1)
    raises(InstrumentError, rf"^OFV-5000 at socket://\S+ .*{sentence}", wired.laser.check_range)
    assert fault.fired == 1
    assert wired.laser.scale == 0.005, "nothing was taken for data"
    wired.laser.check_range()


def test_a_late_answer_is_not_taken_for_the_next_one(wired):
    wired.laser.signal_level()
    fault = wired.faulty("delay", asked="SignalLevel", times=1, delay=0.25)
    raises(InstrumentError, "did not answer", wired.laser.signal_level)
    assert fault.fired == 1
    wired.laser.check_range()


@pytest.mark.parametrize(("asked", "answer"), [
    (RANGE, "5um"),
    (RANGE, "-5mm/s/V"),
    ("Get,SignalLevel,0,Value", "513"),
    ("Get,SignalLevel,0,Value", "4.5"),
    ("Get,VeloDec,0,SignalDelay", "soon"),
])  # fmt: skip
def test_an_answer_that_cannot_be_right_is_refused(asked, answer):
    clock = VirtualClock()
    box = controller(clock)
    line = DirectLine(lambda line: [answer] if line == asked else box.answer(line))
    with pytest.raises(InstrumentError, match=rf"OFV-5000 at COM3 answered '{asked}' with '{answer}'"):
        Ofv5000(settings(), clock, line).signal_level()


@pytest.mark.parametrize(("answer", "says"), [
    (lambda _: ["Arduino"], r"COM3 calls itself 'Arduino'.*correct 'port'"),
    (lambda line: [line] * 20, "loop-back"),
], ids=["something else", "a loop-back is no echo"])  # fmt: skip
def test_what_is_at_the_port_is_named(answer, says):
    raises(InstrumentError, says, Ofv5000, settings(), VirtualClock(), DirectLine(answer))


def test_a_wrong_range_shows_in_the_data():
    clock = VirtualClock()
    plant = Plant(load_rig_file("simulated"), clock)
    times = 1.0 + np.arange(5000) / 50_000
    clock.sleep(2)
    twin(settings(), plant)
    noise = plant.read(["laser"], times[np.newaxis]).std()
    twin(settings(scale=0.05), plant)
    assert plant.read(["laser"], times[np.newaxis]).std() == pytest.approx(noise / 10, rel=0.1)


def test_codec():
    assert str(Command("Set", "VeloDec,0", "Range", "5mm/s/V")) == "Set,VeloDec,0,Range,5mm/s/V"
    for line in ("Get,VeloDec,1,Range", "GetDevInfo,Controller,0,Name", "Set,SensorHead,0,AutoFocusArea,1,2"):
        command = Command.parse(line + "\r\n")
        assert command is not None
        assert str(command) == line
    for line in ("", "Get,VeloDec,0", "Set,VeloDec,0,Range", "Put,VeloDec,0,Range", "Get,VeloDec,x,Range"):
        assert Command.parse(line) is None
    assert ofv5000.scale_of(ofv5000.scale_text(0.125)) == 0.125


@pytest.mark.parametrize(("parse", "text", "value"), [
    (ofv5000.scale_of, "5mm/s/V", 0.005),
    (ofv5000.scale_of, "0.5 m/s/V", 0.5),
    (ofv5000.scale_of, "100um/s/V", 1e-4),
    (ofv5000.level_of, "512", 1.0),
    (ofv5000.duration_of, "12.3 us", 12.3e-6),
    (ofv5000.duration_of, "12.3", 12.3e-6),
    (ofv5000.duration_of, "1.1ms", 1.1e-3),
    (ofv5000.duration_of, "1.23E-05", 12.3e-6),
    (ofv5000.duration_of, "0", 0.0),
    (ofv5000.duration_of, "1.23e+1 us", 12.3e-6),
    (ofv5000.scale_of, "5 mm/s / V", 0.005),
    (ofv5000.scale_of, "5.0E+00mm/s/V", 0.005),
    (ofv5000.frequency_of, "20 kHz", 20e3),
    (ofv5000.frequency_of, "1.5 MHz", 1.5e6),
    (ofv5000.frequency_of, "20000", 20e3),
    (ofv5000.frequency_of, "2.0E+04 Hz", 20e3),
    (ofv5000.frequency_of, "Not Installed", None),
    (ofv5000.ranges_of, "5mm/s/V,10 mm/s / V; 1m/s/V", (0.005, 0.01, 1.0)),
    (ofv5000.ranges_of, "Not Available", ()),
])  # fmt: skip
def test_forms_in_which_firmware_may_write(parse, text, value):
    assert parse(text) == (value if value is None else pytest.approx(value))


def test_what_cannot_be_read_is_declared():
    clock = VirtualClock()
    box = controller(clock)
    lines = {f"Get,VeloDec,0,{name}": ["Not Available"] for name in ("SignalDelay", "MaxFreq", "Range")}
    line = DirectLine(lambda asked: lines.get(asked) or box.answer(asked))
    whole = {"bandwidth_hz": 5000, "delay": 1e-5, "range_declared": True}
    for missing, error, says in (
        ("bandwidth_hz", ConfigurationError, "give 'bandwidth_hz'"),
        ("delay", ConfigurationError, "tells no delay: give 'delay'"),
        ("range_declared", InstrumentError, "give range_declared = true"),
    ):
        with pytest.raises(error, match=says):
            Ofv5000(settings(**{key: value for key, value in whole.items() if key != missing}), clock, line)
    laser = Ofv5000(settings(**whole), clock, line)
    assert (laser.delay, laser.bandwidth_hz, laser.scale) == (1e-5, 5000, 0.005)
    # A person confirms it, as for a laser without an interface.
    assert laser.declared is not None and "VeloDec,0 set to 5mm/s/V?" in laser.declared
    laser.check_range()
    raises(ValidationError, "decoder", settings, decoder="DisplDec,0")


@pytest.mark.parametrize("scale", [0.025, 0.125])
def test_a_range_of_older_decoders_is_refused(scale):
    plant = Plant(load_rig_file("bench"), VirtualClock())
    raises(ConfigurationError, "Correct 'scale' or 'decoder'", twin, settings(scale=scale), plant)


def test_names_versions_and_lists_are_told():
    box = controller(VirtualClock())
    for question, answer in (
        ("GetDevInfo,VeloDec,0,Name", "VD-08"),
        ("Get,VeloDec,1,Name", "VD-09"),
        ("GetDevInfo,Controller,0,Version", "2.05"),
        ("GetDevInfo,VeloDec,2,Name", "Not Available"),
    ):
        assert box.answer(question) == [answer]
    # What a lab's own program sets; a range that the decoder has not changes nothing.
    for wanted, read in (("50mm/s/V", "50mm/s/V"), ("3mm/s/V", "50mm/s/V")):
        assert box.answer(f"Set,VeloDec,0,Range,{wanted}") == []
        assert box.answer("Get,VeloDec,0,Range") == [read]
    (listed,) = box.answer("GetDevInfo,VeloDec,1,Range")
    assert ofv5000.ranges_of(listed)[0] == 0.005 and len(ofv5000.ranges_of(listed)) == 8
