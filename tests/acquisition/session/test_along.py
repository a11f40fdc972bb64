"""What is recorded besides the presses: instruments that are on no DAQ, and extra channels."""

import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from haploop.acquisition import Protocol, Recording, record, verify
from haploop.acquisition.session import side_recording
from haploop.base.clock import RealClock
from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.instruments import AnalogChannel, Block, NewFile, Reading, load_rig_file
from tests.acquisition.presses.pressworld import FULL_SCALE, world_rig
from tests.raising import raises, raising

BLOCK = round(Protocol().block * 5000)
"""Samples."""


class Meter:
    """Recorded along; each of its methods may be replaced."""

    identity = "meter"
    reads = ("level",)
    reads_hz = 2.0

    def __init__(self, **methods):
        self.calls = []
        self.threads = set()
        self.__dict__.update(methods)

    def start(self, stem, clock):
        self.calls.append("start")
        self.stem = stem

    def read(self):
        self.threads.add(threading.current_thread())
        self.calls.append("read")
        return [Reading("level", len(self.calls), "m")]

    def stop(self):
        self.calls.append("stop")
        return []


def rig_with(meter, **settings):
    rig = world_rig(**settings)
    rig._roles["meter"] = meter
    return rig


def errors(recording):
    return [event.text for event in recording.events if event.kind == "along-error"]


def test_readings_come_at_their_samples_from_a_thread_of_their_own(tmp_path):
    meter = Meter()
    read = meter.read
    # Virtual time waits for it, however fast the blocks come.
    meter.read = lambda: time.sleep(0.2) or read()
    recording = record(rig_with(meter), "push", "P01", 2, tmp_path)
    assert meter.calls[0] == "start" and meter.calls[-1] == "stop"
    assert meter.stem == tmp_path / "P01-push"
    assert meter.threads and threading.main_thread() not in meter.threads
    first, *others = [reading.sample for reading in recording.readings]
    assert first == BLOCK  # the first block
    # Twice a second, at the end of the block in which each is due.
    due = [-(-n // BLOCK) * BLOCK for n in range(2500, recording.volts.shape[1] + 1, 2500)]
    assert others == due != []
    assert {(r.instrument, r.name, r.unit) for r in recording.readings} == {("meter", "level", "m")}
    assert verify(recording.path) == ()


def test_the_same_world_gives_the_same_recording_and_a_reading_is_in_its_hash(tmp_path):
    one, two = (record(rig_with(Meter()), "push", "P01", 1, tmp_path / n).content_hash for n in "ab")
    other = record(rig_with(Meter(read=lambda: [Reading("level", 7, "m")])), "push", "P01", 1, tmp_path / "c")
    assert one == two != other.content_hash


@pytest.mark.parametrize(("read", "says"), [
    (raising(InstrumentError("The meter lost its cable.")), "The meter lost its cable."),
    (raising(ZeroDivisionError("nothing\nat all")), "ZeroDivisionError: nothing at all."),
    (lambda: [Reading("level", float("nan"), "m")], "was nan"),
    (lambda: [Reading("level", "high", "m")], "could not convert"),
    (lambda: [Reading("n" * 300, 1.0, "m")], "too long for an event"),
    (lambda: None, "not iterable"),
    (lambda: sys.exit(3), "SystemExit: 3."),
    (lambda: [Reading("level", 1.0, "\x1b[2J")], "cannot be printed"),
])  # fmt: skip
def test_what_fails_is_one_event_and_the_presses_are_kept(tmp_path, read, says):
    recording = record(rig_with(Meter(read=read)), "push", "P01", 2, tmp_path)
    assert recording.complete and len(recording.accepted) == 2
    (told,) = errors(recording)
    assert says in told
    assert recording.readings == ()


def test_one_that_recovers_is_read_again_and_its_next_failure_is_told(tmp_path):
    meter = Meter()
    good = meter.read

    def read():
        found = good()
        if len(meter.calls) in (3, 4, 6):
            raise InstrumentError("The meter lost its cable.")
        return found

    meter.read = read
    recording = record(rig_with(meter), "push", "P01", 3, tmp_path)
    assert len(errors(recording)) == 2
    assert len(recording.readings) == meter.calls.count("read") - 3


def test_one_that_does_not_start_is_refused_before_anything_is_recorded(tmp_path):
    meter = Meter(start=raising(InstrumentError("The meter is out of paper.")))
    raises(InstrumentError, "out of paper", record, rig_with(meter), "push", "P01", 1, tmp_path)
    assert list(tmp_path.iterdir()) == []
    assert meter.calls == ["stop"]


def test_one_that_ends_the_program_when_it_starts_or_stops_does_not(tmp_path):
    with pytest.raises(InstrumentError, match="SystemExit"):
        record(rig_with(Meter(start=raising(SystemExit(3)))), "push", "P01", 1, tmp_path)
    for number, error in enumerate((SystemExit(3), InstrumentError("The meter does not stop."))):
        recording = record(rig_with(Meter(stop=raising(error))), "push", f"P0{number}", 1, tmp_path)
        assert recording.complete
        assert ("SystemExit", "does not stop")[number] in errors(recording)[0]


def test_one_that_hangs_costs_no_press_and_is_waited_for_once(tmp_path, monkeypatch):
    monkeypatch.setattr(side_recording, "_HUNG", 0.3)
    let_go = threading.Event()
    meter = Meter(read=lambda: let_go.wait(60) and [])
    began = time.monotonic()
    recording = record(rig_with(meter), "push", "P01", 2, tmp_path)
    let_go.set()
    assert recording.complete
    assert "has not answered" in errors(recording)[0]
    assert time.monotonic() - began < 30


def test_what_gives_more_than_it_said_leaves_the_presses_their_space(tmp_path):
    meter = Meter(read=lambda: [Reading("level", n, "m") for n in range(3000)])
    recording = record(rig_with(meter), "push", "P01", 1, tmp_path)
    assert recording.complete
    kinds = [event.kind for event in recording.events]
    assert kinds.count("along-full") == 1
    assert "pressed" in kinds and "events-full" not in kinds


@pytest.mark.parametrize("reads_hz", [0, -1, float("nan"), float("inf")])
def test_a_rate_that_is_none_is_refused(tmp_path, reads_hz):
    with pytest.raises(ConfigurationError, match="must be more than 0"):
        record(rig_with(Meter(reads_hz=reads_hz)), "push", "P01", 1, tmp_path)


def test_a_rate_beyond_the_blocks_takes_no_more_space_than_they_have(tmp_path):
    recording = record(rig_with(Meter(reads_hz=1e9)), "push", "P01", 1, tmp_path)
    samples = [reading.sample for reading in recording.readings]
    assert samples == list(range(BLOCK, BLOCK * len(samples) + 1, BLOCK))
    beside = side_recording.SideRecording(rig_with(Meter(reads_hz=1e9)), tmp_path / "a.h5")
    assert beside.reserve(100.0, BLOCK) < 2.5 * 100 * 5000 / BLOCK


def test_it_is_stopped_when_the_recording_is_interrupted(tmp_path):
    meter = Meter()
    rig = rig_with(meter)
    rig.daq.fails_at = 30
    raises(InstrumentError, "lost samples", record, rig, "push", "P01", 4, tmp_path)
    assert meter.calls[-1] == "stop" and meter.calls.count("stop") == 1
    assert len(Recording.open(tmp_path / "P01-push.h5").readings) == meter.calls.count("read")


def test_a_file_is_beside_the_recording_with_its_hash(tmp_path):
    def read():
        path = meter.stem.with_name(f"{meter.stem.name}-{len(meter.calls)}.bin")
        path.write_bytes(b"frame")
        meter.calls.append("read")
        return [NewFile("frame", path)]

    meter = Meter(read=read, reads=("frame",))
    recording = record(rig_with(meter), "push", "P01", 1, tmp_path)
    assert [file.file for file in recording.files][:2] == ["P01-push-1.bin", "P01-push-2.bin"]
    assert verify(recording.path) == ()
    (tmp_path / "P01-push-1.bin").write_bytes(b"frome")
    (tmp_path / "P01-push-2.bin").unlink()
    problems = verify(recording.path)
    assert "P01-push-1.bin was changed" in problems[0] and "P01-push-2.bin" in problems[1]


def test_a_file_elsewhere_is_refused(tmp_path):
    (tmp_path / "frame").write_bytes(b"frame")
    meter = Meter(read=lambda: [NewFile("frame", tmp_path / "frame")])
    recording = record(rig_with(meter), "push", "P01", 1, tmp_path / "data")
    assert "must be in the recording's folder" in errors(recording)[0]


def test_in_real_time_no_block_waits_for_a_slow_instrument(tmp_path):
    """Blocks are written as they come while a read takes a second."""
    meter = Meter(reads_hz=100.0)
    read = meter.read
    meter.read = lambda: time.sleep(1.0) or read()
    rig = rig_with(meter)
    vars(rig)["clock"] = RealClock()
    path, longest = tmp_path / "P01-push.h5", 0.0
    sink = SimpleNamespace(written=0, path=path, note=lambda *_event: None)
    with side_recording.SideRecording(rig, path) as recorded:
        recorded.reserve(10.0, 250)
        for number in range(1, 100):
            block = Block(250 * (number - 1), np.zeros((1, 250)), np.zeros(1, dtype=bool))
            sink.written = block.end
            began = time.perf_counter()
            recorded.follow(sink)
            longest = max(longest, time.perf_counter() - began)
            time.sleep(0.005)
    assert longest < 0.2
    assert "read" in meter.calls


# Extra channels

ROOM = AnalogChannel(channel="extra", scale=100.0, offset=-50.0, unit="°C", name="Room")


def world_with_extra(monkeypatch, **settings):
    monkeypatch.setitem(FULL_SCALE, "extra", 10.0)
    rig = world_rig(sensors={"extra": {"temperature": ROOM}}, **settings)
    felt = rig.daq.world.volts
    rig.daq.world.volts = lambda c, t: 0.7 + 0.001 * t if c == "extra" else felt(c, t)
    return rig


def test_an_extra_channel_is_recorded_in_its_own_unit(tmp_path, monkeypatch):
    recording = record(world_with_extra(monkeypatch), "push", "P01", 2, tmp_path)
    assert recording.channels[-1] == "extra"
    t = np.arange(recording.volts.shape[1]) / recording.rate_hz
    # Within a code of the converter, 10 V / 32768 at 100 degrees a volt.
    assert np.abs(recording.extra["temperature"] - (20 + 0.1 * t)).max() < 0.02
    assert recording.sensors.extra["temperature"] == ROOM
    assert recording.delay("temperature") == pytest.approx(recording.header.delays[-1])
    assert len(recording.accepted) == 2


def test_an_extra_channel_at_its_end_spoils_no_press(tmp_path, monkeypatch):
    rig = world_with_extra(monkeypatch)
    felt = rig.daq.world.volts
    rig.daq.world.volts = lambda c, t: np.full(len(t), 11.0) if c == "extra" else felt(c, t)
    recording = record(rig, "push", "P01", 2, tmp_path)
    assert len(recording.accepted) == 2
    assert not recording.saturated.any()


def test_extra_channels_and_readings_are_exported(tmp_path, monkeypatch):
    rig = world_with_extra(monkeypatch)
    rig._roles["meter"] = Meter()
    recording = record(rig, "push", "P01", 1, tmp_path)
    assert recording.readings
    pandas = pytest.importorskip("pandas")
    table = recording.to_pandas()
    assert np.array_equal(table["temperature"], recording.extra["temperature"])
    assert table["meter_level"].count() == len(recording.readings)
    assert table.attrs["units"] | {"meter_level": "m", "temperature": "°C"} == table.attrs["units"]
    assert isinstance(table, pandas.DataFrame)
    pytest.importorskip("xarray")
    data = recording.to_xarray()
    assert (data.temperature.units, data.temperature.long_name) == ("°C", "Room")
    assert list(data.meter_level_time * recording.rate_hz) == [r.sample for r in recording.readings]


@pytest.mark.parametrize(("text", "says"), [
    ('room = { chanel = "laser" }', "unknown key 'sensors.extra.room.chanel'; did you mean 'channel'"),
    ('room = { channel = "laser", scale = 0 }', "a scale of 0 would lose"),
    ('room = { channel = "laser", scale = nan }', "sensors.extra.room.scale"),
    ('force = { channel = "laser" }', "'force' is the name of something"),
    ('Fz = { channel = "laser" }', "'Fz' is the name of something"),
    (r'room = { channel = "laser", name = "\u001b[2J" }', "room.name: use characters that can be printed"),
    (r'room = { channel = "laser", unit = "a\nb" }', "room.unit: use characters that can be printed"),
    ('"a b" = { channel = "laser" }', "'a b' is not a valid name"),
    ("room = {}", "'sensors.extra.room.channel' is missing"),
])  # fmt: skip
def test_what_is_wrong_with_an_extra_channel_is_one_sentence(tmp_path, text, says):
    path = tmp_path / "rig.toml"
    path.write_text(f'base = "simulated"\n[sensors.extra]\n{text}\n', encoding="utf-8")
    raises(ConfigurationError, says, load_rig_file, path)
