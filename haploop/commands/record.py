"""`haploop record`: presses of one button."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from haploop.commands.options import JSON, NOTES, PATH, RIG, SIMULATE, alone, opened_rig
from haploop.exits import Session

if TYPE_CHECKING:
    from instruments.driver import Mode

__all__ = ["record"]


@click.command()
@click.argument("button")
@click.option("--participant", "-p", required=True, help="Pseudonym of who presses, P01 for example.")
@click.option("--presses", "-n", type=click.IntRange(min=1), default=10, show_default=True)
@click.option(
    "--out", "-o", type=PATH, default=Path("recordings"), show_default=True, help="Folder for the recording."
)
@NOTES
@RIG
@SIMULATE
@JSON
@click.pass_obj
def record(
    session: Session,
    button: str,
    participant: str,
    presses: int,
    out: Path,
    notes: str,
    rig: str,
    simulate: Mode | None,
    as_json: bool,
) -> int:
    """Record presses of one BUTTON into OUT/PARTICIPANT-BUTTON.h5.

    Any name is a button: nothing has to be prepared for a new one. A press that is not a good one is
    kept, marked, and asked for again. At a console, type r and Enter to reject the press before.
    """
    import haploop  # noqa: PLC0415
    from haploop import show as display  # noqa: PLC0415
    from haploop.console import Steps, note  # noqa: PLC0415
    from haploop.show_study import told  # noqa: PLC0415

    step = f"Record the {button} button, {participant}"
    with (
        alone(rig, simulate) as file,
        opened_rig(session, file, simulate) as opened,
        Steps() as steps,
    ):
        out.mkdir(parents=True, exist_ok=True)
        session.recordings = out
        recording = haploop.record(
            opened,
            button,
            participant,
            presses,
            out,
            lambda done, of: steps(step, done, of),
            lambda press: None if press.accepted else note(told(press)),
            notes=notes,
        )
    display.show(recording.path, as_json)
    return 0
