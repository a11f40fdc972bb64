"""One session at a time: a recording or an experiment has the rig, the other is refused by a sentence."""

import json
from urllib.error import HTTPError

import pytest

from haploop.base.errors import ConfigurationError
from haploop.base.marks import marked
from haploop.console.data_folder import DataFolder
from haploop.console.server.conductor import Conductor
from tests.console.serving import served
from tests.console.test_experiment_pages import RATING
from tests.console.test_worker import begin, ended, made, pages, until
from tests.raising import raises

BEGIN = {"experiment": "rated", "participant": "P01"}


@pytest.fixture
def data(tmp_path):
    (tmp_path / "rated").mkdir()
    (tmp_path / "rated" / "experiment.toml").write_text(RATING, encoding="utf-8")
    return tmp_path


def conductor_of(worker):
    """A conductor, joined to a worker as by its link."""

    def command(name, values):
        try:
            return 200, worker.command(name, values)
        except ConfigurationError as error:
            return 409, {"error": str(error)}

    return Conductor(worker.data, command)


def test_an_experiment_does_not_begin_in_a_recording_that_is_paused(data):
    worker = made(data, real_time=True)
    conductor = conductor_of(worker)

    def operator():
        worker.command("override", {"reason": "a test"})
        begin(worker, "record", button="toggle", participant="P02", presses=2)
        raises(ConfigurationError, r"busy \(Record toggle by P02\)", conductor.begin, BEGIN, {})
        until(lambda: worker.board["request"] and worker.board["request"].get("press") == 1)
        worker.command("pause", {"on": True})
        raises(ConfigurationError, r"busy \(Record toggle by P02\)", conductor.begin, BEGIN, {})
        assert conductor.participant is None and worker.board["held"] is None
        assert not (data / "rated" / "answers" / "P01").exists(), "a refusal leaves nothing"
        worker.stop()
        until(lambda: ended(worker))
        conductor.begin(BEGIN, {})
        conductor.end()

    with pages(worker, operator):
        pass


def test_nothing_but_the_experiments_own_part_begins_in_a_session(data):
    worker = made(data)
    conductor = conductor_of(worker)
    worker.command("override", {"reason": "a test"})
    conductor.begin(BEGIN, {})
    assert worker.board["held"] == BEGIN
    worker.watch()
    for kind, values in (("record", {"button": "toggle", "participant": "P02", "presses": 2}),
        ("preflight", {}), ("surface", {"experiment": "another"})):  # fmt: skip
        with pytest.raises(ConfigurationError, match="P01's session of the experiment rated holds the rig"):
            begin(worker, kind, **values)
    with pytest.raises(ConfigurationError, match=r"has no \[buttons\]"):  # so far it goes
        begin(worker, "surface", experiment="rated")
    conductor.end()
    assert worker.board["held"] is None
    begin(worker, "record", button="toggle", participant="P02", presses=2)


def test_a_session_whose_server_has_died_holds_nothing(data):
    worker = made(data)
    with marked(worker.data.sitting):
        worker.command("hold", BEGIN)
        worker.watch()
        assert worker.board["held"] == BEGIN
    worker.watch()
    assert worker.board["held"] is None


def test_a_session_outlives_its_worker(data):
    """The worker that replaces a dead one holds the rig for the session too."""
    first, second = made(data), made(data)
    workers = [first]
    conductor = Conductor(
        DataFolder(data, data / "history"), lambda name, values: (200, workers[-1].command(name, values))
    )
    conductor.begin(BEGIN, {})
    workers.append(second)
    conductor.heard({"gone": "It has died.", "held": None})
    assert second.board["held"] is None
    conductor.heard({"gone": "", "surface": None, "held": None})
    assert second.board["held"] == BEGIN
    conductor.end()
    assert second.board["held"] is None


@pytest.mark.long
def test_two_servers_of_a_rig_have_one_session(data):
    options = {"state": data / "state"}
    with served(data, "--port", "0", **options) as one, served(data, "--port", "0", **options) as two:
        asked = {**BEGIN, "consent": True}
        assert _said(one, "/api/experiment/begin", asked) == ""
        other = {**asked, "participant": "P02"}
        assert "another `haploop serve`" in _said(two, "/api/experiment/begin", other)
        _said(two, "/api/command/override", {"reason": "a test"})
        wanted = {"button": "toggle", "participant": "P02", "presses": 2}
        record = {"kind": "record", "parameters": wanted}
        assert "P01's session" in _said(two, "/api/command/start", record)
        one.process.kill()
        one.process.wait()
        until(lambda: _said(two, "/api/experiment/begin", other) == "")


def _said(console, path, values):

    try:
        console.ask(path, values)
    except HTTPError as error:
        with error:  # it holds the connection
            return json.loads(error.read())["error"]
    return ""
