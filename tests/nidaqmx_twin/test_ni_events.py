"""Events of a task, beside what NI states of them: when they are registered, come and end.

T: a test of ni/nidaqmx-python's own suite.
"""

import threading
import time
from collections.abc import Iterator

import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import (
    Signal,
)

from haploop.nidaqmx_twin import NiTwin
from tests.nidaqmx_twin.ni_client import CONTINUOUS, clocked, code

CARDS = {"Dev1": "PCIe-6363", "M": "PCI-6221"}
ACQUIRED = "register_every_n_samples_acquired_into_buffer_event"


@pytest.fixture
def twin() -> Iterator[NiTwin]:
    with NiTwin(CARDS) as twin:
        yield twin


@pytest.fixture
def task(twin: NiTwin) -> Iterator[nidaqmx.Task]:
    with nidaqmx.Task() as task:
        yield task


@pytest.mark.parametrize("register", [ACQUIRED, "register_done_event", "register_signal_event"])
def test_events_are_registered_before_the_start(task, register):
    """NI's names of the codes; grpc-device, pull request 940."""
    first = {ACQUIRED: (100,), "register_signal_event": (Signal.SAMPLE_CLOCK,)}.get(register, ())
    clocked(task, "Dev1/ai0", 1000, sample_mode=CONTINUOUS)
    task.start()
    assert code(lambda: getattr(task, register)(*first, lambda *_: 0)) == -200960
    task.stop()
    getattr(task, register)(*first, lambda *_: 0)
    task.start()
    assert code(lambda: getattr(task, register)(*first, None)) == -200986
    task.stop()


def test_a_task_is_stopped_and_closed_in_its_callback(twin):
    """T test_task_events.py, call_stop_close_in_callback."""
    for which in ("done", "samples"):
        done, told = threading.Event(), []
        task = nidaqmx.Task()
        clocked(task, "Dev1/ai0", 1000, samps_per_chan=100)

        def close(*_, task=task, done=done, told=told):
            try:
                task.stop()
                task.close()
            except Exception as error:
                told.append(error)
            done.set()
            return 0

        if which == "done":
            task.register_done_event(close)
        else:
            getattr(task, ACQUIRED)(100, close)
        task.start()
        twin.sleep(1)
        assert done.wait(10) and not told


def test_the_end_waits_for_a_callback_in_flight(twin):
    began, read = threading.Event(), []

    def slow(*_):
        began.set()
        threading.Event().wait(0.2)
        read.append(len(task.read(100)))
        return 0

    with nidaqmx.Task() as task:
        clocked(task, "Dev1/ai0", 1000, samps_per_chan=100)
        getattr(task, ACQUIRED)(100, slow)
        task.start()
        threading.Thread(target=twin.sleep, args=(0.2,)).start()
        assert began.wait(10)
    assert read == [100]


@pytest.mark.parametrize(
    ("device", "size", "every", "right"),
    [
        ("Dev1", 1000, 2000, -200877),
        ("M", 1000, 102, -200877),
        ("M", 1000, 100, None),
        ("Dev1", 1000, 102, None),
    ],
)
def test_intervals_of_events_fit_the_buffer(task, device, size, every, right):
    """H "Software Events": 1,000 samples and 102 is an error on M Series with DMA, 100 is none."""
    clocked(task, f"{device}/ai0", 1000, sample_mode=CONTINUOUS)
    task.in_stream.input_buf_size = size
    getattr(task, ACQUIRED)(every, lambda *_: 0)
    assert code(task.start) == right


@pytest.mark.parametrize("kind", ["ai", "ao", "di", "do"])
def test_events_of_samples_need_a_buffer(task, kind):
    if kind[0] == "a":
        getattr(getattr(task, f"{kind}_channels"), f"add_{kind}_voltage_chan")(f"Dev1/{kind}0")
    else:
        getattr(getattr(task, f"{kind}_channels"), f"add_{kind}_chan")("Dev1/port0/line0")
    register = ACQUIRED if kind[1] == "i" else "register_every_n_samples_transferred_from_buffer_event"
    getattr(task, register)(100, lambda *_: 0)
    assert code(task.start) == -200848
    getattr(task, register)(100, None)
    assert code(task.start) is None


@pytest.mark.parametrize(
    ("signal", "rising", "falling", "events"),
    [
        (0, True, True, 0),
        (1, True, True, 0),
        (lambda times: (times > 0.5) * 1.0, True, True, 1),
        (lambda times: np.floor(10 * times) % 2, True, True, 9),
        (lambda times: np.floor(10 * times) % 2, True, False, 5),
    ],
)
def test_changes_are_detected_where_there_are_some(twin, signal, rising, falling, events):
    line, fired = "Dev1/port0/line0", []
    twin.set(line, signal)
    with nidaqmx.Task() as task:
        task.di_channels.add_di_chan(line)
        task.timing.cfg_change_detection_timing(line if rising else "", line if falling else "", CONTINUOUS)
        task.register_signal_event(Signal.CHANGE_DETECTION_EVENT, lambda *_: fired.append(1) or 0)
        task.start()
        time.sleep(0.98)
        assert task.in_stream.avail_samp_per_chan == events
        for _ in range(500):
            if len(fired) >= events:
                break
            threading.Event().wait(0.01)
        task.stop()
    assert len(fired) == events


def test_a_sample_is_taken_at_each_change(twin, task):
    twin.set("Dev1/port0/line0", lambda times: (np.sin(2 * np.pi * 5 * times) > 0) * 1.0)
    task.di_channels.add_di_chan("Dev1/port0/line0")
    task.timing.cfg_change_detection_timing("Dev1/port0/line0", "Dev1/port0/line0", samps_per_chan=10)
    began = twin.now
    assert task.read(10, timeout=10) in ([True, False] * 5, [False, True] * 5)
    assert twin.now - began == pytest.approx(1, abs=0.2)
