"""An experiment on the pages, without a browser: who may do what, and what a participant is shown."""

import json

import pytest
from starlette.testclient import TestClient

from haploop.base.errors import ConfigurationError
from haploop.console.data_folder import DataFolder
from haploop.console.server import Access, application
from haploop.console.server.conductor import Conductor
from haploop.console.server.follower import Follower
from haploop.experiments import Store, load_experiment
from tests.console.test_security import Link, Scope

EXPERIMENT = """
name = "small"
title = "<img src=x onerror=alert(1)>"
kind = "identification"
seed = 1
groups = ["I", "II"]
sessions = 2
factor = [
    { name = "confirmation", levels = ["none", "given"], varies = "session" },
    { name = "button", levels = ["latch", "toggle", "push"] },
]
question = { text = "<b>Which</b> was it?", identify = "button" }
block = [
    { name = "familiarisation", kind = "presses" },
    { name = "finger calibration", kind = "finger" },
    { name = "training", practice = true, feedback = { confirmation = "given" } },
    { name = "experiment", repetitions = 2 },
]
"""
RATING = """
name = "rated"
kind = "rating"
seed = 1
consent = false
factor = [{ name = "button", levels = ["latch", "toggle"] }]
question = { pairs = [["Rough", "Smooth"], ["Unclear", "Clear"]] }
block = [{ name = "ratings" }]
"""
DONE = {"done": True}


class Console:
    """A server with a data folder, its operator's page and its participant's."""

    def __init__(self, data):
        self.data = data
        access = Access("127.0.0.1", 8735)
        follower = Follower(Link(), Link, Scope())
        follower.snapshot, follower.count = {"rig": "r", "simulated": True}, 1
        app = application(access, follower, Scope(), DataFolder(data, data / "history"))
        self.operator, self.participant = (
            TestClient(app, base_url="http://127.0.0.1:8735", headers={"X-Haploop-Token": token})
            for token in (access.token, access.participant)
        )
        self.access = access

    def do(self, name, **values):
        return self.operator.post(f"/api/experiment/{name}", json=values).json()

    def begin(self, participant="P01", experiment="small", consent=True, **more):
        return self.do("begin", experiment=experiment, participant=participant, consent=consent, **more)

    def present(self, turn=""):
        return self.do("present", turn=turn)

    def answer(self, answer, turn=None):
        turn = self.asked["turn"] if turn is None else turn
        return self.participant.post("/api/participant/answer", json={"turn": turn, "answer": answer}).json()

    @property
    def shown(self):
        return self.participant.get("/api/participant").json()["experiment"]

    @property
    def asked(self):
        return self.shown["ask"]

    @property
    def stored(self):
        return Store(load_experiment(self.data / "small"), self.data / "small" / "answers")

    def due(self):
        return self.stored.session("P01", self.stored.next_session("P01")).due

    def up_to(self, block):
        """Answer what comes before a block."""
        while self.shown["step"]["block"] != block:
            if not self.asked:
                assert self.present() == DONE
            assert self.answer("done" if "choices" not in self.asked else "latch") == DONE


@pytest.fixture
def data(tmp_path):
    for name, text in (("small", EXPERIMENT), ("rated", RATING)):
        (tmp_path / "data" / name).mkdir(parents=True)
        (tmp_path / "data" / name / "experiment.toml").write_text(text, encoding="utf-8")
    return tmp_path / "data"


@pytest.fixture
def console(data):
    found = Console(data)
    yield found
    found.do("end")


def test_a_participant_is_never_shown_what_is_presented_nor_who_they_are(console):
    """Whatever the stimulus is, the page is sent the same: all answers to choose from, in one order."""
    console.begin()
    console.up_to("experiment")
    console.present()
    console.answer("push")
    sent = set()
    for _ in range(5):
        waiting = console.participant.get("/api/participant").text
        assert not {"latch", "toggle", "push"} & set(waiting.replace('"', " ").split())
        assert console.present() == DONE
        text = console.participant.get("/api/participant").text
        assert "P01" not in text + waiting and "stimulus" not in text and "presented" not in text
        shown = json.loads(text)["experiment"]
        del shown["ask"]["turn"], shown["step"]["number"]
        sent.add(json.dumps(shown))
        stimulus = console.due().presented
        with console.operator.websocket_connect("ws://127.0.0.1:8735/socket") as socket:
            socket.send_text(console.access.token)
            assert socket.receive_json()["state"]["experiment"]["step"]["stimulus"] == stimulus
        console.answer("push")
    assert len(sent) == 1
    assert console.shown["step"] is None


def test_confirmation_is_told_in_training_only_and_only_where_the_experiment_gives_it(data):
    told, groups, completed = {}, {}, []
    conductor = Conductor(DataFolder(data, data / "history"), Link().command)
    conductor.completed = lambda *session: completed.append(session)
    for participant in ("P01", "P02"):  # one of each group
        conductor.begin({"experiment": "small", "participant": participant, "consent": True}, {})
        groups[participant] = conductor.operator["levels"]["confirmation"]
        while (step := conductor.participant["step"]) is not None:
            if not conductor.operator["turn"]:
                conductor.present({"turn": ""})
            assert conductor.participant["told"] is None, "it goes when the next one is presented"
            answer = "done" if conductor.operator["by_hand"] else "toggle"
            conductor.answer({"turn": conductor.operator["turn"], "answer": answer})
            told.setdefault((participant, step["block"]), []).append(conductor.participant["told"])
        conductor.end()
    assert completed == [("small", "P01"), ("small", "P02")]
    assert sorted(groups.values()) == ["given", "none"]
    for (participant, block), values in told.items():
        if block == "training" and groups[participant] == "given":
            assert sorted((one["right"], one["was"]) for one in values) == [
                (False, "latch"), (False, "push"), (True, "toggle"),
            ]  # fmt: skip
        else:
            assert values == [None] * len(values)


def test_an_answer_is_taken_once_and_only_to_what_is_asked(console):
    assert "begin one" in console.answer("done", "")["error"]
    console.begin()
    assert "asked no more" in console.answer("done", "")["error"], "nothing was presented yet"
    console.up_to("experiment")
    console.present()
    turn = console.asked["turn"]
    assert "presented already" in console.present()["error"], "a double click"
    assert console.present(turn) == DONE, "a repetition"
    assert "is no answer" in console.answer("doorbell")["error"]
    assert "the participant's to answer" in console.do("done", turn=turn)["error"]
    assert console.do("pause", on=True) == DONE
    assert "paused" in console.answer("latch")["error"] and console.shown["paused"]
    assert console.do("pause", on=False) == DONE
    assert console.answer("latch") == DONE
    kinds = [event.kind for event in console.stored.session("P01", 1).events][-5:]
    console.present()
    for other in (turn, "", 1, "é"):
        assert "asked no more" in console.answer("push", other)["error"], "a late tap is no answer"
    assert kinds == ["presented", "presented", "pause", "continue", "answer"]


def test_a_killed_server_resumes_at_the_exact_trial(console, data):
    console.begin()
    console.up_to("experiment")
    console.present()
    console.answer("push")
    console.present()
    before, log = console.due(), data / "small" / "answers" / "P01" / "session-1.jsonl"
    console.do("end")
    with log.open("ab") as file:  # as after a kill in the middle of a line
        file.write(b'{"number": 99, "event": "ans')
    again = Console(data)
    assert again.begin(consent=False) == DONE, "consent is asked once"
    assert again.shown["step"] == {"block": "experiment", "number": 2, "of": 6}
    assert again.due() == before and not again.asked, "the operator presents it again"
    again.present()
    assert again.answer("push") == DONE
    found = again.stored.session("P01", 1)
    assert [event.values["rig_simulated"] for event in found.events if event.kind == "page"] == [True, True]
    assert [answer[1] for answer in found.answers][-2:] == ["push", "push"]
    again.do("end")


def test_the_next_day_does_not_begin_a_second_later_unless_it_is_named(data):
    conductor = Conductor(DataFolder(data, data / "history"), Link().command)
    asked = {"experiment": "small", "participant": "P01", "consent": True}
    conductor.begin(asked, {})
    while conductor.participant["step"] is not None:
        if not conductor.operator["turn"]:
            conductor.present({"turn": ""})
        answer = "done" if conductor.operator["by_hand"] else "toggle"
        conductor.answer({"turn": conductor.operator["turn"], "answer": answer})
    conductor.end()
    with pytest.raises(ConfigurationError, match=r"day before ended 0.0 hours ago.*choose 2 as the day"):
        conductor.begin(asked, {})
    conductor.begin(asked | {"session": 2}, {})
    conductor.end()
    conductor.begin(asked, {})  # goes on
    conductor.end()


def test_presses_of_a_blindfolded_participant_are_confirmed_by_the_operator(console):
    console.begin()
    for _ in range(3):
        console.present()
        assert "choices" not in console.asked
        assert console.do("done", turn=console.asked["turn"]) == DONE
    console.present()
    assert console.asked["text"] == "A light press."
    console.answer("done")
    assert console.asked["text"] == "A firm press.", "one press follows the other"


def test_ratings_are_complete_numbers_on_the_scale(console):
    assert console.begin(experiment="rated", consent=False) == DONE
    console.present()
    assert (console.asked["low"], console.asked["high"]) == (1, 101)
    pairs = [name for name, *_ in console.asked["pairs"]]
    touched = {"value": 51, "touched": [0.5]}
    first = {pairs[0]: touched}
    several = ({"value": 102, "touched": [1]}, {"value": "3", "touched": [1]}, 51, None)
    for wrong in ({}, first, *(dict.fromkeys(pairs, one) for one in several), "done", [1], None):
        assert "a number from 1 to 101" in console.answer(wrong)["error"]
    untouched = console.answer(first | {pairs[1]: {"value": 51, "touched": []}})["error"]
    assert f"for {pairs[1]} (a scale has no value until it is touched)" in untouched
    assert console.answer(dict.fromkeys(pairs, touched)) == DONE


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"participant": "../../x"}, "not a valid participant"),
        ({"participant": "P01", "experiment": "../data/small"}, "data folder"),
        ({"participant": "P01", "experiment": 3}, "There is no experiment"),
        ({"participant": "P01", "session": "2"}, "whole number"),
        ({"participant": "P01", "session": 2}, "is not due"),
        ({"participant": "P01", "consent": False}, "has not consented"),
    ],
)
def test_what_cannot_begin_is_one_sentence_and_leaves_nothing(console, values, sentence):
    for folder in ("x", "small/answers"):
        (console.data / folder).mkdir()
    (console.data / "x" / "session-1.jsonl").write_text("of another folder\n", encoding="utf-8")
    assert sentence in console.begin(**values)["error"]
    assert not (console.data / "small" / "answers" / "P01").exists()
    assert console.shown is None
    assert console.begin() == DONE, "and the folder is not held"
    assert "runs already" in console.begin("P02")["error"]


def test_progress_is_that_of_the_logs(console):
    console.begin()
    console.up_to("finger calibration")
    found = console.operator.get("/api/experiment?experiment=small").json()
    one = found["sessions"][0]
    assert (one["participant"], one["answers"], one["due"]["block"]) == ("P01", 3, "finger calibration")
    assert found["title"] == "<img src=x onerror=alert(1)>" and found["groups"] == ["I", "II"]
    assert console.operator.get("/api/files").json()["experiments"] == ["rated", "small"]
