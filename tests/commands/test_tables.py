"""Text for people: whatever names hold, and however narrow the terminal is."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner
from rich.box import SIMPLE
from rich.table import Table

from haploop.base.json_files import as_line
from haploop.commands.cli import cli
from haploop.instruments import load_rig_file
from haploop.instruments.safety import Audit, state_folder
from haploop.terminal.progress import Steps, note, print_line, print_table

HOSTILE = "lab [/x] [red] :smile:"


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rig") / "lab [red] :smile:.toml"
    text = f'base = "simulated"\nname = {json.dumps(HOSTILE)}\n'
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def calibration(rig: Path) -> Path:
    """One for all chains of commands: it takes seconds."""
    path = rig.with_name("c [red].h5")
    result = CliRunner().invoke(cli, ["calibrate", "--out", str(path), "--rig", str(rig)])
    assert result.exit_code == 0, result.output
    return path


@pytest.mark.long
def test_no_name_is_taken_for_markup(run, rig, calibration, tmp_path):
    out, study = tmp_path / "out [/x]", tmp_path / "study [/x]"
    recording = out / "P01-push.h5"
    run("study new", study, ends=0)
    text = (study / "study.toml").read_text(encoding="utf-8").replace("presses = 10 ", "presses = 1 ")
    (study / "study.toml").write_text(text, encoding="utf-8")
    recorded = ["record", "push", "-p", "P01", "-n", 1, "-o", out, "--notes", HOSTILE, "--rig", rig]
    said = {}
    for args in (recorded, ["show", recording], ["show", recording, recording],
        ["study", "run", "-s", study, "-p", "P01", "-b", "push", "--rig", rig, "--notes", HOSTILE],
        ["study", "status", "-s", study],
        ["study", "reject", "P01", "push", 1, "--reason", HOSTILE, "-s", study],
        ["study", "status", "-s", study], ["show", study / "recordings" / "P01-push.h5"],
        ["verify", recording], ["doctor", "--rig", rig], ["show", calibration],
        ["export", calibration, "--to", "uff", "--out", tmp_path / "c [red].uff"],
        ["import", tmp_path / "c [red].uff", "--out", tmp_path / "i [red].h5", "--rig", rig],
        ["map", "--out", tmp_path / "map [red]", "--points", "0-1", "--patches", "A", "--rig", rig],
        ["show", tmp_path / "map [red]"], ["log", "--rig", rig]):  # fmt: skip
        result = run(*args, ends=0)
        said[tuple(args)] = result.stdout
    assert f"Notes                 {HOSTILE}" in said["show", recording]
    assert f"The rig {HOSTILE}" in said["doctor", "--rig", rig]
    for args in (recorded, ["show", tmp_path / "none [/x].h5"], ["log", "--rig", tmp_path / "[/x].toml"]):
        run(*args, says="[/x]")


@pytest.mark.long
def test_no_name_of_a_button_or_calibration_is_taken_for_markup(run, demo, rig, calibration, tmp_path):
    button = tmp_path / "b [red].h5"
    presses = demo.folder / "recordings" / "P01-latch.h5"
    history = ["--calibrations", tmp_path / "history [red]", "--rig", rig]
    for args in (
        ["button", "make", presses, "-c", calibration, "--out", button, "--iterations", 0, "--rig", rig],
        ["show", button],
        ["button", "check", button, "--rig", rig, "--plays", 3, "--out", tmp_path / "c [red].h5"],
        ["calibrations", "adopt", button, "--reason", HOSTILE, *history],
        ["calibrations", "list", *history],
        ["calibrations", "show", *history],
        ["calibrations", "diff", 1, *history],
        ["recalibrate", *history],
    ):
        result = run(*args)
        assert result.exit_code in (0, 1, 4), (args, result.stderr)
    assert HOSTILE in run("calibrations show", *history).stdout


def test_progress_and_sentences_are_no_markup(capsys):
    with Steps() as steps:
        steps(HOSTILE, 1, 1, "presses")
    note(HOSTILE)
    print_line(HOSTILE)
    table = Table(box=SIMPLE, title=HOSTILE)
    table.add_column(HOSTILE)
    table.add_row(HOSTILE)
    print_table(table)
    told = capsys.readouterr()
    assert told.err.count(HOSTILE) == 2
    assert told.out.count(HOSTILE) == 4


def words(text: str) -> set[str]:
    return set(text.replace("─", " ").split())


@pytest.mark.parametrize("width", [50, 80, 160])
def test_no_table_cuts_a_word(capsys, monkeypatch, width):
    monkeypatch.setenv("COLUMNS", str(width))
    headings = ["participant", "consented", "doorbell_of_the_house", "order"]
    cells = ["P01", "yes", "10/10 (interrupted)", "latch, doorbell_of_the_house, toggle"]
    table = Table(box=SIMPLE, title="A study of buttons")
    for heading in headings:
        table.add_column(heading)
    table.add_row(*cells)
    table.add_row(*cells)
    print_table(table)
    printed = capsys.readouterr().out
    assert words(" ".join([*headings, *cells])) <= words(printed)
    assert max(map(len, printed.splitlines())) <= width


@pytest.mark.long
def test_the_commands_tables_fit_80_columns(run, demo, tmp_path, monkeypatch):
    study = tmp_path / "study.toml"
    study.write_text(
        'name = "wide"\nbuttons = ["latch", "toggle", "push", "doorbell_of_the_house", "knob"]\n'
        'participants = ["P01"]\n',
        encoding="utf-8",
    )
    wide = run("study status -s", study).stdout
    monkeypatch.setenv("COLUMNS", "80")
    narrow = run("study status -s", study).stdout
    assert words(wide) - {"-"} <= words(narrow)
    for args in (["show", demo.folder / "recordings" / "P01-latch.h5"],
        ["show", demo.folder / "calibration.h5"], ["doctor"], ["log"],
        ["study", "status", "-s", study]):  # fmt: skip
        printed = [line for line in run(*args).stdout.splitlines() if not line.startswith(("The rig ", "`"))]
        assert max(map(len, printed)) <= 80, args


def test_the_log_holds_no_python(run, rig):
    file = load_rig_file(rig)
    folder = state_folder(file, simulated=True)
    Audit(file, folder, simulated=True).note(
        "opened", instruments={"daq": "PCI-6034E", "operator": ""}, patches=["A", "B"], none=[], level=0.125
    )
    with next(folder.glob("log-*.jsonl")).open("a", encoding="utf-8") as log:
        log.write(as_line({"rig": file.name, "time": "yesterday", "kind": "odd", "checked": True}))
    shown = run("log --rig", rig, ends=0)
    assert "instruments: daq PCI-6034E; patches: A, B; none: none; level: 0.125" in shown.stdout
    assert "yesterday" in shown.stdout and "checked: yes" in shown.stdout
    assert not set("{}'") & set(shown.stdout.split("\n", 1)[1])
    entries = run.json("log --rig", rig)["entries"]
    assert entries[-1]["checked"] is True
