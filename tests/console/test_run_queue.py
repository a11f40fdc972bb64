"""Recordings that are lined up: each is started by a person, and nothing of the list is lost."""

from __future__ import annotations

import re
from typing import Any

import pytest

from haploop.base.errors import ConfigurationError, DataError, HaploopError
from haploop.console.data_folder import DataFolder
from haploop.console.server.run_queue import RunQueue


class Worker:
    """Takes every job, or refuses it with a sentence."""

    def __init__(self) -> None:
        self.asked: list[Any] = []
        self.refusal = ""

    def __call__(self, name: str, values: Any) -> tuple[int, dict[str, Any]]:
        if self.refusal:
            return 409, {"error": self.refusal}
        self.asked.append((name, values))
        return 200, {"job": len(self.asked)}


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


def job(number: int, state: str, kind: str = "record", sentence: str = "") -> dict[str, Any]:
    return {"gone": "", "job": {"number": number, "state": state, "kind": kind, "sentence": sentence}}


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
    queue.heard({"gone": "", "job": None})  # older than the start
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
        ({"gone": "The worker died.", "job": None}, "How it ended is not known"),
    ],
)
def test_what_was_not_completed_stays_with_a_sentence(queue, snapshot, said):
    queue.start({"id": queue.items[0]["id"]})
    queue.heard(job(1, "running"))
    queue.heard(snapshot)
    assert order(queue) == ["latch", "toggle", "push"]
    assert queue.items[0]["job"] == 0 and said in queue.items[0]["said"]
    queue.start({"id": queue.items[0]["id"]})
    assert queue.items[0]["said"] == ""


def test_a_server_that_comes_back_knows_what_runs(queue, data, worker):
    queue.start({"id": queue.items[0]["id"]})
    again = RunQueue(data, worker)
    again.heard(job(1, "running"))
    assert again.items[0]["job"] == 1
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
    with pytest.raises(HaploopError, match=re.escape(sentence)):
        queue.add(values)
    assert order(queue) == ["latch", "toggle", "push"]


def test_a_refusal_of_the_worker_leaves_the_list(queue, worker):
    worker.refusal = "The preflight is not green."
    with pytest.raises(ConfigurationError, match="preflight"):
        queue.start({"id": queue.items[0]["id"]})
    assert all(one["job"] == 0 for one in queue.items)
    with pytest.raises(ConfigurationError, match="not lined up any more"):
        queue.start({"id": "gone"})


def test_a_damaged_list_is_said_and_not_replaced(queue, data, worker):
    path = data.root / "run-queue.json"
    path.write_bytes(path.read_bytes()[:-40])
    damaged = RunQueue(data, worker)
    assert damaged.items == [] and "Remove it" in damaged.problem
    before = path.read_bytes()
    with pytest.raises(DataError):
        damaged.add({"participant": "P02", "button": "latch"})
    assert path.read_bytes() == before
