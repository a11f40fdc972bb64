"""`haploop new`: a folder whose files are valid, whose README's commands are, and that replaces nothing."""

import html
import re
import shlex
from pathlib import Path

import pytest

import haploop
from haploop.commands.cli import cli
from tests.command_line import Run


@pytest.fixture
def lab(run: Run, tmp_path: Path) -> Path:
    made = tmp_path / "my lab"
    result = run("new", made, "--buttons", "click, snap", "--participants", 12, "--rig", "simulated")
    assert result.exit_code == 0 and "start.html says what to run" in result.stdout
    return made


def test_all_files_are_valid_and_name_what_was_asked_for(lab):
    study = haploop.load(lab)
    assert study.file.buttons == ("click", "snap") and len(study.file.participants) == 12
    assert haploop.load_rig_file(lab / "rig.toml").name == "my lab"
    assert study.file.rig == "rig.toml"
    experiment = haploop.load(lab / "experiment")
    assert 'levels = ["click", "snap"]' in experiment.path.read_text(encoding="utf-8")


def test_one_button_and_few_presses_need_no_experiment(run, tmp_path):
    where = ("--buttons", "click", "--participants", 1, "--presses", 2, "--rig", "simulated")
    run("new", tmp_path / "lab", *where, ends=0)
    assert haploop.load_study(tmp_path / "lab").file.presses == 2
    assert "experiment run" not in (tmp_path / "lab" / "README.md").read_text(encoding="utf-8")


def test_each_command_of_its_readme_is_one_with_its_options(lab):
    readme = (lab / "README.md").read_text(encoding="utf-8")
    told = [shlex.split(one)[1:] for one in re.findall(r"`(haploop [^`]*)`", readme)]
    assert len(told) > 10
    for words in told:
        group, name = cli, words.pop(0)
        if name == "COMMAND":
            continue
        while name in getattr(group, "commands", {}):
            group = group.commands[name]
            if not hasattr(group, "commands"):
                break
            name = words.pop(0)
        options = {option for parameter in group.params for option in parameter.opts}
        assert {word for word in words if word.startswith("-")} <= options, (group.name, words)


def test_its_page_has_the_commands_of_its_readme(lab):
    page = html.unescape((lab / "start.html").read_text(encoding="utf-8")).replace("\N{NO-BREAK SPACE}", " ")
    listed = re.findall(r"^\d+\. `(.*)`: (.*)$", (lab / "README.md").read_text(encoding="utf-8"), re.M)
    assert len(listed) == 10
    cells = re.sub(r' data-of="[^"]*"', "", page)
    assert all(f"<td>{command}</td><td>{told}</td>" in cells for command, told in listed)


def test_the_study_is_recorded_and_represented_there(lab, run, monkeypatch):
    monkeypatch.chdir(lab)
    text = (lab / "study.toml").read_text(encoding="utf-8").replace("presses = 10 ", "presses = 1 ", 1)
    (lab / "study.toml").write_text(text, encoding="utf-8")
    run("study run -p P01 -b click", ends=0)
    run("study represent click --out click-press.h5", ends=0)


def test_nothing_is_replaced(run, lab, tmp_path):
    run("new", lab, "--buttons", "a", "--participants", 1, "--rig", "simulated", says="already exists")
    path = tmp_path / "mine.toml"
    run("rig new", path, "--like", "usb-6211", ends=0)
    run("rig new", path, "--like", "usb-6211", says="is not overwritten")


def test_a_name_with_a_space_is_quoted_in_the_command_to_go_on_with(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = run("rig new", "my lab.toml", "--like", "no-ni")
    assert made.exit_code == 0 and "haploop rig check 'my lab.toml'" in made.output
    made = run("new", "my study", "--buttons", "a", "--participants", 1, "--rig", "simulated")
    assert made.exit_code == 0 and "cd 'my study'," in " ".join(made.output.split())
