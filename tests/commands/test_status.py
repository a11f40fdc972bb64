"""`haploop` alone says what is in a folder and what comes next, as a person works through it."""

import pytest

from haploop.commands.status import Found, next_steps
from haploop.reports.catalogue import Entry


def entry(kind: str, file: str, button: str = "", verdict: str = "") -> Entry:
    return Entry(file, kind, button=button, verdict=verdict)


def recordings(number: int) -> list[Entry]:
    files = [f"recordings/P{one:02d}-latch.h5" for one in range(1, number + 1)]
    return [entry("recording", file, "latch", "complete") for file in files]


TABLE = entry("calibration", "calibration.h5")
PRESS = entry("representative", "latch-press.h5", "latch")
BUTTON = entry("button", "latch.h5", "latch", "pass")


@pytest.mark.parametrize(
    ("found", "steps"),
    [
        (Found(rig="lab.toml"), [("No button is recorded", "haploop record latch -p P01 --rig lab.toml")]),
        (Found(study=frozenset({"latch"}), due=["P01 latch", "P01 push", "P02 latch", "P02 push"]),
         [("The study is not complete: P01 latch, P01 push, P02 latch and 1 more due", "haploop study run")]),
        (Found(recordings(2), rig="my lab.toml"),
         [("2 recordings of latch, none averaged",
         "haploop represent recordings/P01-latch.h5 recordings/P02-latch.h5 -o latch-press.h5"),
         ("The table is not calibrated", "haploop calibrate --rig 'my lab.toml'")]),
        (Found([*recordings(1), TABLE], study=frozenset({"latch"})),
         [("1 recording of latch, none averaged", "haploop study represent latch --out latch-press.h5")]),
        (Found([*recordings(1), TABLE, PRESS]),
         [("The press of latch is not made digital yet",
         "haploop button make latch-press.h5 -c calibration.h5 -o latch.h5")]),
        (Found([TABLE, PRESS, entry("button", "latch.h5", "latch", "fail")]),
         [("The digital latch did not pass (fail): look at why", "haploop report latch.h5")]),
        (Found([TABLE, BUTTON]), [("The digital latch passes, and is not the active one",
         'haploop calibrations adopt latch.h5 --reason "first"')]),
        (Found([TABLE, BUTTON], rig="lab.toml", active=frozenset({"latch"}), history="lab-calibrations"),
         [("The table's calibration is in lab-calibrations; each night",
         "haploop recalibrate --rig lab.toml")]),
        (Found([entry("damaged", "a b.h5"), TABLE, BUTTON], active=frozenset({"latch"})),
         [("a b.h5 is damaged", "haploop verify 'a b.h5'")]),
    ],
)  # fmt: skip
def test_what_is_not_finished_comes_with_its_command(found, steps):
    assert next_steps(found) == steps


def test_sessions_of_an_experiment_are_due(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run("experiment new matching --from matching")
    said = run().stdout
    assert "Nobody has answered matching:\n    haploop experiment run matching --participant P01" in said
    run("experiment simulate matching --participants 1")
    said = run().stdout
    assert "Nobody" not in said and "Nothing is due" in said and "    haploop serve" in said


def test_an_empty_folder_has_help_and_two_beginnings(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run()
    assert result.exit_code == 0 and "Make a button, in this order" in result.stdout
    assert "Begin with: haploop demo, or haploop new FOLDER." in result.stdout


def test_a_new_folder_says_what_is_due(run, tmp_path, monkeypatch):
    made = tmp_path / "lab"
    run("new", made, "--buttons", "latch", "--participants", 1, "--rig", "simulated")
    monkeypatch.chdir(made)
    said = run().stdout
    assert said.startswith("In this folder: rig file rig.toml, 1 study.")
    assert "The study is not complete: P01 latch due:\n    haploop study run" in said


def test_a_folder_of_a_curve_names_it(run, tmp_path, monkeypatch):
    rows = [f"{x / 50:.2f},{0.4 + x / 100:.3f}" for x in [*range(200), *range(200, 0, -1)]]
    (tmp_path / "switch.csv").write_text("\n".join(["Travel (mm),Force (N)", *rows]))
    monkeypatch.chdir(tmp_path)
    run("import switch.csv --as curve --out switch.h5", ends=0)
    assert run().stdout.startswith("In this folder: 1 curve.")


def test_a_rigs_file_may_be_called_experiment(run, tmp_path, monkeypatch):
    (tmp_path / "experiment.toml").write_text('base = "simulated"\n[camera]\ndriver = "opencv"\nsource = 0\n')
    (tmp_path / "torn").mkdir()
    (tmp_path / "torn" / "experiment.toml").write_text('name = "torn"\nkind = ')
    monkeypatch.chdir(tmp_path)
    said = run().stdout
    assert said.startswith("In this folder: rig file experiment.toml.")
    assert "torn/experiment.toml is damaged" in said and said.count("is damaged") == 1
