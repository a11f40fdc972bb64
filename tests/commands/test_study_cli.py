"""`haploop study`, new buttons in one go, and what many recordings show."""

import json
from pathlib import Path

import pytest

from haploop.commands.study import STUDY_FORM
from haploop.instruments import Consent, open_rig
from haploop.mocks.people import OperatorTwin
from tests.command_line import Run

PNG = b"\x89PNG"


@pytest.fixture
def study(run: Run, tmp_path: Path) -> Path:
    """A new study of two participants, two buttons and two presses."""
    folder = tmp_path / "pilot 'A'"
    run("study new", folder)
    path = folder / "study.toml"
    text = path.read_text(encoding="utf-8")
    for before, after in (
        ('["P01", "P02", "P03"]', '["P01", "P02"]'),
        ('["latch", "toggle", "push"]', '["toggle", "doorbell"]'),
        ("presses = 10 ", "presses = 2 "),
    ):
        assert text.count(before) == 1
        text = text.replace(before, after)
    path.write_text(text, encoding="utf-8")
    return folder


@pytest.mark.long
def test_a_study_from_its_first_line_to_its_figure(run, study, tmp_path):
    first = run("study run --study", study, "-p", "P01", "--json", ends=0)
    values = json.loads(first.stdout)
    assert (values["accepted"], values["of"], values["complete"]) == (4, 8, False)
    assert values["participants"][0]["consented"] is True
    assert "P01, toggle: 2 of 2 presses." in first.stderr

    rejected = run("study reject P01 toggle 2 --reason", "coughed [/red]", "-s", study)
    said = "Rejected presses of toggle by P01: 2. `haploop study run` asks for them again.\n"
    assert rejected.stdout == said
    status = run("study status --study", study)
    assert "1/2 (1 rejected)" in status.stdout
    shown = run("show", study / "recordings" / "P01-toggle.h5")
    assert "press 2, attempt 1: Rejected: coughed [/red]" in shown.stdout
    assert "`haploop study run` continues with P01, toggle, press 2." in status.stdout

    values = run.json("study run --study", study)
    assert values["complete"] is True
    toggle = values["participants"][0]["buttons"]["toggle"]
    assert [Path(file).name for file in toggle["files"]] == ["P01-toggle.h5", "P01-toggle.2.h5"]
    assert (toggle["rejected"], toggle["sessions"]) == (1, 2)

    values = run.json("show", study, "--plot", tmp_path / "forces.png")
    assert (tmp_path / "forces.png").read_bytes().startswith(PNG)
    assert values["simulated"] is True
    assert values["buttons"]["toggle"]["presses"] == 4
    assert list(values["buttons"]["doorbell"]["participants"]) == ["P01", "P02"]
    files = sorted((study / "recordings").glob("*-doorbell.h5"))
    table = run("show", *files)
    assert "Doorbell" in table.stdout
    assert "P02" in table.stdout
    run("study repeat P02 doorbell -s", study, ends=0)
    assert "0/2 (2 rejected)" in run("study status -s", study).stdout


def test_a_study_is_represented_by_the_method_in_its_file(run, study, tmp_path):
    run("study run -s", study, "-p", "P01", "-b", "toggle", ends=0)
    file = study / "study.toml"
    text = file.read_text(encoding="utf-8")
    assert text.count('method = "automatic"') == 1
    file.write_text(text.replace('method = "automatic"', 'method = "barycentre"'), encoding="utf-8")
    values = run.json("study represent toggle -s", study, "-o", tmp_path / "paper.h5")
    assert (values["presses"], values["method"]) == (2, "two-level barycentre")
    assert values["reason"] == "asked for by name"
    run("verify", tmp_path / "paper.h5", ends=0)
    made = run("study represent toggle -s", study, "-o", tmp_path / "mean.h5", "--average", "mean")
    assert "two-level mean: asked for by name" in made.stdout
    for button, told in (("doorbell", "no accepted press of doorbell yet"), ("bell", "no button 'bell'")):
        refused = run("study represent", button, "-s", study, "-o", tmp_path / "none.h5")
        assert (refused.exit_code, refused.stdout) == (2, "")
        assert told in refused.stderr
    file.write_text(text.replace('method = "automatic"', 'method = "median"'), encoding="utf-8")
    run("study represent toggle -s", study, "-o", tmp_path / "none.h5", says=("study.toml", "'barycentre'"))
    assert not (tmp_path / "none.h5").exists()


def test_who_does_not_consent_is_not_recorded(run, study, monkeypatch):
    monkeypatch.setattr(OperatorTwin, "confirm", lambda _self, request: not isinstance(request, Consent))
    run("study run --study", study, says="P01 has not consented")
    assert not list((study / "recordings").glob("*.h5"))


@pytest.mark.parametrize("name", ["Anna", "Anna Maria", "../P01", "P01/../P02", "P01\n", "P0123456", ""])
def test_a_participant_s_name_can_be_typed_nowhere(run, study, tmp_path, name):
    for args in (
        ["record", "latch", "--participant", name, "--presses", "1", "--out", tmp_path / "out"],
        ["study", "run", "--study", study, "--participant", name],
        ["study", "reject", name, "toggle", "1", "--study", study],
        ["study", "repeat", name, "toggle", "--study", study],
    ):
        run(*args, says="Error: ")
    assert not list((tmp_path / "out").glob("*"))
    assert not (study / "recordings").exists()


def test_nothing_is_taken_for_a_study_that_is_none(run, study, tmp_path):
    for args in (["study", "status", "--study", tmp_path / "nowhere"], ["study", "new", study],
        ["study", "run", "--study", study, "--button", "../latch"], ["show", study],
        ["show", study / "study.toml", study / "study.toml"]):  # fmt: skip
        result = run(*args)
        assert (result.exit_code, result.stdout) == (2, ""), args
        assert len([line for line in result.stderr.splitlines() if line.startswith("Error: ")]) == 1
    (study / "study.toml").write_text(STUDY_FORM.format(name='"pilot"').replace('rig = "simulated"', ""))
    assert "names no rig" in run("study run --study", study).stderr


@pytest.mark.long
@pytest.mark.parametrize("rig", ["simulated", "haptable", "stock-accelerometer"])
def test_a_new_button_in_one_go_on_any_rig(run, tmp_path, rig):
    with open_rig(rig, simulate="twin") as opened:
        assert opened.sensors.activation is not None
    run("record doorbell -p P01 -n 1 --rig", rig, "--simulate", "twin", "--out", tmp_path, ends=0)
    values = run.json("show", tmp_path / "P01-doorbell.h5", "--plot", tmp_path / "doorbell.png")
    assert (values["presses_detected"], values["presses_accepted"], values["bad_presses"]) == (1, 1, [])
    assert (tmp_path / "doorbell.png").read_bytes().startswith(PNG)


def test_a_bad_press_is_told_of_while_recording_and_in_the_file(run, tmp_path):
    rig = tmp_path / "bad-presses.toml"
    rig.write_text("[simulation]\nbad_press_rate = 0.9\nseed = 2\n", encoding="utf-8")
    told = run("record push -p P01 -n 1 --rig", rig, "--out", tmp_path, ends=0, says="Press 1, attempt 1: ")
    values = run.json("show", tmp_path / "P01-push.h5")
    assert values["presses_accepted"] == 1
    assert values["bad_presses"][0]["flags"]
    assert values["bad_presses"][0]["reason"] in told.stderr
