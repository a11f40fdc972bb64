"""`haploop experiment` at a terminal: questions, an interruption, confirmation, withdrawal, refusals."""

import io
from pathlib import Path

import click
import pytest

from haploop.experiments.commands.experiment import _AtTerminal
from haploop.experiments.protocol.steps import Step

SHORT = """
name = "short"
kind = "identification"
seed = 3
consent = true
factor = [{ name = "button", levels = ["latch", "push"] }]
question = { text = "Which was it?", identify = "button" }
block = [{ name = "training", practice = true, feedback = true }, { name = "experiment", repetitions = 2 }]
"""


@pytest.fixture
def short(tmp_path: Path) -> Path:
    path = tmp_path / "experiment.toml"
    path.write_text(SHORT, encoding="utf-8")
    return path


def test_a_person_at_the_terminal(run, short):
    """Interrupted after three answers, by the end of standard input; then continued."""
    first = run("experiment run", short, "-p", "P01", ends=130, typed="y\nlatch\nlatch\npush\n")
    assert first.stderr.count("Right.") == 1 and "No, it was push." in first.stderr
    due = run.json("experiment status", short)["sessions"][0]["due"]
    assert due == {"block": "experiment", "trial": 2}
    second = run("experiment run", short, "-p", "P01", ends=0, typed="knob\npush\npush\nlatch\n")
    assert "consent" not in second.stderr and "complete" in second.stdout


def test_without_consent(run, short):
    run("experiment run", short, "-p", "P01", says="has not consented", typed="n\n")
    assert not (short.parent / "answers").exists()


def test_a_withdrawal_is_asked_and_told(run, short):
    run("experiment run", short, "-p", "P01", "--simulated", ends=0)
    run("experiment run", short, "-p", "P02", "--simulated", ends=0)
    run("experiment withdraw", short, "P01", ends=130, typed="n\n")
    assert (short.parent / "answers" / "P01").exists()
    assert run.json("experiment withdraw", short, "P01", "--yes")["deleted"] == ["P01/session-1.jsonl"]
    assert not (short.parent / "answers" / "P01").exists()
    assert "P01 withdrew" in run("experiment status", short).stdout


def test_a_new_experiment_is_a_copy_of_an_example(run, tmp_path):
    run("experiment new", tmp_path / "mine", "--from", "rating", ends=0)
    run("experiment new", tmp_path / "mine", ends=2)
    run("experiment run", tmp_path / "mine", "-p", "P01", "--simulated", ends=0)


@pytest.mark.parametrize(
    "args",
    [
        ["run", "none.toml", "-p", "P01"],
        ["run", "matching", "-p", "Ann Smith", "--simulated"],
        ["run", "matching", "-p", "P01", "--session", 2, "--simulated"],
        ["run", "matching", "-p", "P01", "--model", "m.toml"],
        ["run", "matching", "-p", "P01", "--simulated", "--model", "none.toml"],
        ["withdraw", "matching", "P01", "--yes"],
        ["export", "matching", "out.csv"],
        ["export", "matching", "out.json"],
        ["new", "somewhere", "--from", "none"],
    ],
)
def test_a_wrong_request_is_one_sentence(run, args, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run("experiment", *args)
    assert result.exit_code == 2 and len(result.stderr.splitlines()) == 1, result.stderr
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_rating_that_is_no_number_is_asked_for_again_and_enter_is_none(monkeypatch):
    step = Step("rating", "trials", 1, 1, False, False, "How was it?", choices=("soft",), values=(-50, 50))
    monkeypatch.setattr("sys.stdin", io.StringIO("nan\n51\n7.5\n"))
    said = _AtTerminal(None).answer(step)["soft"]
    assert said["value"] == 7.5 and len(said["touched"]) == 1
    monkeypatch.setattr("sys.stdin", io.StringIO("\n\n"))
    with pytest.raises(click.Abort):
        _AtTerminal(None).answer(step)


def test_a_design_that_is_not_filled_is_said(run, tmp_path):
    for people, said in ((3, True), (6, False)):
        result = run("experiment simulate matching --session 1 -n", people, "-d", tmp_path / "a", ends=0)
        words = " ".join(result.stdout.split())
        assert ("not balanced with 3 participants" in words and "at a multiple of 6." in words) is said
    values = run.json("experiment status matching --data", tmp_path / "a")
    assert values["design"] == {"groups": {"I": 3, "II": 3}, "balanced": True, "multiple_of": 6}


def test_a_log_that_was_cut_short_is_said_by_every_command_and_stops_no_other_person(run, tmp_path):
    data = tmp_path / "answers"
    common = ("--data", data)
    run("experiment simulate rating -n 2", *common, ends=0)
    run("verify", data, ends=0)
    log = data / "P01" / "session-1.jsonl"
    raw = log.read_bytes()
    log.write_bytes(b"".join(raw.splitlines(keepends=True)[:8]))
    said = "session-1.jsonl has 8 of the 14 lines that it had: restore the file from a copy."
    for command, code in ((("experiment", "status", "rating", *common), 2),
        (("experiment", "status", "rating", *common, "--json"), 2),
        (("experiment", "export", "rating", tmp_path / "out.csv", *common), 2),
        (("experiment", "run", "rating", "-p", "P01", "--simulated", *common), 2), (("verify", data), 2),
        (("experiment", "run", "rating", "-p", "P03", "--simulated", *common), 0)):  # fmt: skip
        result = run(*command, ends=code)
        assert said in " ".join((result.stdout + result.stderr).split()), command
    assert not (tmp_path / "out.csv").exists()
    values = run.json("experiment status rating", *common, ends=2)
    assert [one["participant"] for one in values["sessions"]] == ["P02", "P03"]
    log.write_bytes(raw)
    run("experiment export rating", tmp_path / "out.csv", *common, ends=0)
    run("verify", data, ends=0)
