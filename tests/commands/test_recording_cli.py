"""`haploop record`: what it refuses, whom it waits for, and what an empty recording does to the next."""

import json
from pathlib import Path

import click
import pytest

from haploop.commands.cli import cli
from haploop.instruments import Press
from haploop.mocks.people import OperatorTwin

ROOT = Path(__file__).parents[2]


def test_the_same_command_can_be_given_again_where_nobody_came(run, tmp_path, monkeypatch):
    command = ("record", "push", "-p", "P01", "-n", 1, "-o", tmp_path)
    with monkeypatch.context() as nobody:
        tell = OperatorTwin.tell
        nobody.setattr(OperatorTwin, "tell", lambda self, r: None if isinstance(r, Press) else tell(self, r))
        run(*command, "--wait", 5, says="No press 1 of 1 arrived within 20 s of the prompt")
    result = run(*command, "--json", ends=0, says=f"was renamed to {tmp_path / 'P01-push.empty-1.h5'}.")
    assert json.loads(result.stdout)["presses_accepted"] == 1
    run(*command, says="already exists")


def test_a_button_is_recorded_again_under_another_name(run, tmp_path):
    command = ("record", "push", "-p", "P01", "-n", 1, "-o", tmp_path)
    run(*command, ends=0)
    refused = run(*command)
    assert (refused.exit_code, refused.stderr.count("Error:")) == (2, 1)
    assert "already exists" in refused.stderr and "--name, such as P01-push-2" in refused.stderr
    run(*command, "--name", "P01-push-2", ends=0)
    for wrong in ("../P01", "P01 push", "x" * 61):
        result = run(*command, "--name", wrong)
        assert (result.exit_code, "up to 60 letters" in result.stderr) == (2, True)
    assert sorted(path.name for path in tmp_path.glob("*.h5")) == ["P01-push-2.h5", "P01-push.h5"]


@pytest.mark.long
def test_a_study_waits_as_long_as_its_file_or_its_option_says(run, tmp_path, monkeypatch):
    study = tmp_path / "study.toml"
    text = 'name = "s"\nrig = "simulated"\nbuttons = ["push"]\nparticipants = ["P01"]\nwait = 10\n'
    study.write_text(text, encoding="utf-8")
    monkeypatch.setattr(OperatorTwin, "tell", lambda _self, _request: None)
    for option, seconds in (((), 25), (("--wait", 0), 15)):
        run("study run -s", study, *option, says=f"arrived within {seconds} s of the prompt")


def test_the_reference_lists_every_command():
    page = (ROOT / "docs" / "reference" / "command-line.md").read_text(encoding="utf-8")
    assert isinstance(cli, click.Group)
    missing = [name for name in cli.commands if f"`{name}" not in page]
    assert missing == []
