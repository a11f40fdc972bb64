"""What the command line can do, a script can do with `import haploop` alone."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import haploop
from haploop.commands.cli import cli
from tests.commands.test_start import commands

ROOT = Path(__file__).parents[2]
WORK = {
    "demo": ["run_demo", "claim_folder"],
    "record": ["load_rig_file", "open_rig", "record"],
    "study run": ["load_study", "open_rig", "run_study"],
    "study represent": ["load_study", "Study", "Representative"],
    "represent": ["Recording", "representative", "Representative"],
    "study process": ["load_study", "process_study", "Processed"],
    "study status": ["load_study", "Study"],
    "study reject": ["load_study", "Study"],
    "study repeat": ["load_study", "Study"],
    "recover": ["recover", "Recording"],
    "verify": ["verify", "Recording"],
    "show": ["file_contents", "load_study"],
    "report": ["write_report"],
    "figures": ["write_figures", "PaperFigures"],
    "list": ["list_files", "Entry"],
    "calibrate": [
        "open_rig",
        "calibrate",
        "calibrate_finger",
        "Calibration",
        "calibration_of",
        "load_calibrations",
        "VibrationMap",
    ],
    "check": ["Recording", "representative", "drive_for", "pressed_drives", "check", "check_under_finger"],
    "map": ["open_rig", "map_plan", "measure_map", "VibrationMap"],
    "button make": [
        "load_calibrations",
        "representative",
        "Loudness",
        "trade_for",
        "load_elsewhere",
        "build_button",
        "DigitalButton",
    ],
    "button plan": ["load_press", "load_calibrations", "plan_button", "ButtonPlan"],
    "button under": ["DigitalButton", "load_calibrations", "button_under_finger"],
    "button check": ["DigitalButton", "play_button"],
    "experiment new": ["load_experiment", "example_names"],
    "experiment run": ["load_experiment", "Store", "open_session", "run_session", "Session"],
    "experiment simulate": ["ParticipantModel", "SimulatedParticipant", "load_participant_model"],
    "experiment predict": ["predict_answers", "Prediction", "participant_model", "DigitalButton"],
    "experiment status": ["Store"],
    "experiment export": ["export_answers"],
    "experiment withdraw": ["Store"],
    "analyse confusion": ["read_rows", "analyse_identification"],
    "analyse ratings": ["read_rows", "analyse_ratings"],
    "analyse thresholds": ["read_rows", "analyse_thresholds"],
    "analyse power": ["load_power_plan", "power_of"],
    "recalibrate": ["History", "recalibrate", "Unattended", "write_recalibration"],
    "calibrations adopt": ["History", "DigitalButton", "adopt"],
    "calibrations list": ["History"],
    "calibrations show": ["History", "Generation", "calibrations_of"],
    "calibrations diff": ["History", "calibrations_of"],
    "calibrations activate": ["History", "activate"],
    "calibrations plot": ["History", "trend"],
    "export": ["export_file", "Exported"],
    "import": [
        "FileMapping",
        "understand",
        "named",
        "import_file",
        "destination",
        "is_response_file",
        "import_response",
        "Calibration",
    ],
    "doctor": ["examine", "examine_each", "examine_loop", "Finding"],
    "live": ["load_rig_file", "watch_live", "look", "levels"],
    "log": ["log_entries"],
    "reset": ["reset_lockout"],
    "schema": ["rig_schema"],
    "rig new": ["look_for_hardware", "new_rig"],
    "rig check": ["load_rig_file"],
    "tape show": ["played", "recorded", "tape_rig"],
    "tape mask": ["mask"],
}
"""The functions and classes that do the work of each command."""

NO_WORK_FOR_A_SCRIPT = {
    "serve": "a server for a browser",
    "new": "writes forms, to be filled in with an editor",
    "study new": "writes a form, to be filled in with an editor",
    "twin ni": "a server for other programs",
    "twin all": "a server for other programs",
}


def test_each_command_has_its_functions_in_the_front_door():
    groups = {" ".join(path[:-1]) for path in commands(cli)}
    each = {" ".join(path) for path in commands(cli)} - groups
    assert each == WORK.keys() | NO_WORK_FOR_A_SCRIPT.keys()
    for command, names in WORK.items():
        assert names, command
        assert set(names) <= set(haploop.__all__), command


@pytest.mark.parametrize("name", haploop.__all__)
def test_each_name_of_the_front_door_is_there(name):
    assert getattr(haploop, name) is not None


@pytest.mark.parametrize("name", dir(haploop))
def test_what_the_tab_key_finds_has_an_example(name):
    assert name in haploop.__all__ and len(dir(haploop)) < 60
    pages = [*ROOT.glob("docs/**/*.md"), *ROOT.glob("examples/*.ipynb"), ROOT / "README.md"]
    assert any(
        re.search(rf"(?<!::: )haploop\.{name}\b(?!`)|`{name}\(", page.read_text("utf-8")) for page in pages
    ), name


def test_a_person_and_a_clock_are_in_the_front_door():
    assert {"Operator", "Clock", "RealClock"} <= set(haploop.__all__)


SCRIPT = """
import haploop

with haploop.open_rig("simulated") as rig:
    assert all(f.status == "green" for f in haploop.examine(rig)), haploop.examine(rig)
    recording = haploop.record(rig, "push", "P01", 2, "data")
    press = haploop.representative([recording])
    button = haploop.build_button(rig, press, haploop.calibrate(rig, "A", "button"), iterations=0)
    history = haploop.History("calibrations")
    try:
        haploop.adopt(history, [button], actor="a script", reason="it begins")
        outcome = haploop.recalibrate(rig, history)
        print(outcome.kind)
        haploop.activate(history, "1", actor="a script", reason="again")
    except haploop.DataError as error:
        print(error)
print(*[entry["kind"] for entry in haploop.log_entries("simulated")])
print(haploop.verify(recording.path))
print(haploop.file_contents(str(recording.path)).values["presses_accepted"])
"""


@pytest.mark.long
def test_a_script_does_a_day_of_work_with_one_import(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    kind, kinds, problems, presses = done.stdout.splitlines()
    assert (kind, problems, presses) == ("unchanged", "()", "2")
    kept = [word for word in kinds.split() if word in ("opened", "adopted", "activated", "closed")]
    assert kept[-4:] == ["opened", "adopted", "activated", "closed"] and "played" in kinds


def test_the_schema_is_the_one_that_the_command_prints():
    assert json.loads(json.dumps(haploop.rig_schema()))["title"] == "A rig of haploop"
