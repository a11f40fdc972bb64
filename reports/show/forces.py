"""Force at activation in several recordings, by participant and button."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.box import SIMPLE
from rich.table import Table

from ...acquisition import Recording, activation_forces, hdf5, load_study
from ...instruments import DataError
from ...instruments.arrays import FloatArray
from ...terminal.progress import SIMULATED, print_json, print_line, print_table
from .. import figures, outputs
from .folders import files_of

if TYPE_CHECKING:
    from ..figures import Columns

__all__ = ["Forces", "forces_in", "show_forces"]

Forces = Mapping[str, Mapping[str, FloatArray]]
"""Force at activation (N) of each press: button -> participant -> (presses,)."""


def forces_in(recordings: Sequence[Recording]) -> Forces:
    """Collect the force at activation of every accepted press. Raises DataError."""
    found: dict[str, dict[str, list[float]]] = {}
    for recording in recordings:
        mine = found.setdefault(recording.button, {}).setdefault(recording.participant, [])
        mine += activation_forces(recording)
    return {
        button: {participant: np.array(mine) for participant, mine in sorted(by.items()) if mine}
        for button, by in found.items()
        if any(by.values())
    }


def show_forces(paths: Sequence[Path], as_json: bool, plot: Path | None, columns: Columns = 2) -> None:
    """Print and plot (the paper's figure 7) the force at activation by participant and button.

    `paths` are recordings, folders of them, or studies with all their recordings. Raises DataError when they
    hold no accepted press, and ConfigurationError when `plot` cannot be written.
    """
    if plot is not None:
        outputs.check_new_picture(plot)
    recordings = [recording for path in paths for recording in _recordings(path)]
    by_button = forces_in(recordings)
    if not by_button:
        raise DataError(
            "The recordings hold no accepted press with an activation, so there is no force to show."
        )
    simulated = any(recording.simulated for recording in recordings)
    if plot is not None:
        outputs.save_picture(figures.activation_forces(by_button, columns=columns), plot, simulated)
    if as_json:
        print_json(
            {
                "kind": "recordings",
                "simulated": simulated,
                "files": [str(recording.path) for recording in recordings],
                "buttons": {
                    button: {
                        **_summary(np.concatenate(list(by.values()))),
                        "participants": {name: _summary(mine) for name, mine in by.items()},
                    }
                    for button, by in by_button.items()
                },
                **({"plot": str(plot)} if plot else {}),
            }
        )
        return
    table = Table(box=SIMPLE, title="Force at activation", title_justify="left")
    table.add_column("Participant")
    for button in by_button:
        table.add_column(button.capitalize(), justify="right", no_wrap=True)
    for name in sorted({name for by in by_button.values() for name in by}):
        table.add_row(name, *(_force(by.get(name)) for by in by_button.values()))
    table.add_section()
    table.add_row("All", *(_force(np.concatenate(list(by.values()))) for by in by_button.values()))
    print_table(table)
    if simulated:
        print_line(SIMULATED)
    if plot is not None:
        print_line(f"Plot: {plot}")


def _recordings(path: Path) -> list[Recording]:
    """Open a recording, or all recordings of a study or in a folder."""
    found: list[Recording] = []
    for one in files_of(path):
        if one.is_dir() or one.suffix == ".toml":
            study = load_study(one)
            found += (recording for button in study.file.buttons for recording in study.recordings(button))
            continue
        kind = hdf5.kind_of(one)
        if kind != "recording":
            raise DataError(
                f"{one} holds a {kind}, and several files are shown together only when all are recordings: "
                "show it alone, or name all of them to `haploop report`."
            )
        found.append(Recording.open(one))
    return found


def _summary(mine: FloatArray) -> dict[str, Any]:
    return {
        "presses": len(mine),
        "activation_force_n": float(np.mean(mine)),
        "activation_force_sd_n": float(np.std(mine, ddof=1)) if len(mine) > 1 else None,
    }


def _force(mine: FloatArray | None) -> str:
    if mine is None or not len(mine):
        return "-"
    spread = f" ± {np.std(mine, ddof=1):.2f}" if len(mine) > 1 else ""
    return f"{np.mean(mine):.2f}{spread} N ({len(mine)})"
