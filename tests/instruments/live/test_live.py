"""Taps and publishing: whatever a viewer does, a recording has every sample and waits for nobody."""

import json
import os
import signal
import socket
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haploop.acquisition import record
from haploop.base.clock import Clock
from haploop.base.errors import ConfigurationError, DataError, InstrumentError
from haploop.instruments import Block, load_rig_file, watch_live
from haploop.instruments.live import Feed, LiveBlock, Publisher, Run, Tap, levels
from haploop.instruments.live.publisher import PREFIX, frame_of, header_of, lengths_of, volts_of
from haploop.instruments.sensors import Sensors
from tests.raising import raises
from tests.rig_files import changed

FILE = load_rig_file("simulated")
RUN = Run("simulated", True, "record", "P01-latch.h5", ("a", "b"), 1000.0, Sensors(), None)
BIG = 200_000
"""Samples of a block that no socket buffer takes whole: 3.2 MB."""


def _block(first: int, samples: int = 10) -> Block:
    return Block(first, np.full((2, samples), float(first)), np.array([False, True]))


def _big(number: int) -> Block:
    return Block(number * BIG, np.zeros((2, BIG)), np.zeros(2, dtype=bool))


class _Steps(Clock):
    """A clock on which each look costs a second."""

    seconds = 0.0

    def now(self) -> float:
        self.seconds += 1.0
        return self.seconds

    def sleep(self, duration: float) -> None: ...

    def hold(self, until: Callable[[], object]) -> None: ...


@pytest.fixture
def feed() -> Iterator[Feed]:
    feed = Feed()
    yield feed
    feed.close()


@pytest.fixture
def publisher(feed: Feed, tmp_path: Path) -> Iterator[Publisher]:
    with Publisher(feed, "simulated", tmp_path) as publisher:
        yield publisher


def _token(publisher: Publisher) -> bytes:
    return str(json.loads(publisher.path.read_text(encoding="utf-8"))["token"]).encode()


def _link(publisher: Publisher, greeting: bytes) -> socket.socket:
    link = socket.create_connection(("127.0.0.1", publisher.port), timeout=10)
    link.sendall(greeting)
    return link


def _until(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.002)


def _watched(feed: Feed) -> bool:
    """Whether a client has been admitted."""
    return bool(feed._taps)


def test_the_newest_win_and_the_others_are_counted(feed):
    tap, publish = feed.tap(3), feed.begin(RUN)
    for number in range(10):
        publish(_block(10 * number))
    assert tap.dropped == 7
    taken = tap.take(0)
    assert taken is not None and (taken.first, taken.end, taken.run.number) == (70, 80, 1)
    newest = tap.latest()
    assert newest is not None and newest.first == 90
    assert tap.dropped == 8 and tap.latest() is None and tap.take(0) is None


def test_viewers_cannot_change_what_the_writer_has(feed):
    tap, block = feed.tap(), _block(0)
    feed.begin(RUN)(block)
    taken = tap.take(0)
    for array in (taken.volts, taken.overload):
        with pytest.raises(ValueError, match="read-only"):
            array[..., 0] = 1
    block.volts[0, 0] = 0.0  # its owner still can


def test_waiting_ends_by_the_clock_by_a_block_and_by_the_end(feed):
    clock = _Steps()
    assert Tap(1, clock).take(5.0) is None
    assert clock.seconds <= 8.0
    tap, publish = feed.tap(), feed.begin(RUN)
    threading.Timer(0.02, publish, (_block(0),)).start()
    assert tap.take(20.0) is not None
    threading.Timer(0.02, feed.close).start()
    assert list(tap) == []
    assert feed.tap().closed


def test_a_closed_tap_is_forgotten(feed):
    with feed.tap() as tap:
        pass
    feed.begin(RUN)(_block(0))
    assert tap.take(0) is None
    assert not feed._taps


def test_a_tap_without_room_is_refused(feed):
    raises(ValueError, "1 block", feed.tap, 0)


def test_a_recording_and_a_play_are_tapped_and_not_changed(open_rig, tmp_path):
    with open_rig() as rig:
        plain = record(rig, "latch", "P01", 1, tmp_path / "plain")
    rig = open_rig()
    tap, ignored = rig.tap(100_000), rig.tap(2)
    recording = record(rig, "latch", "P01", 1, tmp_path / "tapped")
    blocks = list(iter(lambda: tap.take(0), None))
    assert all(block.run == blocks[0].run for block in blocks)
    run = blocks[0].run
    assert (run.rig, run.simulated, run.doing) == (rig.name, rig.simulated, "record")
    assert run.about == str(tmp_path / "tapped" / "P01-latch.h5")
    assert (run.channels, run.rate_hz) == (recording.channels, recording.rate_hz)
    volts = np.concatenate([block.volts for block in blocks], axis=1)
    assert blocks[0].first == 0
    assert volts.shape == recording.volts.shape
    np.testing.assert_allclose(volts, recording.volts, atol=2e-3)
    assert tap.dropped == 0
    assert ignored.dropped == len(blocks) - 2
    if rig.simulation is not None and rig.mode == "twin":
        np.testing.assert_array_equal(plain.volts, recording.volts)

    capture = rig.excite(np.zeros(500), ["A"], ["laser"])
    played = tap.take(0)
    assert (played.run.doing, played.run.about, played.run.number) == ("play", "patch A", 2)
    row = played.run.channels.index("laser")
    np.testing.assert_array_equal(played.volts[row], capture.volts[0, : played.end])
    velocity = next(level for level in levels(played) if level.name == "velocity")
    assert velocity.rms == pytest.approx(float(np.std(rig.vibrometer.scale * played.volts[row])))


@pytest.mark.requires("simulation")
def test_levels_are_in_si(open_rig, tmp_path):
    rig = open_rig()
    tap = rig.tap(100_000)
    recording = record(rig, "latch", "P01", 1, tmp_path)
    found = [{level.name: level for level in levels(block)} for block in iter(lambda: tap.take(0), None)]
    assert found[0]["acceleration z"].unit == "m/s^2"
    assert found[0]["acceleration z"].mean == pytest.approx(9.8, abs=1.5)
    pressed = max(each["Fz"].mean for each in found) - found[0]["Fz"].mean
    assert pressed == pytest.approx(recording.force.max(), rel=0.1)
    assert {each["activation"].mean for each in found} >= {0.0, 1.0}


def test_a_closed_rig_ends_its_views(open_rig):
    rig = open_rig()
    tap = rig.tap()
    rig.close()
    assert tap.take() is None


def test_another_program_gets_the_blocks(feed, publisher):
    with watch_live(FILE, address=publisher.path) as tap:
        _until(lambda: _watched(feed))
        publish = feed.begin(RUN)
        for number in range(5):
            publish(_block(10 * number))
            block = tap.take(10)
            assert block is not None and block.first == 10 * number
            run = block.run
            assert (run.channels, run.simulated, run.about) == (("a", "b"), True, "P01-latch.h5")
            np.testing.assert_array_equal(block.volts, _block(10 * number).volts)
            assert block.overload.tolist() == [False, True]
        feed.close()
        assert tap.take(10) is None
        assert tap.dropped == 0


def test_a_client_that_does_not_read_is_told_what_it_missed(feed, publisher):
    link = _link(publisher, _token(publisher))
    with link, watch_live(FILE, address=publisher.path, capacity=1000) as other:
        _until(lambda: len(feed._taps) == 2)
        publish, slowest = feed.begin(RUN), 0.0
        for number in range(200):
            block, began = _big(number), time.perf_counter()
            publish(block)
            slowest = max(slowest, time.perf_counter() - began)
        # Whoever waited for the client would still be waiting.
        assert slowest < 5.0
        # Every block has either arrived at the other client or been counted.
        arrived = 0
        while (seen := other.take(10)) is not None:
            arrived += 1
            if seen.first == 199 * BIG:
                break
        # A block is counted after it is in, so that the last one may be taken before.
        _until(lambda: arrived + other.dropped == 200)
        # The one that did not read catches up with the newest; the count is complete.
        total, last = 0, -1
        while last != 199 * BIG:
            sizes = lengths_of(_exactly(link, PREFIX))
            header, _run = header_of(_exactly(link, sizes[0]))
            _exactly(link, sizes[1])
            total += 1 + int(header["dropped"])
            last = int(header["first"])
        assert total == 200
        assert int(header["dropped"]) + total > 100


def _exactly(link: socket.socket, count: int) -> bytes:
    found = b""
    while len(found) < count:
        part = link.recv(min(1 << 20, count - len(found)))
        assert part
        found += part
    return found


@pytest.mark.parametrize("kind", ["nothing", "noise", "half", "another token", "token and noise"])
def test_a_client_that_talks_nonsense_gets_nothing(feed, publisher, kind):
    token = _token(publisher)
    greeting = {
        "nothing": b"",
        "noise": bytes(range(256)) * 4000,
        "half": token[:30],
        "another token": token[::-1],
        "token and noise": token + bytes(5000),
    }[kind]
    link = socket.create_connection(("127.0.0.1", publisher.port), timeout=10)
    with link, watch_live(FILE, address=publisher.path) as tap:
        _until(lambda: _watched(feed))
        try:
            link.sendall(greeting)
            said = link.recv(1)
        except (ConnectionError, TimeoutError):
            said = b""
        assert said == b""
        feed.begin(RUN)(_block(0))
        assert tap.take(10) is not None


def test_many_clients_do_not_pile_up(feed, publisher):
    links = [_link(publisher, _token(publisher)) for _ in range(20)]
    try:
        _until(lambda: len(feed._taps) == 8)
        assert len(publisher._clients) == 8
    finally:
        for link in links:
            link.close()
    # Those that have gone make room.
    _until(lambda: not feed._taps)
    with watch_live(FILE, address=publisher.path):
        _until(lambda: _watched(feed))


def test_only_the_owner_can_read_the_token(publisher):
    assert publisher._listener.getsockname()[0] == "127.0.0.1"
    if os.name != "nt":
        assert stat.S_IMODE(publisher.path.stat().st_mode) == 0o600
    publisher.close()
    assert not publisher.path.exists()
    assert list(publisher.path.parent.iterdir()) == []
    publisher.close()


def test_closing_ends_clients_that_do_not_read(feed, publisher):
    with _link(publisher, _token(publisher)):
        _until(lambda: _watched(feed))
        publish = feed.begin(RUN)
        for number in range(40):
            publish(_big(number))
        began = time.monotonic()
        publisher.close()
        assert time.monotonic() - began < 5.0
        _until(lambda: not feed._taps)


def test_where_nobody_listens_is_said(tmp_path, feed, publisher):
    raises(ConfigurationError, "No running program publishes the rig 'simulated'", watch_live, FILE)
    # Left by a program that was killed: it is removed.
    left = tmp_path / "live-1-dead.json"
    with socket.create_server(("127.0.0.1", 0)) as free:
        killed = json.dumps({"rig": "simulated", "port": free.getsockname()[1], "token": "0" * 64})
    for text in (killed, "", "[]", "{}", '{"rig": "simulated", "port": 99999, "token": "x"}', "\x00"):
        left.write_text(text, encoding="utf-8")
        raises(ConfigurationError, "No running program", watch_live, FILE, address=left)
        assert text != killed or not left.exists()


def test_the_running_program_is_found_by_the_rig_name(open_rig):
    rig = open_rig()
    with rig.publish_live(), watch_live(rig.file, rig.mode) as tap:
        _until(lambda: _watched(rig._feed))
        rig.live_run("record", "here", ["a", "b"], 10.0)(_block(0))
        block = tap.take(10)
        assert block is not None and block.run.about == "here"
        raises(ConfigurationError, "'another'", watch_live, changed(rig.file, name="another"), rig.mode)


def test_what_cannot_be_published_is_one_error(feed, tmp_path):
    raises(InstrumentError, "No live view", Publisher, feed, "simulated", tmp_path / "missing")


STOPPED = """
import sys
from haploop.instruments import watch_live
with watch_live("simulated", address=sys.argv[1]) as tap:
    for block in tap:
        print(block.first, flush=True)
"""


@pytest.mark.skipif(os.name == "nt", reason="Windows has no signal that stops a process")
def test_a_recording_does_not_wait_for_a_stopped_viewer(open_rig, tmp_path):
    rig = open_rig()
    with rig.publish_live() as publisher:
        command = [sys.executable, "-c", STOPPED, str(publisher.path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
            try:
                _until(lambda: _watched(rig._feed))
                process.send_signal(signal.SIGSTOP)
                recording = record(rig, "latch", "P01", 1, tmp_path / "stopped")
                assert recording.complete
                process.kill()
                assert record(rig, "latch", "P01", 1, tmp_path / "killed").complete
            finally:
                process.kill()


@given(st.binary(max_size=300))
def test_noise_is_refused_as_no_block(noise):
    raises(DataError, "no block", header_of, noise)
    if len(noise) >= PREFIX:
        raises(DataError, "no block", lengths_of, noise[:PREFIX])


@given(st.data())
def test_a_header_with_something_else_in_it_is_a_data_error_or_a_block(data):
    frame, volts = frame_of(LiveBlock(RUN, 0, _block(0).volts, _block(0).overload), 3)
    header = json.loads(frame[PREFIX:])
    key = data.draw(st.sampled_from(sorted(header)))
    junk = st.none() | st.integers() | st.floats() | st.text(max_size=5) | st.lists(st.integers(), max_size=3)
    header[key] = data.draw(junk)
    try:
        found, run = header_of(json.dumps(header).encode())
        block = volts_of(found, run, bytes(volts))
    except DataError:
        return
    assert block.volts.shape == (2, 10)


def test_a_frame_is_read_as_it_was_written():
    run = Run("r", False, "play", "patch A", ("a", "b"), 50e3, FILE.sensors, ("a", 0.005, "velocity"), 7)
    block = LiveBlock(run, 5, np.random.default_rng(0).normal(size=(2, 9)), np.array([True, False]))
    frame, volts = frame_of(block, 3)
    sizes = lengths_of(frame[:PREFIX])
    assert sizes == (len(frame) - PREFIX, len(volts))
    header, again = header_of(frame[PREFIX:])
    assert (again, header["dropped"]) == (run, 3)
    np.testing.assert_array_equal(volts_of(header, again, bytes(volts)).volts, block.volts)
    raises(DataError, "no block", volts_of, header, again, bytes(volts)[:-8])


def test_a_publisher_that_talks_nonsense_is_a_data_error(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as server:
        path = tmp_path / "live-1-evil.json"
        content = {"rig": "simulated", "port": server.getsockname()[1], "token": "0" * 64}
        path.write_text(json.dumps(content), encoding="utf-8")
        with watch_live(FILE, address=path) as tap:
            link, _ = server.accept()
            with link:
                link.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")
                raises(DataError, "no block", tap.take, 10)
