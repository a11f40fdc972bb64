"""haploop: from a physical button to a verified digital one.

This package re-exports the public names of all subpackages, so that a script needs one import. Names are
loaded on first use, so that `import haploop` is fast; `__init__.pyi` lists them.
"""

from .base import at_once

if at_once.is_the_command():  # before what takes a moment to load
    at_once.end_at_once()

import lazy_loader

__version__ = "0.1.0"

__getattr__, _, __all__ = lazy_loader.attach_stub(__name__, __file__)

_AT_THE_TAB_KEY = (
    # A rig; presses; a table; digital buttons; keeping them; people; files. In the order of a day's work.
    *("open_rig", "load_rig_file", "new_rig_on", "examine", "watch_live"),
    *("record", "load_study", "run_study", "accepted_presses", "load_press", "representative"),
    *("calibrate", "calibrate_finger", "load_calibrations", "map_plan", "measure_map"),
    *("build_button", "plan_button", "play_button", "drive_for", "check", "check_feeling"),
    *("History", "adopt", "recalibrate", "activate"),
    *("load_experiment", "open_session", "run_session", "read_rows"),
    *("analyse_identification", "analyse_ratings", "analyse_thresholds"),
    *("load", "list_files", "import_file", "export_file", "verify", "write_report", "plot"),
    *("Recording", "Representative", "Calibration", "VibrationMap", "DigitalButton"),
    *("HaploopError", "InstrumentError"),
)


def __dir__() -> list[str]:
    """What the tab key finds: what a script needs. `__all__` has everything, with what each returns."""
    return [*_AT_THE_TAB_KEY]
