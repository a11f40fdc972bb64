"""`haploop map`: measure the vibration map of a table."""

from __future__ import annotations

from pathlib import Path

import click

from ..reports import contents, show
from ..terminal.progress import Steps, note
from . import public as haploop
from .options import JSON, PATH, ChosenRig, FiniteRange, on_rig

_MOST_POINTS = 100_000
"""Number of a grid point that no table has: a long range is refused before it is a list."""


@click.command("map")
@click.option(
    "--out",
    "-o",
    type=PATH,
    required=True,
    metavar="DIR",
    help="Folder of the map; an existing map is continued.",
)
@click.option(
    "--points", metavar="LIST", help="Grid points, for example 0,5,12-20.  [default: all]", default=None
)
@click.option("--patches", metavar="LIST", help="Patches, for example A,C.  [default: all]", default=None)
@click.option(
    "--level",
    type=FiniteRange(min=0, min_open=True),
    metavar="V",
    help="Peak voltage of each drive.  [default: the maximum that the limits allow]",
)
@click.option(
    "--one-by-one",
    is_flag=True,
    help="Play one patch at a time, even if the amplifier has a channel for each patch.",
)
@on_rig()
@JSON
def map_command(
    out: Path,
    points: str | None,
    patches: str | None,
    level: float | None,
    one_by_one: bool,
    rig: ChosenRig,
    as_json: bool,
) -> int:
    """Measure the response at every grid point to each patch.

    An interrupted map is continued by the same command.
    """
    chosen = None if points is None else _numbers(points)
    names = None if patches is None else [name.strip() for name in patches.split(",")]
    if names and len(set(names)) < len(names):
        raise click.UsageError(f"--patches names a patch twice: {patches}. Name each once.")
    with rig.opened() as opened, Steps() as steps:
        plan = haploop.map_plan(
            opened, points=chosen, patches=names, level=level, together=False if one_by_one else None
        )
        folder = haploop.measure_map(opened, out, plan, steps)
    for point, reason in folder.skipped().items():
        note(f"Point {point} was skipped: {reason} Run the same command again to measure it.")
    show.print_contents(contents.file_contents(out), as_json)
    return 0


def _numbers(text: str) -> list[int]:
    """Parse numbers and ranges such as 0,5,12-20. Raises click.UsageError."""
    found: list[int] = []
    for part in text.split(","):
        first, _, last = part.strip().partition("-")
        if not first.isdecimal() or (last and not last.isdecimal()):
            raise click.UsageError(f"--points takes numbers such as 0,5,12-20; {part.strip()!r} is not one")
        low, high = int(first), int(last or first)
        if high > _MOST_POINTS:
            raise click.UsageError(f"--points: no table has a grid point {high}.")
        found += range(low, high + 1)
    return found
