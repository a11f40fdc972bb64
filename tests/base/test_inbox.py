"""Items from other threads arrive in order, wake who waits, and keep nobody waiting."""

import threading
import time

import pytest

from haploop.base.threads import Inbox


def test_items_come_in_order_and_the_oldest_gives_way():
    inbox: Inbox[int] = Inbox(3)
    for item in range(5):
        inbox.put(item)
    assert len(inbox) == 3 and list(inbox) == [2, 3, 4] and inbox.head() == 2
    assert [inbox.take() for _ in range(3)] == [2, 3, 4]
    for missing in (inbox.take, inbox.head):
        with pytest.raises(IndexError):
            missing()


def test_a_wait_ends_with_an_item_with_the_end_and_after_its_time():
    inbox: Inbox[None] = Inbox()
    for seconds, longest in ((0.0, 0.05), (0.03, 0.09), (10.0, 0.4)):
        begun = time.monotonic()
        assert not inbox.wait(seconds)
        assert time.monotonic() - begun < longest
    inbox.put(None)
    inbox.end()
    assert inbox.wait() and inbox.ended, "what was there can still be taken"
    inbox.take()
    begun = time.monotonic()
    assert not inbox.wait(10)
    assert time.monotonic() - begun < 0.05


def test_an_item_that_comes_between_two_steps_of_a_wait_ends_it(monkeypatch):
    inbox: Inbox[int] = Inbox()
    clear = inbox._changed.clear
    monkeypatch.setattr(inbox._changed, "clear", lambda: (inbox.put(1), clear()))
    begun = time.monotonic()
    assert inbox.wait()
    assert time.monotonic() - begun < 0.05


def test_nothing_is_lost_between_threads():
    inbox: Inbox[int] = Inbox()
    count = 3000

    def give() -> None:
        for number in range(count):
            inbox.put(number)
            if number % 7 == 0:
                time.sleep(0)
        inbox.end()

    threading.Thread(target=give, daemon=True).start()
    seen = []
    while not inbox.ended or len(inbox):
        if inbox.wait():
            seen.append(inbox.take())
    assert seen == list(range(count))
