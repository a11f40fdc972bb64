"""`haploop tape`: look at the tape of a session, and make one that can be sent."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..terminal.progress import note, print_json, print_line
from . import public as haploop
from .options import JSON, PATH, NewFile

if TYPE_CHECKING:
    from ..instruments.tape import TapeLines

_ERRORS = 10
"""Errors that are shown."""


@click.group(no_args_is_help=True)
def tape() -> None:
    """Look at a session's tape, and make one to send.

    `--tape FILE.tape` of a command that opens a rig writes a tape, and `--simulate tape:FILE.tape` plays it.
    """


@tape.command()
@click.argument("file", type=PATH)
@JSON
def show(file: Path, as_json: bool) -> None:
    """Show what is on a tape.

    Says when it was written and on what, how many calls each instrument got, and which calls failed. Every
    call is a line of the file: `zcat FILE.tape`.
    """
    from ..instruments.tape import TapeLines  # noqa: PLC0415

    found = _summary(TapeLines.of(file))
    if as_json:
        print_json(found)
        return
    what = f"{found['rig']} on {found['on']}" if found["rig"] else "a program's own calls, without a rig"
    print_line(f"{found['software']}, {found['started']}: {what}")
    print_line(
        f"{found['calls']} calls in {found['seconds']:.1f} s, {'whole' if found['whole'] else 'cut off'}"
    )
    for role, count in found["by_role"].items():
        print_line(f"  {role:<12} {count}")
    for error in found["errors"][:_ERRORS]:
        print_line(f"  failed: {error}")
    if len(found["errors"]) > _ERRORS:
        print_line(f"  and {len(found['errors']) - _ERRORS} more that failed")


@tape.command()
@click.argument("file", type=PATH)
@click.argument("out", type=NewFile(".tape"), metavar="OUT.tape")
@click.option(
    "--hide", multiple=True, metavar="TEXT", help="Also replace this text, such as a name. Can be repeated."
)
def mask(file: Path, out: Path, hide: tuple[str, ...]) -> None:
    """Write a tape without serial numbers and names.

    Serial numbers and names that were given to devices are replaced by others of the same form wherever they
    stand; the copy plays as the tape does. Look at it with `zcat` before you send it.
    """
    count = haploop.instruments.mask(file, out, hide)
    note(f"{out}: {count} texts were replaced.")


def _summary(lines: TapeLines) -> dict[str, Any]:
    import json  # noqa: PLC0415

    calls = [line for line in lines.lines if line["is"] == "call"]
    rigs = [line for line in lines.lines if line["is"] == "rig"]
    times = [float(call["at"]) for call in calls] or [0.0]
    return {
        "software": lines.head["software"],
        "started": lines.head["started"],
        "rig": json.loads(rigs[0]["rig"])["name"] if rigs else None,
        "on": (rigs[0]["mode"] or "hardware") if rigs else None,
        "whole": lines.whole,
        "calls": len(calls),
        "seconds": max(times) - min(times),
        "by_role": dict(Counter(call["role"] for call in calls)),
        "errors": [
            f"{call['role']} {call['do']} at {call['at']:.3f} s: {call['error'][1][0]}"
            for call in calls
            # nidaqmx tries a call that older drivers lack, and goes on without it.
            if "error" in call and call["error"][0] != "NotImplementedError"
        ],
    }
