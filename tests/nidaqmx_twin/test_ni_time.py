"""Virtual time of a program under test: what moves it, and that a busy machine does not."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import nidaqmx
import pytest
from nidaqmx.constants import READ_ALL_AVAILABLE

from haploop.nidaqmx_twin import NiTwin
from tests.nidaqmx_twin.ni_client import CONTINUOUS, FINITE

ACQUIRED = "register_every_n_samples_acquired_into_buffer_event"


@contextmanager
def running(samples: int | None = None, size: int | None = None) -> Iterator[nidaqmx.Task]:
    """A task of 1 kHz, finite or not."""
    with nidaqmx.Task() as task:
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
        mode = FINITE if samples else CONTINUOUS
        task.timing.cfg_samp_clk_timing(1000, sample_mode=mode, samps_per_chan=samples or 1000)
        if size:
            task.in_stream.input_buf_size = size
        yield task


@pytest.fixture(params=["idle", "busy"])
def load(request: pytest.FixtureRequest) -> Iterator[None]:
    """Threads that keep this process from its work for most of the time."""
    stop = threading.Event()

    def burn() -> None:
        while not stop.is_set():
            sum(range(20_000))

    threads = [threading.Thread(target=burn) for _ in range(2 if request.param == "busy" else 0)]
    for thread in threads:
        thread.start()
    yield
    stop.set()
    for thread in threads:
        thread.join()


def test_a_sleep_gives_its_samples(nidaqmx_twin):
    with running() as task:
        task.start()
        for _ in range(5):
            time.sleep(0.1)
            sum(range(200_000))  # computing takes no time
        assert len(task.read(READ_ALL_AVAILABLE)) == 501, "one at the start, and 500 in 0.5 s"


def test_each_turn_of_a_loop_gives_the_same(nidaqmx_twin):
    with running() as task:
        task.start()
        turns = []
        for _ in range(6):
            time.sleep(0.09)
            turns.append(len(task.read(READ_ALL_AVAILABLE)))
    assert set(turns[1:]) <= {90, 91} and sum(turns) == pytest.approx(541, abs=2)


def test_a_deadline_of_the_program_comes_in_virtual_time(nidaqmx_twin):
    for clock in (time.monotonic, time.time, time.perf_counter, lambda: time.monotonic_ns() / 1e9):
        began, reads = nidaqmx_twin.now, 0
        with running() as task:
            task.start()
            deadline = clock() + 3
            while clock() < deadline:
                task.read(100)
                reads += 1
        assert reads in (30, 31) and nidaqmx_twin.now - began == pytest.approx(3, abs=0.15)
    slept = time.time()
    while time.time() < slept + 0.5:
        pass
    assert nidaqmx_twin.now - began == pytest.approx(3.5, abs=0.2)


@pytest.mark.parametrize("way", ["sleep", "wait_until_done", "read"])
def test_every_event_is_handled_when_it_happens(nidaqmx_twin, load, way):
    """A buffer of one interval overruns at once where a callback comes late."""
    when: list[float] = []
    with running(1000, 1000) as task:

        def on(*_):
            threading.Event().wait(0.005)  # a callback takes its time, and none of the card's
            when.append(nidaqmx_twin.now)
            return 0

        getattr(task, ACQUIRED)(100, on)
        began = nidaqmx_twin.now
        task.start()
        if way == "sleep":
            time.sleep(1)
        elif way == "read":
            task.read(1000)
        else:
            task.wait_until_done(5)
    assert [at - began for at in when] == pytest.approx([0.1 * k for k in range(1, 11)], abs=2e-3)


def test_a_small_buffer_is_read_in_time(nidaqmx_twin, load):
    got: list[int] = []
    with running(size=200) as task:
        getattr(task, ACQUIRED)(100, lambda *_: got.append(len(task.read(100))) or 0)
        task.start()
        time.sleep(1.05)
        task.stop()
    assert got == [100] * 10


def test_clocks_are_real_again_afterwards_and_in_the_standard_library():
    before = time.monotonic, time.sleep, time.time
    with NiTwin({"Dev1": "PCIe-6363"}):
        assert time.monotonic is not before[0]
        assert not threading.Event().wait(0.01)
    assert (time.monotonic, time.sleep, time.time) == before
