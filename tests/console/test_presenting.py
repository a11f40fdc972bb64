"""A session on the pages whose digital buttons the worker's rig plays: without browser and processes."""

import json
import threading
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from haploop.base.errors import ConfigurationError, DataError
from haploop.console.data_folder import DataFolder, store_of
from haploop.console.server.conductor import Conductor
from haploop.console.worker.board import Board
from haploop.console.worker.presenting import Stimuli, present_stimuli
from haploop.experiments import read_log
from haploop.instruments import open_rig
from tests.experiments.played import played
from tests.raising import raises


class Console:
    """Board, worker's job and conductor, joined as the server joins them."""

    def __init__(self, made: Path, folder: Path) -> None:
        played(folder / "played", made)
        self.data = DataFolder(folder, folder / "history")
        self.board = Board(surface=None, request=None, progress=None)
        self.nobody = threading.Event()
        self.stimuli = Stimuli(self.board, self.nobody)
        self.conductor = Conductor(self.data, self.command)
        self.failure: BaseException | None = None

    def command(self, name: str, values: Any) -> tuple[int, dict[str, Any]]:
        try:
            if name == "present":
                self.stimuli.present(values)
        except ConfigurationError as error:
            return 400, {"error": str(error)}
        return 200, {}

    def hear(self, until: Any) -> dict[str, Any]:
        """Follow the board until the operator's page shows something."""
        version = 0
        for _ in range(600):
            snapshot = json.loads(self.board.snapshot(version, 0.2))
            version = snapshot["version"]
            self.conductor.heard(snapshot)
            shown = self.conductor.operator or {}
            if until(shown, snapshot):
                return shown
        raise AssertionError(self.conductor.operator)

    def run(self, script: Any) -> None:
        """Run the job in this thread, which has the signals, and what the pages do in another one."""

        def pages() -> None:
            try:
                script()
            except BaseException as error:
                self.failure = error
            finally:
                self.nobody.set()

        other = threading.Thread(target=pages)
        store = store_of(self.data, "played")
        with open_rig("experiment") as rig:
            other.start()
            present_stimuli(rig, "played", store, self.board, self.stimuli)
        other.join()
        if self.failure is not None:
            raise self.failure


@pytest.mark.long
def test_a_session_on_the_pages_is_played_by_the_worker(made, tmp_path):
    console = Console(made, tmp_path)
    conductor = console.conductor

    def script():
        conductor.begin({"experiment": "played", "participant": "P01"}, {})
        raises(ConfigurationError, "prepare it first", conductor.present, {"turn": ""})
        console.hear(lambda _, snapshot: snapshot["surface"] is not None)
        conductor.present({"turn": ""})
        shown = conductor.operator
        assert shown is not None and shown["playing"] and not shown["by_hand"]
        raises(ConfigurationError, r"wait\.", conductor.present, {"turn": shown["turn"]})
        # One press of the calibration follows the other without the operator.
        shown = console.hear(lambda shown, _: shown["step"]["block"] == "experiment")
        for number in (1, 2):
            assert shown["step"]["number"] == number and not shown["turn"]
            conductor.present({"turn": ""})
            asked = conductor.participant
            assert asked is not None and asked["ask"] is None
            turn = conductor.operator["turn"]
            raises(DataError, "asked no more", conductor.answer, {"turn": turn, "answer": "push"})
            shown = console.hear(lambda shown, _: not shown["playing"])
            assert not shown["problem"]
            assert conductor.participant["ask"]["choices"]
            if number == 1:
                conductor.present({"turn": turn})
                console.hear(lambda shown, _: not shown["playing"])
            conductor.answer({"turn": turn, "answer": "push"})
            shown = conductor.operator or {}
        assert shown["step"] is None
        conductor.end()

    console.run(script)
    events = read_log(tmp_path / "played" / "answers" / "P01" / "session-1.jsonl")
    counts = Counter(event.kind for event in events)
    assert (counts["surface"], counts["contact"], counts["finger"], counts["activation"]) == (1, 4, 1, 3)
    assert counts["answer"] == 6 and counts["presented"] == 7 and counts["complete"] == 1
    order = [event.kind for event in events if event.kind in ("presented", "activation", "answer")]
    assert order[-5:] == ["activation", "answer", "presented", "activation", "answer"]


def test_a_rig_that_was_left_in_a_stimulus_is_said_so(made, tmp_path):
    """STOP, or a worker that died: the session goes on with the same trial."""
    console = Console(made, tmp_path)
    conductor = console.conductor
    console.board.set(surface={"experiment": "played", "state": "ready", "turn": "", "events": []})
    conductor.heard(json.loads(console.board.snapshot()))
    conductor.begin({"experiment": "played", "participant": "P01"}, {})
    conductor.present({"turn": ""})
    assert conductor.operator is not None and conductor.operator["playing"]
    turn = conductor.operator["turn"]
    console.board.set(surface=None)
    conductor.heard(json.loads(console.board.snapshot()))
    assert "prepare it, and present again" in conductor.operator["problem"]
    assert conductor.operator["step"]["number"] == 1 and not conductor.operator["playing"]
    assert conductor.participant is not None and conductor.participant["ask"] is None
    raises(ConfigurationError, "prepare it first", conductor.present, {"turn": ""})
    raises(DataError, "asked no more", conductor.answer, {"turn": turn, "answer": "done"})
    conductor.end()
