"""What a script needs has an example in its docstring; all run, in the order of a day's work."""

import doctest
from importlib.util import find_spec
from operator import attrgetter

import pytest

import haploop

DAY = (
    # A rig; presses; a table; digital buttons; keeping them; people; files.
    *("open_rig", "load_rig_file", "new_rig_on", "examine", "watch_live"),
    *("record", "load_study", "run_study", "accepted_presses", "load_press", "representative"),
    *("calibrate", "calibration.calibrate_finger", "load_calibrations", "map_plan", "measure_map"),
    *("build_button", "calibration.plan_button", "play_button", "drive_for", "check"),
    *("calibration.check_feeling", "History", "calibration.adopt", "recalibrate", "calibration.activate"),
    *("experiments.load_experiment", "experiments.open_session", "experiments.run_session"),
    *("experiments.read_rows", "experiments.analyse_identification", "experiments.analyse_ratings"),
    *("experiments.analyse_thresholds", "load", "list_files", "import_file", "export_file", "verify"),
    *("write_report", "plot", "Recording", "Representative", "Calibration", "calibration.VibrationMap"),
    *("DigitalButton", "HaploopError", "InstrumentError"),
)
OTHER = {"ConfigurationError", "DataError", "LimitError", "RealClock"}
"""Flat names without an example of their own."""

NEEDS = {"experiments.analyse_thresholds": "psignifit"}
"""Packages that an example needs beside haploop."""


@pytest.mark.long
def test_each_example_runs(tmp_path, monkeypatch):
    """In one folder, empty at first: an example may use the files that those before it have written.

    `rig` is open; its table has the fewest modes, so that all of it takes seconds.
    """
    monkeypatch.chdir(tmp_path)
    runner, told = doctest.DocTestRunner(verbose=False), list[str]()
    with haploop.open_rig("simulated", simulation={"highest_hz": 843.2}) as rig:
        for name in DAY:
            if name in NEEDS and find_spec(NEEDS[name]) is None:
                continue
            text = attrgetter(name)(haploop).__doc__
            found = doctest.DocTestParser().get_doctest(
                text, {"haploop": haploop, "rig": rig}, name, None, None
            )
            assert found.examples, f"haploop.{name} has no example in its docstring."
            runner.run(found, out=told.append)
    flat = {name for name in dir(haploop) if not hasattr(getattr(haploop, name), "__path__")}
    assert flat == {name for name in DAY if "." not in name} | OTHER
    assert runner.tries >= 100 and not told, "".join(told)
