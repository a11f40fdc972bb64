"""`haploop record`, `represent`: record presses of one button, and average them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..reports import contents, show
from ..terminal.progress import Steps, note
from . import public as haploop
from .option_groups import Prompts, on_prompts
from .options import AVERAGE, JSON, NEW, NOTES, PATH, ChosenRig, on_rig

if TYPE_CHECKING:
    from ..acquisition import AverageMethod


@click.command()
@click.argument("button")
@click.option("--participant", "-p", required=True, help="Pseudonym of the participant, for example P01.")
@click.option(
    "--presses",
    "-n",
    type=click.IntRange(1, 1000),
    default=10,
    show_default=True,
    help="Number of accepted presses.",
)
@click.option(
    "--out", "-o", type=PATH, default=Path("recordings"), show_default=True, help="Folder for the recording."
)
@click.option("--name", default="", help="Name of the file, if not PARTICIPANT-BUTTON.")
@NOTES
@on_prompts
@on_rig()
@JSON
def record(
    button: str,
    participant: str,
    presses: int,
    out: Path,
    name: str,
    notes: str,
    prompts: Prompts,
    rig: ChosenRig,
    as_json: bool,
) -> int:
    """Record presses of one BUTTON.

    The file is OUT/PARTICIPANT-BUTTON.h5. BUTTON may be any name; a new button needs no preparation. A
    press that fails its quality check is kept, marked, and asked for again. At a console, type r and
    Enter to reject the preceding press.
    """
    with rig.opened() as opened, show.Meter(opened) as meter:
        rig.state.recordings = out
        path = out / haploop.acquisition.file_name(participant, button, name)
        aside = haploop.acquisition.set_aside(path)
        if aside is not None:
            note(f"An interrupted recording without a press was renamed to {aside}.")
        if path.exists():
            raise haploop.ConfigurationError(
                f"{path} already exists and is not overwritten: give this recording a name of its own with "
                f"--name, such as {path.stem}-2."
            )
        protocol = haploop.acquisition.Protocol(
            wait=600.0, segmentation=haploop.acquisition.segmentation_for(button)
        )
        recording = haploop.record(
            opened,
            button,
            participant,
            presses,
            out,
            progress=meter.progress,
            on_verdict=meter.on_verdict,
            on_request=meter.on_request,
            protocol=prompts.adapt(protocol),
            notes=notes,
            name=name,
        )
    show.print_contents(contents.file_contents(recording.path), as_json)
    return 0


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=PATH)
@click.option(
    "--out",
    "-o",
    type=NEW,
    default=Path("press.h5"),
    show_default=True,
    metavar="FILE.h5",
    help="Representative press file to write.",
)
@AVERAGE
@JSON
def represent(recordings: Sequence[Path], out: Path, average: AverageMethod, as_json: bool) -> int:
    """Compute the representative press of recordings.

    RECORDINGS are of one button, by any number of participants; a folder stands for its
    recordings. The result states the method, the reason for
    it, and the residual of each method that was compared. For a study, use `haploop study represent`.
    """
    opened: list[haploop.Recording] = []
    for path in recordings:
        opened += contents.recordings_in([path]) if path.is_dir() else [haploop.Recording.open(path)]
    with Steps() as steps:
        press = haploop.representative(opened, method=average, progress=steps)
    press.save(out)
    show.print_contents(contents.file_contents(out), as_json)
    return 0
