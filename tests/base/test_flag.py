"""A flag between threads works after an interrupt at any instruction of whoever uses it; so does an inbox."""

import sys
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

import pytest

from haploop.base.threads import Flag, Inbox

LONG = 5.0
"""s: whoever waits so long hangs."""


def torn(step: Callable[[], object], at: int) -> bool:
    """Interrupt a step at one of its instructions, and those that it calls; False where it has less."""
    left = at

    def trace(frame: FrameType, event: str, _argument: Any) -> Any:
        nonlocal left
        frame.f_trace_opcodes = True
        if event == "opcode":
            left -= 1
            if left == 0:
                raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        step()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False


def within(step: Callable[[], object]) -> object:
    """What a step returns in another thread, which must not hang."""
    results: list[object] = []
    thread = threading.Thread(target=lambda: results.append(step()), daemon=True)
    thread.start()
    thread.join(LONG)
    assert results, "it hangs"
    return results[0]


@pytest.mark.parametrize(
    "step", [Flag.set, Flag.clear, lambda flag: flag.wait(0.01)], ids=["set", "clear", "wait"]
)
@pytest.mark.parametrize("up", [True, False])
def test_an_interrupt_anywhere_leaves_a_flag_usable(step, up):
    at = 1
    while True:
        flag = Flag()
        if up:
            flag.set()
        if not torn(lambda: step(flag), at):  # noqa: B023  called at once
            break
        for _ in range(2):
            within(flag.set)
            assert within(lambda: flag.wait(LONG)) and flag.wait(LONG)  # noqa: B023
            within(flag.clear)
            assert not within(lambda: flag.wait(0.0)) and not flag.is_set()  # noqa: B023
        at += 1
    assert at > 5, "it was interrupted"


@pytest.mark.parametrize("step", [
    lambda inbox: inbox.put(0), Inbox.end, lambda inbox: inbox.wait(0.01),
], ids=["put", "end", "wait"])  # fmt: skip
def test_an_interrupt_at_any_instruction_leaves_an_inbox_usable(step):
    at = 1
    while True:
        inbox: Inbox[int] = Inbox()
        if not torn(lambda: step(inbox), at):  # noqa: B023
            break
        within(lambda: inbox.put(1))  # noqa: B023
        assert within(inbox.wait) and inbox.wait()
        within(inbox.end)
        assert inbox.ended
        at += 1
    assert at > 5, "it was interrupted"


def test_all_who_wait_go_on_and_a_wait_ends_after_its_time():
    flag, gone_on = Flag(), []
    waiting = [threading.Thread(target=lambda: gone_on.append(flag.wait(LONG))) for _ in range(5)]
    for thread in waiting:
        thread.start()
    begun = time.monotonic()
    assert not flag.wait(0.15)
    assert 0.14 < time.monotonic() - begun < 1.0
    flag.set()
    flag.set()
    for thread in waiting:
        thread.join(LONG)
    assert gone_on == [True] * 5
    assert time.monotonic() - begun < LONG
    flag.clear()
    flag.clear()
    assert not flag.wait(0.01)
