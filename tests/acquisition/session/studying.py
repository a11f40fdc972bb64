"""A study in a process of its own, to be killed. Imported by that process, so it has no pytest."""

from multiprocessing.connection import Connection
from pathlib import Path

from haploop.acquisition import load_study, run_study
from haploop.instruments import open_rig


def run(folder: Path, seed: int, there: Connection) -> None:
    """Go on with a study, and tell of every press."""
    with open_rig("simulated", simulate="twin", simulation={"seed": seed, "bad_press_rate": 0.1}) as rig:
        run_study(rig, load_study(folder), on_verdict=lambda *_: there.send("press"))
    there.send("done")


def recording_until_told(folder: Path, there: Connection) -> None:
    """Record a study, and stop between two presses until told to go on."""

    def stop(*_press: object) -> None:
        if not told:
            told.append(there.send("recording"))
            there.recv()

    told: list[None] = []
    with open_rig("simulated", simulate="twin") as rig:
        run_study(rig, load_study(folder), on_verdict=stop)
