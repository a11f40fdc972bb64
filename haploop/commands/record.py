"""`haploop record`: record presses of one button."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from haploop.commands.options import JSON, NOTES, PATH, RIG, SIMULATE, WAIT, alone, opened_rig
from haploop.exits import CommandState

if TYPE_CHECKING:
    from haploop.instruments.driver import Mode

__all__ = ["record"]


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
@NOTES
@WAIT
@RIG
@SIMULATE
@JSON
@click.pass_obj
def record(
    state: CommandState,
    button: str,
    participant: str,
    presses: int,
    out: Path,
    notes: str,
    wait: float | None,
    rig: str,
    simulate: Mode | None,
    as_json: bool,
) -> int:
    """Record presses of one BUTTON into OUT/PARTICIPANT-BUTTON.h5.

    BUTTON may be any name; a new button needs no preparation. A press that fails its quality check is
    kept, marked, and asked for again. At a console, type r and Enter to reject the preceding press.
    """
    import haploop  # noqa: PLC0415
    from haploop.acquisition import segmentation_for, set_aside  # noqa: PLC0415
    from haploop.acquisition.recording import file_name  # noqa: PLC0415
    from haploop.progress import Steps, note  # noqa: PLC0415
    from haploop.show import show as display  # noqa: PLC0415
    from haploop.show.study import rejection_line  # noqa: PLC0415

    step = f"Record the {button} button, {participant}"
    with (
        alone(rig, simulate) as file,
        opened_rig(state, file, simulate) as opened,
        Steps() as steps,
    ):
        state.recordings = out
        aside = set_aside(out / file_name(participant, button))
        if aside is not None:
            note(f"An interrupted recording without a press was renamed to {aside}.")
        protocol = haploop.Protocol(
            wait=600.0 if wait is None else wait, segmentation=segmentation_for(button)
        )
        recording = haploop.record(
            opened,
            button,
            participant,
            presses,
            out,
            lambda done, of: steps(step, done, of),
            lambda press: None if press.accepted else note(rejection_line(press)),
            protocol=protocol,
            notes=notes,
        )
    display.show(recording.path, as_json)
    return 0
