"""`haploop live`: watch the rig that another command is using."""

from __future__ import annotations

from contextlib import ExitStack

import click

from . import public as haploop
from .options import ChosenRig, FiniteRange, on_rig


@click.command(short_help="Show what the sensors read, now or in a recording.")
@on_rig()
@click.option(
    "--wait",
    type=FiniteRange(min=0),
    default=0.0,
    metavar="SECONDS",
    help="Wait this long for a command that uses the rig, and do not open it.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object a line for each block.")
@click.option(
    "--lsl",
    is_flag=True,
    help="Send the samples as a Lab Streaming Layer stream; with --wait, of one command after another.",
)
def live(rig: ChosenRig, wait: float, as_json: bool, lsl: bool) -> None:
    """Show what the sensors read, now or in a running recording or play.

    Alone, it opens the rig and shows its sensors until Ctrl-C; nothing is played or recorded. In a second
    terminal, with the rig file of a command that records or plays, it shows what that command acquires. Mean,
    rms and peak are those of the newest block, in SI units; rms and peak are taken about the mean. A
    recording is not affected: a view that is too slow misses blocks, and counts them.
    """
    from .live_views import find, looking, show_json, show_meter, stream  # noqa: PLC0415

    file, simulate = rig.load(), rig.simulate
    if lsl:
        stream(file, simulate, wait)
        return
    with ExitStack() as stack:
        try:
            tap = stack.enter_context(find(file, simulate, wait))
        except haploop.ConfigurationError:
            if wait:
                raise
            tap = stack.enter_context(looking(stack.enter_context(rig.opened(real_time=True))))
        if as_json:
            show_json(tap)
        else:
            show_meter(tap)
