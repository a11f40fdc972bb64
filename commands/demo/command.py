"""`haploop demo`: the complete workflow on a simulated rig."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ... import instruments
from ...reports import show
from ...terminal.exits import CommandState
from ...terminal.progress import Steps, note, print_json, print_line
from .. import public as haploop
from ..options import EXITS, JSON, PATH, RIG, SIMULATE, TAPED, Names, tape_session

if TYPE_CHECKING:
    from ...instruments.driver import Mode


@click.command()
@click.option("--out", "-o", type=PATH, help="Folder for the results.  [default: a new haploop-demo]")
@click.option(
    "--seed", type=click.IntRange(min=0), help="Seed of the simulation.  [default: the seed in the rig file]"
)
@click.option(
    "--participants",
    type=click.IntRange(1, 99),
    default=1,
    show_default=True,
    help="Number of simulated participants.",
)
@click.option(
    "--patches",
    type=Names(),
    metavar="LIST",
    help="Patches to play at once, for example A.  [default: all that have an amplifier channel, or A]",
)
@click.option("--figures", is_flag=True, help="Draw the figures into the report, with the true values.")
@RIG
@SIMULATE
@TAPED
@JSON
@click.pass_obj
def demo(
    state: CommandState,
    out: Path | None,
    seed: int | None,
    participants: int,
    patches: Sequence[str] | None,
    figures: bool,
    rig: str,
    simulate: Mode | None,
    tape: Path | None,
    as_json: bool,
) -> int:
    """Run the complete workflow on a simulated rig.

    Writes recordings, representative presses, a calibration, drives and a report into a folder. With `--rig
    four-channel`, four patches play at once, some five times as loud.
    """
    file = haploop.load_rig_file(rig)
    if tape is not None:
        instruments.check_recordable(file, simulate or "twin")
    from .run import claim_folder, run_demo  # noqa: PLC0415

    folder = claim_folder(out)
    state.recordings = folder / "recordings"
    with tape_session(None, tape), Steps() as steps:

        def progress(doing: str, done: float, total: float, unit: str) -> None:
            state.rig_opened = True
            steps(doing, done, total, unit)

        summary = run_demo(
            folder,
            rig,
            seed=seed,
            participants=participants,
            patches=patches,
            figures=figures,
            mode=simulate,
            progress=progress,
        )
    from .report import demo_contents  # noqa: PLC0415

    if as_json:
        print_json(summary)
        note(f"Everything here is simulated ({summary['mode']}, seed {summary['seed']}).")
    else:
        show.print_contents(demo_contents(summary), as_json)
        print_line(f"Report: {summary['report']}")
    return EXITS[summary["verdict"]]
