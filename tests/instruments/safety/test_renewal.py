"""A relay is renewed by a thread of its own while a play is alive, and no longer."""

import threading
import time
from types import SimpleNamespace
from typing import Any

import pytest

from haploop.base.clock import RealClock, VirtualClock
from haploop.base.errors import InstrumentError
from haploop.instruments.safety import Renewal
from haploop.instruments.safety.deadline import Watch
from tests.raising import raising

DEAD_MAN = 0.4


class Box:
    """Opens by itself when it is not renewed in time."""

    dead_man = DEAD_MAN

    def __init__(self) -> None:
        self.renewed: list[float] = [time.monotonic()]
        self.threads: set[int] = set()

    def renew(self) -> None:
        self.threads.add(threading.get_ident())
        self.renewed.append(time.monotonic())


def test_a_block_that_is_late_ends_no_play_and_one_that_never_comes_ends_it():
    box: Any = Box()
    renewal = Renewal(box, RealClock())
    with renewal.running():
        for _ in range(3):
            time.sleep(0.45 * DEAD_MAN)  # far beyond a block, and within what is alive
            renewal.alive()
        last, seen = len(box.renewed), time.monotonic()
        assert last >= 4 and threading.get_ident() not in box.threads
        time.sleep(1.5 * DEAD_MAN)  # the play hangs
        assert box.renewed[-1] - seen <= 0.5 * DEAD_MAN + 0.2, "beyond, the box opens by itself"
        count = len(box.renewed)
        renewal.alive()
        time.sleep(0.5 * DEAD_MAN)
        assert len(box.renewed) > count, "a play that comes back is renewed again"
    count = len(box.renewed)
    time.sleep(0.5 * DEAD_MAN)
    assert len(box.renewed) == count, "nor is anything renewed after it"


def test_what_a_renewal_finds_ends_the_play():
    opened = raising(InstrumentError("channel 1 reads open"))
    renewal = Renewal(SimpleNamespace(dead_man=0.05, renew=opened), RealClock())
    with renewal.running(), pytest.raises(InstrumentError, match="reads open"):
        for _ in range(200):
            time.sleep(0.01)
            renewal.alive()


def test_in_virtual_time_each_block_renews():
    box: Any = Box()
    renewal = Renewal(box, VirtualClock())
    with renewal.running():
        for _ in range(3):
            renewal.alive()
    assert len(box.renewed) == 4 and box.threads == {threading.get_ident()}


def test_a_closed_contact_is_looked_at_until_the_end_whatever_is_found():
    """A contact that was told to open may be welded: who takes its output again is found again."""
    looks: list[float] = []

    def look() -> None:
        looks.append(time.monotonic())
        if len(looks) == 2:
            raise InstrumentError("8 V stand on an output")

    watch = Watch(RealClock(), look)
    watch.begin()
    while len(looks) < 2:
        time.sleep(0.01)
    while len(looks) < 4:
        time.sleep(0.01)
    watch.end()
    watch.end()
    seen = len(looks)
    time.sleep(0.5)
    assert len(looks) == seen and not watch.on
