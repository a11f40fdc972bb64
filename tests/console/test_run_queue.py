"""Recordings that are lined up: each is started by a person, and nothing of the list is lost."""

import re
import threading
from typing import Any

import pytest

from haploop.base.errors import ConfigurationError, DataError, HaploopError
from haploop.console.data_folder import DataFolder
from haploop.console.server import run_queue
from haploop.console.server.run_queue import RunQueue
from tests.console.test_experiment_pages import EXPERIMENT
from tests.raising import raises

HERE = {"place": "/state/console-1.json", "begun": "2026-11-28T12:00:00.000000+00:00"}
"""What the board says of the worker of these tests."""


class Worker:
    """Takes every job, or refuses it with a sentence."""

    def __init__(self) -> None:
        self.asked: list[Any] = []
        self.refusal = ""

    def __call__(self, name: str, values: Any) -> tuple[int, dict[str, Any]]:
        if self.refusal:
            return 409, {"error": self.refusal}
        self.asked.append((name, values))
        return 200, {"job": len(self.asked), "worker": HERE}


@pytest.fixture
def worker() -> Worker:
    return Worker()


@pytest.fixture
def data(tmp_path) -> DataFolder:
    return DataFolder(tmp_path, tmp_path / "history")


@pytest.fixture
def queue(data, worker) -> RunQueue:
    found = RunQueue(data, worker)
    for button in ("latch", "toggle", "push"):
        found.add({"participant": "P01", "button": button, "presses": 3})
    return found


def order(queue: RunQueue) -> list[str]:
    return [one["button"] for one in queue.items]


def job(number: int, state: str, kind: str = "record", sentence: str = "", **worker: str) -> dict[str, Any]:
    told = {"number": number, "state": state, "kind": kind, "sentence": sentence}
    return {"gone": "", "job": told, "worker": HERE | worker}


def test_the_order_is_changed_and_survives_a_new_server(queue, data, worker):
    queue.move({"id": queue.items[2]["id"], "to": 0})
    queue.drop({"id": queue.items[1]["id"]})
    assert order(queue) == order(RunQueue(data, worker)) == ["push", "toggle"]
    assert (data.root / "run-queue.json").stat().st_mode & 0o077 == 0
    assert not worker.asked


def test_only_a_person_starts_and_what_is_complete_leaves(queue, worker):
    queue.heard(job(7, "done"))
    assert not worker.asked
    first = queue.items[0]["id"]
    queue.start({"id": first})
    wanted = {"participant": "P01", "button": "latch", "name": "", "presses": 3, "notes": ""}
    assert worker.asked == [("start", {"kind": "record", "parameters": wanted})]
    with pytest.raises(ConfigurationError, match="runs already"):
        queue.start({"id": first})  # a double click
    queue.heard({"gone": "", "job": None, "worker": HERE})  # older than the start
    queue.heard(job(1, "running"))
    assert order(queue) == ["latch", "toggle", "push"]
    queue.heard(job(1, "done"))
    assert order(queue) == ["toggle", "push"]
    assert len(worker.asked) == 1  # the next one waits for a person


@pytest.mark.parametrize(
    ("snapshot", "said"),
    [
        (job(1, "stopped"), "It was stopped."),
        (job(1, "failed", sentence="The cable is loose."), "The cable is loose."),
        (job(9, "running"), "How it ended is not known"),
        (job(1, "done", begun="2026-11-28T13:00:00.000000+00:00"), "How it ended is not known"),
        ({"gone": "The worker died.", "job": None, "worker": HERE}, "How it ended is not known"),
    ],
)
def test_what_was_not_completed_stays_with_a_sentence(queue, snapshot, said):
    queue.start({"id": queue.items[0]["id"]})
    queue.heard(job(1, "running"))
    queue.heard(snapshot)
    assert order(queue) == ["latch", "toggle", "push"]
    assert queue.items[0]["job"] is None and said in queue.items[0]["said"]
    queue.start({"id": queue.items[0]["id"]})
    assert queue.items[0]["said"] == ""


def test_a_server_that_comes_back_knows_what_runs(queue, data, worker):
    queue.start({"id": queue.items[0]["id"]})
    again = RunQueue(data, worker)
    again.heard(job(1, "running"))
    assert again.items[0]["job"]["number"] == 1
    again.heard(job(1, "done"))
    assert order(again) == ["toggle", "push"]


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"participant": "P01", "button": "latch", "presses": 3}, "lined up already"),
        ({"participant": "../x", "button": "latch", "presses": 3}, "pseudonym"),
        ({"participant": "P01", "button": "bell", "presses": 0}, "from 1 to 200"),
        ({"participant": "P01", "button": "bell", "notes": "x" * 300}, "The notes"),
    ],
)
def test_what_cannot_be_recorded_is_not_lined_up(queue, values, sentence):
    raises(HaploopError, re.escape(sentence), queue.add, values)
    assert order(queue) == ["latch", "toggle", "push"]


def test_a_refusal_of_the_worker_leaves_the_list(queue, worker):
    worker.refusal = "The preflight is not green."
    raises(ConfigurationError, "preflight", queue.start, {"id": queue.items[0]["id"]})
    assert all(one["job"] is None for one in queue.items)
    raises(ConfigurationError, "not lined up any more", queue.start, {"id": "gone"})


def test_a_damaged_list_is_said_and_not_replaced(queue, data, worker):
    path = data.root / "run-queue.json"
    path.write_bytes(path.read_bytes()[:-40])
    damaged = RunQueue(data, worker)
    assert damaged.items == [] and "Remove it" in damaged.shown["problem"]
    before = path.read_bytes()
    raises(DataError, "", damaged.add, {"participant": "P02", "button": "latch"})
    assert path.read_bytes() == before


# Two servers on one data folder


@pytest.fixture
def other(data, worker, queue) -> RunQueue:
    return RunQueue(data, worker)


def test_what_one_server_changes_the_other_shows_and_keeps(queue, other):
    assert not other.shown["problem"] and order(other) == ["latch", "toggle", "push"]
    queue.add({"participant": "P02", "button": "latch", "presses": 1})
    assert other.changed and len(other.items) == 4 and not other.changed
    other.drop({"id": other.items[0]["id"]})
    queue.move({"id": queue.items[-1]["id"], "to": 0})
    assert order(queue) == order(other) == ["latch", "toggle", "push"]
    assert queue.items[0]["participant"] == "P02"


def test_only_one_server_starts_a_recording(queue, other, worker):
    first = {"id": queue.items[0]["id"]}
    refused = []

    def start(one):
        try:
            one.start(first)
        except ConfigurationError as error:
            refused.append(str(error))

    threads = [threading.Thread(target=start, args=(one,)) for one in (queue, other) * 4]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(worker.asked) == 1 and refused == ["That recording runs already."] * 7


@pytest.mark.parametrize("state", ["done", "failed", "running"])
@pytest.mark.parametrize(
    "told",
    [
        {"place": "/state/console-2.json"},  # of another rig, which counts its jobs from 1 too
        {"begun": "2026-11-28T11:00:00.000000+00:00"},  # a snapshot that is older than this worker
    ],
)
def test_another_workers_job_of_the_same_number_says_nothing(queue, other, state, told, monkeypatch):
    monkeypatch.setattr(run_queue, "is_marked", lambda path: str(path) == HERE["place"])
    queue.start({"id": queue.items[0]["id"]})
    for number in (1, 2):
        other.heard(job(number, state, **told))
    assert order(other) == ["latch", "toggle", "push"] and other.items[0]["job"]["number"] == 1
    other.heard({"gone": "It does not answer.", "job": None, "worker": HERE})  # it lives
    other.heard(job(1, "done"))
    assert order(queue) == ["toggle", "push"]


# Sessions of experiments


@pytest.fixture
def experiment(data) -> str:
    (data.root / "pilot").mkdir(parents=True)
    (data.root / "pilot" / "experiment.toml").write_text(EXPERIMENT, encoding="utf-8")
    return "pilot"


def test_a_session_is_lined_up_among_recordings_and_leaves_when_it_is_complete(queue, other, experiment):
    for who in ("P01", "P02"):
        queue.add({"participant": who, "experiment": experiment})
    queue.move({"id": queue.items[3]["id"], "to": 1})
    told = [(one["participant"], one["experiment"] or one["button"]) for one in other.items]
    assert told == [("P01", "latch"), ("P01", "pilot"), ("P01", "toggle"), ("P01", "push"), ("P02", "pilot")]
    raises(ConfigurationError, "begins on the page", queue.start, {"id": queue.items[1]["id"]})
    queue.completed(experiment, "P03")
    queue.completed(experiment, "P01")
    assert [one["participant"] for one in other.items if one["experiment"]] == ["P02"]


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"participant": "P01", "experiment": "pilot"}, "P01's session of pilot is lined up already."),
        ({"participant": "Ann Smith", "experiment": "pilot"}, "pseudonym"),
        ({"participant": "P02", "experiment": "nothing"}, "nothing"),
        ({"participant": "P02", "experiment": "../pilot"}, "data folder"),
    ],
)
def test_what_is_no_session_is_not_lined_up(queue, experiment, values, sentence):
    queue.add({"participant": "P01", "experiment": experiment})
    raises(HaploopError, re.escape(sentence), queue.add, values)
    assert len(queue.items) == 4
