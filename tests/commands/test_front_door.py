"""What the command line can do, a script can do with `import haploop` alone."""

import json
import re
import subprocess
import sys
from operator import attrgetter
from pathlib import Path

import pytest

import haploop
from haploop.commands.cli import cli
from tests.commands.test_start import commands

ROOT = Path(__file__).parents[2]
WORK = {
    "record": "load_rig_file open_rig record",
    "study run": "load_study open_rig run_study",
    "study represent": "load_study acquisition.Study Representative",
    "represent": "Recording representative Representative",
    "study process": "load_study acquisition.process_study acquisition.Processed",
    "study status": "load_study acquisition.Study",
    "study reject": "load_study acquisition.Study",
    "study repeat": "load_study acquisition.Study",
    "recover": "acquisition.recover Recording",
    "verify": "verify Recording",
    "show": "reports.file_contents load_study",
    "report": "write_report",
    "figures": "reports.write_figures reports.PaperFigures",
    "list": "list_files reports.Entry",
    "calibrate": "open_rig calibrate Calibration calibration.calibration_of load_calibrations",
    "calibrate-finger": "open_rig calibration.calibrate_finger Calibration calibration.VibrationMap",
    "check": (
        "Recording representative drive_for calibration.pressed_drives check calibration.check_under_finger"
    ),
    "map": "open_rig map_plan measure_map calibration.VibrationMap",
    "button make": (
        "load_calibrations representative calibration.Loudness calibration.trade_for "
        "calibration.load_elsewhere build_button DigitalButton"
    ),
    "button plan": "load_press load_calibrations calibration.plan_button calibration.ButtonPlan",
    "button under": "DigitalButton load_calibrations calibration.button_under_finger",
    "button check": "DigitalButton play_button",
    "experiment new": "experiments.load_experiment experiments.example_names",
    "experiment run": (
        "experiments.load_experiment experiments.Store experiments.open_session "
        "experiments.run_session experiments.Session"
    ),
    "experiment simulate": "mocks.ParticipantModel mocks.SimulatedParticipant mocks.load_participant_model",
    "experiment predict": (
        "experiments.predict_answers experiments.Prediction experiments.participant_model DigitalButton"
    ),
    "experiment status": "experiments.Store",
    "experiment export": "experiments.export_answers",
    "experiment withdraw": "experiments.Store",
    "analyse confusion": "experiments.read_rows experiments.analyse_identification",
    "analyse ratings": "experiments.read_rows experiments.analyse_ratings",
    "analyse thresholds": "experiments.read_rows experiments.analyse_thresholds",
    "analyse power": "experiments.load_power_plan experiments.power_of",
    "recalibrate": "History recalibrate instruments.Unattended reports.write_recalibration",
    "calibrations adopt": "History DigitalButton calibration.adopt",
    "calibrations list": "History",
    "calibrations show": "History calibration.Generation calibration.calibrations_of",
    "calibrations diff": "History calibration.calibrations_of",
    "calibrations activate": "History calibration.activate",
    "calibrations plot": "History reports.trend",
    "export": "export_file exchange.Exported",
    "import": (
        "exchange.FileMapping exchange.understand exchange.named import_file exchange.destination "
        "exchange.is_response_file exchange.import_response Calibration"
    ),
    "doctor": "examine calibration.examine_each calibration.examine_loop calibration.Finding",
    "live": "load_rig_file watch_live acquisition.look instruments.levels",
    "log": "instruments.log_entries",
    "reset": "instruments.reset_lockout",
    "schema": "instruments.rig_schema",
    "rig new": "instruments.look_for_hardware instruments.new_rig",
    "rig check": "load_rig_file",
    "tape show": "instruments.played instruments.recorded instruments.tape_rig",
    "tape mask": "instruments.mask",
}
"""The functions and classes that do the work of each command."""
NO_WORK_FOR_A_SCRIPT = {
    "demo": "all of the loop at once, simulated",
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
        assert all(attrgetter(name)(haploop) is not None for name in names.split()), command


@pytest.mark.parametrize("name", dir(haploop))
def test_what_the_tab_key_finds_has_an_example(name):
    assert len(dir(haploop)) < 50 and getattr(haploop, name) is not None
    pages = [*ROOT.glob("docs/**/*.md"), *ROOT.glob("examples/*.ipynb"), ROOT / "README.md"]
    assert any(
        re.search(rf"(?<!::: )haploop\.{name}\b(?!`)|`{name}\(", page.read_text("utf-8")) for page in pages
    ), name


SCRIPT = """
import haploop

with haploop.open_rig("simulated") as rig:
    assert all(f.status == "green" for f in haploop.examine(rig)), haploop.examine(rig)
    recording = haploop.record(rig, "push", "P01", 2, "data")
    press = haploop.representative([recording])
    button = haploop.build_button(rig, press, haploop.calibrate(rig, "A", "button"), iterations=0)
    history = haploop.History("calibrations")
    try:
        haploop.calibration.adopt(history, [button], actor="a script", reason="it begins")
        outcome = haploop.recalibrate(rig, history)
        print(outcome.kind)
        haploop.calibration.activate(history, "1", actor="a script", reason="again")
    except haploop.DataError as error:
        print(error)
print(*[entry["kind"] for entry in haploop.instruments.log_entries("simulated")])
print(haploop.verify(recording.path))
print(haploop.reports.file_contents(str(recording.path)).values["presses_accepted"])
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
    assert json.loads(json.dumps(haploop.instruments.rig_schema()))["title"] == "A rig of haploop"
