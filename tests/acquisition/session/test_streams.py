"""Streams of other programs, recorded along: simulated ones on clocks of their own, and real ones."""

import hashlib
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import haploop
from haploop.acquisition import Recording
from haploop.acquisition.recording import BLOCK, AlongFile
from haploop.acquisition.recording.streams import _arrivals, _line, read_streams
from haploop.base.errors import ConfigurationError, DataError, InstrumentError
from haploop.instruments import load_rig_file
from haploop.mocks.streams import DRIFT, OFFSET
from tests.commands.test_lsl import loopback
from tests.raising import raises

RIG = """
base = "minimal"
name = "streams"
[streams]
driver = "lsl"
[streams.inlets.eeg]
type = "EEG"
[streams.inlets.marks]
type = "Markers"
name = "cues"
"""


def rig_file(folder: Path, more: str = "", text: str = RIG) -> Path:
    path = folder / "rig.toml"
    path.write_text(text + more, encoding="utf-8")
    return path


def fault(kind: str, after: float, duration: float = 1e9) -> str:
    return f'[[simulation.faults]]\nkind = "{kind}"\nstream = "eeg"\nafter = {after}\nduration = {duration}\n'


def recorded(folder: Path, presses: int = 4, more: str = "", seed: int = 0) -> Recording:
    with haploop.open_rig(rig_file(folder, more), simulate="twin", simulation={"seed": seed}) as rig:
        return haploop.record(rig, "latch", "P01", presses, folder)


def errors(recording: Recording) -> list[str]:
    return [event.text for event in recording.events if event.kind == "along-error"]


def later(recording: Recording, stream: Any, inside: np.ndarray, delays: np.ndarray) -> float:
    """By which of the delays (s) the recorded force is later than a stream's."""
    time = np.arange(len(recording)) / recording.rate_hz
    at, felt = stream.times[inside], stream.values[inside, 0]
    off = [np.square(np.interp(at + d, time, recording.force) - felt).sum() for d in delays]
    return float(delays[int(np.argmin(off))])


@pytest.mark.parametrize("seed", range(3))
def test_samples_lie_where_the_sender_saw_the_finger(tmp_path, seed):
    """The sender's clock is a day away and runs faster, and its force is the one that the rig recorded."""
    pytest.importorskip("pyxdf")
    recording = recorded(tmp_path, 8, seed=seed)
    eeg, marks = recording.streams["eeg"], recording.streams["marks"]
    assert (eeg.labels, eeg.units, eeg.rate_hz, eeg.sender) == (("force", "count"), ("N", "none"), 250, "eeg")
    assert list(np.diff(eeg.values[:, 1])) == [1.0] * (len(eeg) - 1)
    # By the truth of the simulation.
    true = (eeg.stamps - OFFSET) / (1 + DRIFT)
    assert abs(true[0]) < 0.01 and true[-1] > recording.duration - 0.1
    assert np.abs(eeg.times - true).max() < 3e-4
    # By what both measured: the delay at which they agree best.
    time = np.arange(len(recording)) / recording.rate_hz
    inside = (eeg.times > 0.1) & (eeg.times < time[-1] - 0.1)
    assert abs(later(recording, eeg, inside, np.arange(-5e-3, 5e-3, 1e-4))) < 4e-4
    # Markers: a text at 1 N, on the way down and up.
    assert marks.rate_hz == 0 and list(marks.values[:2, 0]) == ["press begins", "press ends"]
    felt = np.interp(marks.times, time, recording.force)
    assert len(marks) == 16 and np.abs(felt - 1).max() < 0.35
    # Nothing is lost: what was measured is there too.
    assert eeg.corrections.shape[1] == 2 and len(eeg.corrections) >= 4
    assert eeg.corrections[0, 1] == pytest.approx(512 - OFFSET, abs=1e-3)
    assert errors(recording) == [] and haploop.verify(recording.path) == ()


def test_the_same_world_gives_the_same_streams(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    assert recorded(tmp_path / "a").content_hash == recorded(tmp_path / "b").content_hash


def test_a_stream_that_is_lost_is_told_once_and_comes_back_on_its_own_clock(tmp_path):
    pytest.importorskip("pyxdf")
    recording = recorded(tmp_path, 6, fault("stream-lost", 2.0, 1.5))
    (told,) = errors(recording)
    assert "The stream eeg was lost" in told
    eeg = recording.streams["eeg"]
    (at,) = np.flatnonzero(np.diff(eeg.times) > 0.1)
    # It is looked at twice a second: what is sent until it is found again is not there.
    assert 1.9 < eeg.times[at] < 2.01 and 3.4 < eeg.times[at + 1] < 4.1
    assert np.abs(eeg.times - (eeg.stamps - OFFSET) / (1 + DRIFT)).max() < 5e-4


def test_samples_that_do_not_come_are_told(tmp_path):
    recording = recorded(tmp_path, 6, fault("samples-lost", 2.0, 0.3))
    (gap,) = (reading for reading in recording.readings if reading.name == "eeg gap")
    assert gap.value == pytest.approx(0.304, abs=2e-3)
    assert 2.3 < gap.sample / recording.rate_hz < 3
    (tmp_path / "silent").mkdir()
    silent = recorded(tmp_path / "silent", 6, fault("samples-lost", 2.0))
    (told,) = errors(silent)
    assert "sends nothing" in told and silent.complete


def test_a_stream_that_is_not_there_is_one_sentence_and_nothing_is_recorded(tmp_path):
    says = "There is no LSL stream with the type 'EEG' of eeg in \\[streams\\]; LSL finds 'cues'"
    raises(InstrumentError, says, recorded, tmp_path, 1, fault("stream-lost", 0.0))
    assert [path.name for path in tmp_path.iterdir()] == ["rig.toml"]
    with haploop.open_rig(rig_file(tmp_path, fault("stream-lost", 0.0)), simulate="twin") as rig:
        found = {finding.name: finding for finding in haploop.examine(rig)}
    assert found["Stream eeg"].status == "red" and "no LSL stream" in found["Stream eeg"].sentence
    assert found["Stream marks"].status == "green" and "1 channel of string" in found["Stream marks"].sentence


def test_two_streams_that_fit_are_told_apart_by_a_person(tmp_path):
    text = RIG.replace('type = "Markers"\n', 'type = "EEG"\n')
    with (
        haploop.open_rig(rig_file(tmp_path, text=text), simulate="twin") as rig,
        pytest.raises(InstrumentError, match=r"2 LSL streams have the type 'EEG' of eeg .*: 'cues'.*, 'eeg'"),
    ):
        haploop.record(rig, "latch", "P01", 1, tmp_path)


@pytest.mark.parametrize(("text", "says"), [
    (RIG.replace('type = "EEG"\n', ""), "give at least one of name, type and source_id"),
    (RIG.replace("inlets.eeg", 'inlets."../eeg"'), "eeg"),
    (RIG.replace('type = "EEG"', 'typ = "EEG"'), "did you mean 'type'"),
    ('base = "minimal"\nname = "streams"\n[streams]\ndriver = "lsl"\n', "inlets' is missing"),
])  # fmt: skip
def test_what_is_wrong_in_a_rig_file_is_one_sentence(tmp_path, text, says):
    assert "\n" not in raises(ConfigurationError, says, load_rig_file, rig_file(tmp_path, text=text))


def test_a_missing_pylsl_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pylsl", None)
    from haploop.instruments.streams import LslStreams

    settings = LslStreams.Settings.model_validate({"inlets": {"eeg": {"type": "EEG"}}})
    raises(ConfigurationError, r'pip install "haploop\[lsl\]"', LslStreams.open, settings, None)


def test_a_file_that_was_changed_is_refused(tmp_path):
    pytest.importorskip("pyxdf")
    recording, path = recorded(tmp_path), tmp_path / "P01-latch-eeg.xdf"
    data = bytearray(path.read_bytes())
    data[-20] ^= 1
    path.chmod(0o600)
    path.write_bytes(data)
    with pytest.raises(DataError, match="was changed after it was recorded"):
        Recording.open(recording.path).streams  # noqa: B018
    assert "was changed" in haploop.verify(recording.path)[0]
    path.unlink()
    with pytest.raises(DataError, match="cannot be read"):
        Recording.open(recording.path).streams  # noqa: B018


def test_recording_and_streams_are_exported_on_one_time(tmp_path):
    pyxdf = pytest.importorskip("pyxdf")
    recording = recorded(tmp_path)
    haploop.export_file(recording.path, "xdf", tmp_path / "all.xdf")
    streams, _ = pyxdf.load_xdf(str(tmp_path / "all.xdf"), dejitter_timestamps=False)
    found = {one["info"]["name"][0]: one for one in streams}
    assert set(found) == {"haploop streams record", "haploop presses", "eeg", "cues"}
    about = found["haploop streams record"]["info"]
    assert about["desc"][0]["simulated"] == ["True"] and float(about["nominal_srate"][0]) == 5000
    labels = [one["label"][0] for one in about["desc"][0]["channels"][0]["channel"]]
    np.testing.assert_array_equal(
        found["haploop streams record"]["time_series"][:, labels.index("force")], recording.force
    )
    time = found["haploop streams record"]["time_stamps"]
    np.testing.assert_allclose(time, np.arange(len(recording)) / 5000, atol=1e-12)
    assert [text for (text,) in found["haploop presses"]["time_series"]] == [
        f"press {number} activates" for number in (1, 2, 3, 4)
    ]
    np.testing.assert_array_equal(found["eeg"]["time_series"], recording.streams["eeg"].values)
    np.testing.assert_array_equal(found["cues"]["time_stamps"], recording.streams["marks"].times)


def test_single_corrections_that_are_far_off_move_no_stamp():
    rng = np.random.default_rng(1)
    times = np.arange(0, 600, 2.0)
    measured = 1e5 + 4e-5 * times + rng.normal(0, 1e-4, len(times))
    measured[rng.choice(len(times), 60, replace=False)] += 0.5
    line, _ = _line(times, measured)
    assert np.abs(line(times) - (1e5 + 4e-5 * times)).max() < 1e-4


def test_late_blocks_tilt_no_line_and_another_rate_is_found():
    """Arrivals on a busy computer: the first blocks come late, which a line through the earliest follows."""
    rng = np.random.default_rng(2)
    for rate_hz, seconds, drift in ((1000.0, 11, 0.0), (1000.0, 60, 0.0), (5000.0, 300, 50e-6)):
        count = int(seconds / 0.05)
        blocks = np.zeros(count, BLOCK)
        blocks["first"], blocks["count"] = round(0.05 * rate_hz) * np.arange(count), round(0.05 * rate_hz)
        taken = 7.0 + (blocks["first"] + blocks["count"] - 1.0) * (1 + drift) / rate_hz
        late = rng.exponential(5e-3, count)
        late[: count // 4] += 0.02
        blocks["time"] = taken + late
        begin, period, _ = _arrivals(blocks, rate_hz)
        at = np.array([0.0, seconds * rate_hz])
        np.testing.assert_allclose(begin + period * at, 7.0 + at * (1 + drift) / rate_hz, atol=2e-3)


def test_a_day_of_clock_readings_needs_no_memory_for_all_their_pairs():
    """Two readings a second: all pairs would take 240 GB."""
    at = np.arange(0.0, 86_400.0, 0.5)
    line, spread = _line(at, 3.0 + 40e-6 * at + np.random.default_rng(1).normal(0, 1e-5, len(at)))
    assert line(np.array([0.0, 86_400.0])) == pytest.approx([3.0, 6.456], abs=1e-5)
    assert spread == pytest.approx(1.96e-5, rel=0.05)


# On real LSL: a sender and a receiver, each a program; the loopback only

SENDER = """
import sys, time
import pylsl
eeg = pylsl.StreamOutlet(pylsl.StreamInfo("amp", "EEG", 3, 100.0, "float32", "amp-1"))
counts = pylsl.StreamOutlet(pylsl.StreamInfo("counter", "Counts", 1, 50.0, "int64", "counter-1"))
marks = pylsl.StreamOutlet(pylsl.StreamInfo("cues", "Markers", 1, 0, "string", "cues-1"))
began, first = time.monotonic(), pylsl.local_clock()
for number in range(100000):
    time.sleep(max(0.0, began + number / 100 - time.monotonic()))
    # A device samples in time, also where its program waits for the processor.
    eeg.push_sample([number, -1.5, time.monotonic() - began], first + number / 100)
    if number % 2 == 0:
        counts.push_sample([2**60 + number], first + number / 100)
    if number % 30 == 0:
        marks.push_sample([f"{time.monotonic()!r} é"])
"""
RECEIVER = """
import json, sys, time
from pathlib import Path
from haploop.base.clock import RealClock
from haploop.base.errors import InstrumentError
from haploop.instruments.streams import LslStreams
inlets = {"eeg": {"type": "EEG"}, "counts": {"name": "counter"}, "marks": {"source_id": "cues-1"}}
clock = RealClock()
streams = LslStreams.open(LslStreams.Settings.model_validate({"inlets": inlets}), clock)
for _ in range(20):
    try:
        streams.start(Path(sys.argv[1]), clock)
        break
    except InstrumentError:  # the sender's program begins
        pass
began, told = time.monotonic(), []
print("connected", flush=True)
for line in sys.stdin:  # one request a line
    try:
        told += [str(read) for read in streams.read()]
    except InstrumentError as error:
        told.append(str(error))
    print(len(told), flush=True)
    if line == "end\\n":
        break
left = streams.stop()
said = {"began": began, "ended": time.monotonic(), "told": told, "left": [str(one) for one in left],
        "files": [one.path.name for one in left if hasattr(one, "path")]}
print(json.dumps(said), flush=True)
"""


def test_real_streams_are_received_with_their_clock_and_lost_ones_told(tmp_path):
    pytest.importorskip("pylsl", reason='pylsl is not installed: python -m pip install -e ".[lsl]"')
    environment = loopback(tmp_path)
    processes = []

    def start(*words: str) -> subprocess.Popen[str]:
        pipe, command = subprocess.PIPE, (sys.executable, *words)
        processes.append(subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe, text=True))
        return processes[-1]

    try:
        sender = start("-c", SENDER)
        receiver = start("-c", RECEIVER, str(tmp_path / "P01-latch"))
        assert receiver.stdout.readline() == "connected\n"

        def read(count: int, line: str = "read") -> int:
            said = 0
            for _ in range(count):
                time.sleep(0.25)
                receiver.stdin.write(line + "\n")
                receiver.stdin.flush()
                said = int(receiver.stdout.readline())
            return said

        assert read(12) == 0
        sender.kill()
        sender.wait()
        assert read(4) > 0
        start("-c", SENDER)
        read(16)
        read(1, "end")
        said = json.loads(receiver.stdout.readline())
    finally:
        for process in processes:
            process.kill()
            process.communicate()
    assert any("The stream eeg was lost" in text for text in said["told"])

    # A recording at 1000 samples/s, whose blocks came 50 ms each.
    count = int((said["ended"] - said["began"]) / 0.05)
    blocks = np.zeros(count, BLOCK)
    blocks["first"], blocks["count"] = 50 * np.arange(count), 50
    blocks["time"] = said["began"] + 0.05 * (np.arange(count) + 1)

    def along(name: str) -> AlongFile:
        sha256 = hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()
        return AlongFile(0, "streams", name.rpartition("-")[2].removesuffix(".xdf"), name, sha256)

    found = read_streams(tmp_path, tuple(map(along, said["files"])), blocks, 1000.0)
    eeg, counts, marks = found["eeg"], found["counts"], found["marks"]
    # Both programs have this computer's one clock: its stamps must come back as they were.
    assert np.abs(eeg.times - (eeg.stamps - said["began"])).max() < 3e-3
    texts = [text for (text,) in marks.values]
    assert all(text.endswith(" é") for text in texts)
    sent = np.array([float(text.removesuffix(" é")) for text in texts]) - said["began"]
    assert np.abs(marks.times - sent).max() < 0.02
    # Every sample and number as it was sent, but for those between the two programs.
    assert eeg.values.dtype == np.float32 and set(eeg.values[:, 1]) == {-1.5}
    assert counts.values.dtype == np.int64 and counts.values.min() >= 2**60
    steps = np.diff(eeg.values[:, 0])
    assert np.count_nonzero(steps != 1) == 1 and len(eeg) > 400
    assert eeg.rate_hz == 100 and counts.rate_hz == 50 and marks.rate_hz == 0


FELT = """
import socket, sys, time
import numpy as np
def felt(t):  # N at a time: a press each 2.5 s, with a snap
    u = np.asarray(t) % 2.5
    rise = lambda begin, length: np.sin(np.pi / 2 * np.clip((u - begin) / length, 0, 1)) ** 2
    snap = np.clip((u - 0.45) / 0.01, 0, 1)
    return (6 * rise(0.2, 0.25) - 2.5 * snap + 4 * rise(0.47, 0.15)) * (1 - rise(0.8, 0.12))
"""
BOARD = """
server = socket.create_server(("127.0.0.1", 0))
print(server.getsockname()[1], flush=True)
rng = np.random.default_rng(1)
while True:
    link, sent, began = server.accept()[0], 0, time.monotonic()
    try:
        while True:
            time.sleep(0.004)
            numbers = np.arange(sent + 1, int((time.monotonic() - began) * 1000) + 1)
            sent += len(numbers)
            at = began + numbers / 1000
            force = 1000 * felt(at) + rng.normal(0, 5, len(at))
            click = 300 + 40 * np.exp(-((((at % 2.5) - 0.455) / 0.004) ** 2)) + rng.normal(0, 0.3, len(at))
            link.sendall("".join(f"{f:.1f},{a:.1f}\\n" for f, a in zip(force, click)).encode())
    except OSError:
        pass
"""
AMPLIFIER = """
import pylsl
outlet = pylsl.StreamOutlet(pylsl.StreamInfo("amp", "EEG", 2, 200.0, "float32", "amp-1"))
began = time.monotonic()
for number in range(100000):
    time.sleep(max(0.0, began + number / 200 - time.monotonic()))
    outlet.push_sample([float(felt(time.monotonic())), number])
"""


def test_a_board_and_an_amplifier_agree_on_the_time_of_a_press(tmp_path):
    """Nothing of haploop is simulated: a board on a socket, LSL, real clocks. Both feel one finger."""
    pytest.importorskip("pylsl", reason='pylsl is not installed: python -m pip install -e ".[lsl]"')
    environment, pipe = loopback(tmp_path), subprocess.PIPE
    processes = [
        subprocess.Popen([sys.executable, "-c", FELT + text], env=environment, stdout=pipe, text=True)
        for text in (BOARD, AMPLIFIER)
    ]
    try:
        port = int(processes[0].stdout.readline())
        streams = '[streams]\ndriver = "lsl"\n[streams.inlets.eeg]\ntype = "EEG"\n'
        daq = f'[daq]\nport = "socket://127.0.0.1:{port}"\n'
        lab = rig_file(tmp_path, text=f'base = "arduino"\nname = "lab"\n{daq}{streams}')
        words = f"-m haploop record latch -p P01 -n 3 --rig {lab} --out {tmp_path}".split()
        done = subprocess.run(
            [sys.executable, *words], env=environment, stdin=subprocess.DEVNULL, timeout=120, check=False
        )
        print(done)
    finally:
        for process in processes:
            process.kill()
            process.communicate()
    # Whether each press was accepted on a busy computer is not the point.
    recording = Recording.open(tmp_path / "P01-latch.h5")
    eeg = recording.streams["eeg"]
    assert not recording.simulated and errors(recording) == []
    assert set(np.diff(eeg.values[:, 1])) == {1.0}
    time_of = np.arange(len(recording)) / recording.rate_hz
    inside = (eeg.times > 0.5) & (eeg.times < time_of[-1] - 0.5)
    # The board sends what it has every 4 ms: by that, and by what a busy computer adds, its samples are late.
    assert -1e-3 < later(recording, eeg, inside, np.arange(-0.03, 0.03, 2e-4)) < 12e-3
