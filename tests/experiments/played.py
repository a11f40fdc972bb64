"""An experiment whose digital buttons the rig plays, for the tests of each way to run it."""

import shutil
from pathlib import Path

__all__ = ["PLAYED", "played"]

PLAYED = """
name = "played"
kind = "identification"
seed = 3
consent = false
[buttons]
latch = "latch.h5"
push = "push.h5"
[[factor]]
name = "button"
levels = ["latch", "push"]
[question]
text = "Which was it?"
identify = "button"
[[block]]
name = "finger calibration"
kind = "finger"
repetitions = 2
[[block]]
name = "experiment"
repetitions = 1
"""


def played(folder: Path, made: Path, text: str = PLAYED) -> Path:
    """Write an experiment's file, and copy the digital buttons beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("latch.h5", "push.h5"):
        shutil.copy(made / name, folder)
    (folder / "experiment.toml").write_text(text, encoding="utf-8")
    return folder
