"""`haploop rig`: describe a rig in a file, and check the file."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from ..terminal.progress import note, print_either
from . import front as haploop
from .options import JSON, PATH, NewFile


@click.group()
def rig() -> None:
    """Describe a rig in a file."""


@rig.command()
@click.argument("file", type=NewFile(".toml"), metavar="FILE.toml")
@click.option("--like", metavar="NAME", default="", help="The shipped rig that yours is like.")
@JSON
def new(file: Path, like: str, as_json: bool) -> int:
    """Write a rig file like a shipped one, for you to edit.

    NI cards, serial ports, VISA resources and sound cards that this computer has are filled in; nothing is
    opened. What has to be looked up is marked, and `haploop rig check` lists it.
    """
    from ..instruments import config, describing  # noqa: PLC0415 - slow to load

    if not like:
        raise haploop.ConfigurationError(
            f"Say which rig yours is like: --like {', '.join(config.shipped_rigs())}."
        )
    made = haploop.new_rig(file, like, haploop.look_for_hardware())
    left = len(describing.to_look_up(file))
    print_either(
        as_json,
        {"rig": str(file), "name": made.name, "digest": made.digest, "to_look_up": left},
        f"{file}: the rig {made.name!r}, with {left} lines to look up. Edit it; then: haploop rig check "
        f"{shlex.quote(str(file))}",
    )
    return 0


@rig.command()
@click.argument("file", type=PATH, metavar="FILE.toml")
@JSON
def check(file: Path, as_json: bool) -> int:
    """Check a rig file line by line; nothing is opened.

    Exit codes: 0 it is complete, 1 lines are left to look up, 2 it is not valid.
    """
    from ..instruments import describing  # noqa: PLC0415 - slow to load

    wrong = describing.rig_problems(file)
    left = describing.to_look_up(file)
    if wrong:
        for sentence in wrong[:-1]:
            note(sentence)
        raise haploop.ConfigurationError(wrong[-1])
    said = (
        f"{file} is complete. Try it on twins: haploop doctor --rig {shlex.quote(str(file))} --simulate twin"
    )
    if left:
        mark = describing.LOOK_UP
        said = "\n".join([f"{file} is valid, with examples' values in lines that say {mark}:", *left])
    print_either(as_json, {"rig": str(file), "to_look_up": left}, said)
    return int(bool(left))
