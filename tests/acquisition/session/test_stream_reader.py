import threading

import numpy as np
import pytest

from haploop.acquisition.session.recorder import GapError, OverrunError, StreamReader
from haploop.base.clock import Clock, VirtualClock
from haploop.base.errors import InstrumentError
from haploop.instruments import Block, Stream


class Script(Stream):
    """Blocks with the given first indices; an exception in the list is raised."""

    channels = ("a",)
    rate_hz = 100.0

    def __init__(self, items, clock=None):
        self.items, self.clock, self.ended = items, clock, threading.Event()

    def __iter__(self):
        try:
            for item in self.items:
                if isinstance(item, Exception):
                    raise item
                if self.clock:
                    self.clock.sleep_until((item + 10) / self.rate_hz)
                yield Block(item, np.full((1, 10), float(item)), np.zeros(1, dtype=bool))
        finally:
            self.ended.set()

    def close(self):
        pass


class RealTime(Clock):
    """A clock that cannot be held, like the real one."""

    def now(self):
        return 0.0

    def sleep(self, duration):
        raise AssertionError("a reader does not sleep")

    def hold(self, until):
        pass


def test_blocks_come_in_order_and_virtual_time_stands_still_while_one_is_handled():
    clock = VirtualClock()
    stream = Script(range(0, 500, 10), clock)
    firsts = []
    with StreamReader(stream, clock) as reader:
        for block in reader:
            assert clock.now() == block.end / 100.0
            firsts.append(block.first)
    assert firsts == list(range(0, 500, 10))


def test_a_full_queue_stops_with_an_error_after_the_blocks_that_fit():
    stream = Script(range(0, 100, 10))
    firsts = []
    with StreamReader(stream, RealTime(), depth=3) as reader:
        assert stream.ended.wait(10)
        assert reader.waiting == 4  # and the error behind them
        with pytest.raises(OverrunError, match="fell behind: 3 blocks"):
            for block in reader:
                firsts.append(block.first)
    assert firsts == [0, 10, 20]


def test_a_gap_is_an_error_and_the_block_behind_it_is_not_handed_out():
    firsts = []
    with StreamReader(Script([0, 10, 40, 50]), VirtualClock()) as reader:
        with pytest.raises(GapError, match="Samples 20 to 39 were lost"):
            for block in reader:
                firsts.append(block.first)
        reader.stop()
        assert list(reader.left()) == []
    assert firsts == [0, 10]


def test_an_error_of_the_driver_reaches_the_consumer_after_all_blocks():
    firsts = []
    stream = Script([0, 10, InstrumentError("The card has gone.")])
    with StreamReader(stream, RealTime()) as reader, pytest.raises(InstrumentError, match="card has gone"):
        for block in reader:
            firsts.append(block.first)
    assert firsts == [0, 10]


def test_what_an_interrupt_left_unhandled_is_handed_out_again():
    stream = Script(range(0, 50, 10))
    with StreamReader(stream, RealTime()) as reader:
        assert stream.ended.wait(10)
        for block in reader:
            if block.first == 20:
                break  # as if Ctrl-C came while this one was being handled
        reader.stop()
        assert [b.first for b in reader.left()] == [20, 30, 40]


def test_leaving_early_ends_the_thread():
    clock = VirtualClock()
    with StreamReader(Script(range(0, 10**9, 10), clock), clock) as reader:
        next(iter(reader))
    assert not any(t.name == "haploop-reader" for t in threading.enumerate())


@pytest.mark.parametrize("second", [9, 11])
def test_a_single_sample_that_is_lost_or_comes_twice_is_a_gap(second):
    firsts = []
    says = f"expected at sample 10 and begins at {second}"
    with StreamReader(Script([0, second]), VirtualClock()) as reader, pytest.raises(GapError, match=says):
        for block in reader:
            firsts.append(block.first)
    assert firsts == [0]
