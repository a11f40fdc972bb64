"""`haploop rig`: describe a rig."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..terminal.progress import note, print_either
from . import front as haploop
from .asking import asker
from .options import JSON, NewFile

if TYPE_CHECKING:
    from ..instruments.describing import Found


@click.group()
def rig() -> None:
    """Describe a rig in a file."""


@rig.command()
@click.argument("file", type=NewFile(".toml"), metavar="FILE.toml")
@click.option("--base", metavar="FILE", help="Ask nothing: begin with this rig file, or a shipped rig.")
@click.option("--simulate", is_flag=True, help="Offer the cards and ports of a simulated computer.")
@JSON
def new(file: Path, base: str | None, simulate: bool, as_json: bool) -> int:
    """Write a rig file by asking what you have.

    NI cards, serial ports, VISA resources and sound cards that this computer has are offered; nothing is
    opened. Enter takes the answer in brackets. FILE.toml is written when it is valid, and never overwritten.
    """
    if base is not None:
        made = haploop.new_rig_on(file, base)
    else:
        made = haploop.new_rig(
            file, asker("run it at a terminal, or begin with a shipped rig by --base"), _found(simulate), note
        )
    print_either(
        as_json,
        {"rig": str(file), "name": made.name, "digest": made.digest},
        f"{file}: the rig {made.name!r}. Try it on twins: haploop doctor --rig {file} --simulate twin",
    )
    return 0


def _found(simulate: bool) -> Found:
    if simulate:
        from ..mocks.computer import simulated_computer  # noqa: PLC0415 - loads what is simulated

        return simulated_computer()
    return haploop.look_for_hardware()
