"""`haploop record`: presses of one button."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from haploop.commands.options import JSON, PATH, RIG, SIMULATE, alone, opened_rig
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
    rig: str,
    simulate: Mode | None,
    as_json: bool,
) -> int:
    """Record presses of one BUTTON into OUT/PARTICIPANT-BUTTON.h5."""
    import haploop  # noqa: PLC0415
    from haploop import show as display  # noqa: PLC0415
    from haploop.console import Steps  # noqa: PLC0415

    step = f"Record the {button} button, {participant}"
    with (
        alone(rig, simulate) as file,
        opened_rig(session, file, simulate) as opened,
        Steps() as steps,
    ):
        out.mkdir(parents=True, exist_ok=True)
        session.recordings = out
        recording = haploop.record(
            opened, button, participant, presses, out, lambda done, of: steps(step, done, of)
        )
    display.show(recording.path, as_json)
    return 0
