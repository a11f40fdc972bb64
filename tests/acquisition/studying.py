"""A study in a process of its own, to be killed. Imported by that process, so it has no pytest."""

from __future__ import annotations

from multiprocessing.connection import Connection
from pathlib import Path

from haploop.acquisition import load_study, run_study
from haploop.instruments import open_rig


def run(folder: Path, seed: int, there: Connection) -> None:
    """Go on with a study, and tell of every press."""
    with open_rig("simulated", simulate="twin", simulation={"seed": seed, "bad_press_rate": 0.1}) as rig:
        run_study(rig, load_study(folder), on_verdict=lambda *_: there.send("press"))
    there.send("done")
