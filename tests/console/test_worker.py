"""The worker on a simulated rig: what its commands do, and the ways from STOP to the safe state."""

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import SimpleNamespace
from typing import Any

import pytest

from haploop.acquisition import Recording
from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.base.threads import Flag
from haploop.console.data_folder import DataFolder
from haploop.console.worker import jobs, stopping
from haploop.console.worker import worker as workers
from haploop.console.worker.board import Board
from haploop.console.worker.job import Job
from haploop.console.worker.page_operator import PageOperator
from haploop.console.worker.worker import Worker
from haploop.instruments import load_rig_file, open_rig
from haploop.instruments.operator import ConfirmSettings
from haploop.mocks.people import OperatorTwin
from haploop.reports.contents.recording import recording_contents
from tests.raising import raises

DEADLINE = 60.0


def until(what: Callable[[], object], seconds: float = DEADLINE) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "It did not come."
        time.sleep(0.01)


def made(tmp_path, real_time: bool = False) -> Worker:
    return Worker(
        load_rig_file("simulated"), None, DataFolder(tmp_path, tmp_path / "history"), real_time=real_time
    )


@contextmanager
def pages(worker: Worker, do: Callable[[], object]) -> Iterator[None]:
    """Runs the worker in this thread, which has to be the main one, and `do` in another."""
    problems: list[BaseException] = []

    def act() -> None:
        try:
            do()
        except BaseException as error:
            problems.append(error)
        finally:
            worker.end()

    thread = threading.Thread(target=act)
    thread.start()
    worker.run()
    thread.join()
    yield
    if problems:
        raise problems[0]


def stopped(
    worker: Worker, kind: str, when: threading.Event, then: Callable[[], object] = lambda: None
) -> Any:
    """What STOP says in a job that has begun when an event is set, and what is done `then`."""
    told: list[Any] = []

    def operator() -> None:
        begin(worker, kind)
        until(when.is_set)
        told.append(worker.stop())
        then()

    with pages(worker, operator):
        return told[0]


def ended(worker: Worker) -> bool:
    return worker.board["job"]["state"] not in ("waiting", "running")


def begin(worker: Worker, kind: str, **parameters: object) -> None:
    worker.command("start", {"kind": kind, "parameters": parameters})


def test_a_session_with_a_rejection_a_note_and_a_pause(tmp_path):
    worker = made(tmp_path, real_time=True)
    board = worker.board

    def operator():
        with pytest.raises(ConfigurationError, match="preflight is not green"):
            begin(worker, "record", button="toggle", participant="P01", presses=3)
        worker.command("override", {"reason": "a test"})
        worker.command("auto", {"on": False})
        begin(worker, "record", button="toggle", participant="P01", presses=3)
        with pytest.raises(ConfigurationError, match="busy"):
            begin(worker, "record", button="toggle", participant="P02", presses=3)
        for count in (1, 2):
            until(lambda count=count: board["request"] and board["request"].get("press") == count)
            with suppress(ConfigurationError):
                worker.command("press", {})
            until(lambda count=count: len(board["session"]["verdicts"]) == count)
        last = board["session"]["verdicts"][-1]
        worker.command("reject", last)
        until(lambda: not board["session"]["verdicts"][-1]["accepted"])
        with pytest.raises(ConfigurationError, match="not accepted"):
            worker.command("reject", last)  # the other tab's
        worker.command("pause", {"on": True})
        worker.command("note", {"text": "Shoe fell."})
        time.sleep(0.3)
        assert board["request"]["press"] in (2, 3)
        worker.command("auto", {"on": True})
        worker.command("pause", {"on": False})
        until(lambda: board["request"] is None or board["request"]["attempt"] > 1 or ended(worker))
        with suppress(ConfigurationError):  # the press that had waited for its key
            worker.command("press", {})
        until(lambda: ended(worker))

    with pages(worker, operator):
        assert board["job"]["state"] == "done", board["job"]
    recording = Recording.open(tmp_path / "recordings" / "P01-toggle.h5")
    kinds = [event.kind for event in recording.events]
    assert recording.complete and len(recording.accepted) == 3
    assert {"paused", "resumed", "note"} <= set(kinds)
    assert [(v.number, v.attempt) for v in recording.verdicts if "rejected" in v.flags] == [(2, 1)]
    assert recording.header.notes == "Preflight overridden: a test"
    contents = recording_contents(recording)
    assert [note["text"] for note in contents.values["operator_notes"]] == ["Shoe fell."]
    assert any("Shoe fell." in str(line) for one in contents.facts for line in one.lines)


def test_each_press_waits_for_next_the_first_too_and_the_setting_holds_for_one_session(tmp_path):
    worker = made(tmp_path, real_time=True)
    board = worker.board

    def operator():
        worker.command("override", {"reason": "a test"})
        worker.command("step", {"on": True})
        begin(worker, "record", button="toggle", participant="P01", presses=2)
        until(lambda: board["request"] and board["request"]["kind"] == "Rest")
        assert not board["paused"], "hands off is said first"
        for count in (1, 2):
            until(lambda: board["paused"] or ended(worker))
            assert board["paused"] and len(board["session"]["verdicts"]) == count - 1
            assert board["request"]["kind"] == ("Rest" if count == 1 else "Press")
            worker.command("pause", {"on": False})
            until(lambda count=count: len(board["session"]["verdicts"]) == count or ended(worker))
        worker.command("auto", {"on": False})
        until(lambda: ended(worker))
        assert (board["step"], board["auto"]) == (False, True)
        worker.command("step", {"on": True})
        begin(worker, "preflight")
        until(lambda: board["request"] or ended(worker))
        worker.stop()
        until(lambda: ended(worker))
        assert board["step"], "what is set before a session is for that session"

    with pages(worker, operator):
        pass


def test_stop_in_the_middle_reaches_the_safe_state_and_keeps_the_recording(tmp_path):
    worker, told = made(tmp_path), []

    def operator():
        worker.command("override", {"reason": "a test"})
        begin(worker, "record", button="push", participant="P01", presses=150)
        until(lambda: worker.board["session"] and len(worker.board["session"]["verdicts"]) >= 3)
        told.append(worker.stop())
        until(lambda: ended(worker))

    with pages(worker, operator):
        assert (told[0]["state"], worker.board["job"]["state"]) == ("safe", "stopped")
    recording = Recording.open(tmp_path / "recordings" / "P01-push.h5")
    assert recording.state == "interrupted" and len(recording.accepted) >= 3


def test_stop_reaches_the_safe_state_from_its_own_thread_when_the_job_hangs(tmp_path, monkeypatch):
    """A call of a driver that does not return, and holds the interrupt back."""
    monkeypatch.setattr(stopping, "_GRACE", 0.2)
    worker, told, made_safe = made(tmp_path), [], threading.Event()
    hanging, free = threading.Event(), threading.Event()

    def hang(rig):
        safe = rig.make_safe

        def make_safe():
            safe()
            made_safe.set()

        rig.make_safe = make_safe
        hanging.set()
        while not free.is_set():
            with suppress(KeyboardInterrupt):
                free.wait(0.05)
        return {}

    monkeypatch.setitem(jobs.JOBS, "hang", Job(lambda _tools, _wanted: hang, lambda _: "Hang"))

    def operator():
        begin(worker, "hang")
        until(hanging.is_set)
        told.append(worker.stop())
        assert not ended(worker) and made_safe.is_set()
        free.set()
        until(lambda: ended(worker))

    with pages(worker, operator):
        assert told[0]["state"] == "safe" and "has not ended yet" in told[0]["sentence"]


def test_a_job_that_was_asked_for_before_stop_does_not_begin_after_it(tmp_path, monkeypatch):
    """One whose parameters were still being read, and one that waited for the main thread."""
    worker, begun, refused = made(tmp_path), [], []
    reading, read = threading.Event(), threading.Event()

    def slow(_tools, _wanted):
        reading.set()
        assert read.wait(DEADLINE)
        return begun.append

    monkeypatch.setitem(jobs.JOBS, "slow", Job(slow, lambda _: "Slow"))
    monkeypatch.setitem(jobs.JOBS, "quick", Job(lambda _tools, _wanted: begun.append, lambda _: "Quick"))

    def start():
        try:
            begin(worker, "slow")
        except ConfigurationError as error:
            refused.append(str(error))

    def operator():
        asking = threading.Thread(target=start)
        asking.start()
        until(reading.is_set)
        assert worker.stop()["state"] == "safe"
        until(lambda: ended(worker) and not worker._running)
        read.set()
        asking.join()

    with pages(worker, operator):
        assert "STOP came before" in refused[0] and not begun
    worker = made(tmp_path)
    begin(worker, "quick")  # nobody takes it yet

    def stop():
        assert worker.stop()["state"] == "safe"

    stopping = threading.Thread(target=stop)
    stopping.start()
    until(lambda: len(worker._jobs) == 2)
    with pages(worker, stopping.join):
        assert not begun


def test_stop_in_a_job_without_the_rig_reads_the_rig_back_all_the_same(tmp_path, monkeypatch):
    worker, opened, working = made(tmp_path), [], threading.Event()

    def counted(*given, **named):
        opened.append(given)
        return open_rig(*given, **named)

    def work(_rig):
        working.set()
        until(lambda: False)
        return {}

    monkeypatch.setattr(workers, "open_rig", counted)
    job = Job(lambda _tools, _wanted: work, lambda _: "Paper", needs_rig=False)
    monkeypatch.setitem(jobs.JOBS, "paper", job)
    assert stopped(worker, "paper", working)["state"] == "safe" and len(opened) == 1


def opening_with(monkeypatch: pytest.MonkeyPatch, opens: Callable[..., object]) -> None:
    """Have the rig opened by `opens`, for a job "any" that does nothing with it."""
    monkeypatch.setattr(workers, "open_rig", opens)
    monkeypatch.setitem(jobs.JOBS, "any", Job(lambda _tools, _wanted: lambda _: {}, lambda _: "Any"))


def test_stop_says_when_the_rig_could_not_be_opened(tmp_path, monkeypatch):
    worker, opening = made(tmp_path), threading.Event()

    def refuse(*_given, **_named):
        opening.set()
        with suppress(KeyboardInterrupt):
            until(lambda: worker.board["stop"]["state"] != "none")
            time.sleep(0.1)
        raise InstrumentError("The rig is in use by another program.")

    opening_with(monkeypatch, refuse)
    told = stopped(worker, "any", opening)
    assert told["state"] == "unconfirmed" and "another program" in told["sentence"]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no signal that breaks a system call")
def test_stop_breaks_a_system_call_that_opens_the_rig(tmp_path, monkeypatch):
    worker, opening = made(tmp_path), threading.Event()

    def silent(*given, **named):
        if opening.is_set():
            return open_rig(*given, **named)
        opening.set()
        time.sleep(20)
        raise AssertionError("It was not interrupted.")

    opening_with(monkeypatch, silent)
    began = time.monotonic()
    assert stopped(worker, "any", opening)["state"] == "safe" and time.monotonic() - began < 15


def test_stop_before_the_rig_is_open_says_unconfirmed_and_can_be_pressed_again(tmp_path, monkeypatch):
    monkeypatch.setattr(stopping, "_UNOPENED", 0.3)
    worker, opening, told, interrupts = made(tmp_path), threading.Event(), [], []

    def slow(*given, **named):
        opening.set()
        while len(interrupts) < 2:
            try:
                time.sleep(0.02)
            except KeyboardInterrupt as one:
                interrupts.append(one)
        return open_rig(*given, **named)

    opening_with(monkeypatch, slow)

    def again():
        monkeypatch.setattr(stopping, "_UNOPENED", 30.0)
        told.append(worker.stop())

    first = stopped(worker, "any", opening, again)
    assert (first["state"], told[0]["state"]) == ("unconfirmed", "safe")
    assert "switch the amplifier off" in first["sentence"]


def test_an_unconfirmed_stop_is_confirmed_when_the_rig_was_read_back(tmp_path, monkeypatch):
    monkeypatch.setattr(stopping, "_UNOPENED", 0.1)
    worker, opening, free = made(tmp_path), threading.Event(), threading.Event()

    def slow(*given, **named):
        opening.set()
        while not free.is_set():
            with suppress(KeyboardInterrupt):
                time.sleep(0.02)
        return open_rig(*given, **named)

    opening_with(monkeypatch, slow)

    def read_back():
        free.set()
        until(lambda: worker.board["stop"]["state"] == "safe")

    assert stopped(worker, "any", opening, read_back)["state"] == "unconfirmed"


def test_stop_without_a_job_opens_the_rig_and_makes_it_safe(tmp_path):
    worker, told = made(tmp_path), []
    with pages(worker, lambda: told.append(worker.stop())):
        assert told[0]["state"] == "safe" and worker.board["job"]["kind"] == "safe"


def test_a_safe_state_that_was_not_confirmed_is_said_so(tmp_path, monkeypatch):
    from haploop.instruments.safety import SafeState

    def fail(_self):
        raise InstrumentError("The safe state was not confirmed: the relay is stuck.")

    worker, told = made(tmp_path), []

    def operator():
        worker.command("override", {"reason": "a test"})
        begin(worker, "record", button="push", participant="P01", presses=100)
        until(lambda: worker.board["run"] is not None)
        monkeypatch.setattr(SafeState, "reach", fail)
        told.append(worker.stop())
        until(lambda: ended(worker))
        told.append(worker.stop())

    with pages(worker, operator):
        assert [one["state"] for one in told] == ["unconfirmed", "unconfirmed"]
        assert "the relay is stuck" in told[0]["sentence"]


def test_what_a_page_asks_wrongly_is_one_sentence(tmp_path):
    worker = made(tmp_path)
    worker.command("override", {"reason": "a test"})
    for wanted, what in (
        ({"button": "<script>", "participant": "P01", "presses": 3}, "<script>"),
        ({"button": "latch", "participant": "../P01", "presses": 3}, "P01"),
        ({"button": "latch", "participant": "P01", "presses": "many"}, "whole number"),
        ({"button": "latch", "participant": "P01", "presses": 3, "notes": "x" * 300}, "notes"),
    ):
        raises(ConfigurationError, what, begin, worker, "record", **wanted)
    for kind, wanted in (("study", {"study": "../elsewhere"}), ("map", {"points": "0,one"}),
        ("map", {"points": "12-5"}), ("map", {"points": "0-99999999"}), ("map", {"name": "../map"}),
        ("check", {"button": "/etc/passwd"}), ("make", {"recordings": []}), ("safe", {}),
        ("anything", {})):  # fmt: skip
        raises(ConfigurationError, "", begin, worker, kind, **wanted)
    for name in ("reject", "pause", "press", "answer", "explode"):
        raises(ConfigurationError, "", worker.command, name, {"on": True})
    raises(ConfigurationError, "The reason", worker.command, "override", {"reason": " "})
    assert worker.board["job"] is None


def test_who_looks_gives_way_and_keeps_nothing(tmp_path):
    worker = made(tmp_path, real_time=True)
    board = worker.board

    def operator():
        worker.command("override", {"reason": "a test"})
        begin(worker, "look")
        until(lambda: board["run"] and board["run"]["doing"] == "look")
        worker.command("press", {})  # the simulated finger presses without a prompt
        begin(worker, "record", button="toggle", participant="P01", presses=1)
        until(lambda: board["run"] and board["run"]["doing"] == "record")
        raises(ConfigurationError, "busy", begin, worker, "look")
        until(lambda: ended(worker))
        assert board["job"]["kind"] == "record" and board["job"]["state"] == "done"
        begin(worker, "look")
        until(lambda: board["run"])
        worker.command("leave", {})
        until(lambda: ended(worker))
        assert board["job"]["kind"] == "look" and board["job"]["state"] == "done"
        begin(worker, "look")
        until(lambda: board["run"])
        assert worker.stop()["state"] == "safe"
        until(lambda: ended(worker))
        assert board["job"]["state"] == "stopped"

    with pages(worker, operator):
        pass
    assert [path.name for path in tmp_path.glob("**/*.h5")] == ["P01-toggle.h5"]


@pytest.mark.parametrize("as_filed", [True, False])
def test_the_simulated_person_confirms_settings_by_itself_and_truthfully(as_filed):
    """A laser's range that no software reads: nobody has to click on a simulated rig."""

    class Person(OperatorTwin):
        def __init__(self):
            self._plant = SimpleNamespace(set_as_filed=as_filed)

    board = Board(auto=True, request=None)
    operator = PageOperator(board, Person(), Flag())
    assert operator.confirm(ConfirmSettings("PDV-100: is the range 20 mm/s?")) is as_filed
    assert board["request"]["asks"] is False
