"""`haploop new`: a folder for a study, with all that it needs."""

from __future__ import annotations

import json
import re
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from ..reports import contents, outputs, satellites
from ..terminal.browser import open_page
from ..terminal.progress import print_line
from . import public as haploop
from .options import PATH
from .study import STUDY_FORM


def asker(instead: str) -> Callable[[str, str], str]:
    """Return what asks a question, with the answer that Enter gives.

    Where nobody is there to answer, it raises ConfigurationError with `instead`: what to give to be asked
    nothing.
    """

    def ask(question: str, default: str) -> str:
        try:
            return str(click.prompt(question, default=default, show_default=bool(default), err=True))
        except click.Abort:  # Ctrl-C, or the end of what was written into it
            if sys.stdin.isatty():
                raise
            asked = question.splitlines()[0]
            raise haploop.ConfigurationError(f"Nobody is there to answer {asked!r}: {instead}.") from None

    return ask


_README = """\
# {name}

What to run here, in this order (start.html is the same as a page). Each command says what comes next,
`haploop` alone what is due, and `haploop COMMAND --help` has its options.

{rehearse}

{steps}

`haploop serve --rig rig.toml` shows all of it in a browser.
"""
_STEPS = (
    ("haploop doctor --rig rig.toml", "Is every instrument as the rig file says?"),
    ("haploop live --rig rig.toml", "Look at the sensors before anything is recorded. Ctrl-C ends it."),
    ("haploop study run", "Record the presses that are still due; for one participant, or for all."),
    ("haploop study status", "What is recorded, and what is due."),
    ("haploop study represent {button} --out {button}-press.h5", "The press that stands for all."),
    ("haploop calibrate --rig rig.toml", "Measure the table, into calibration.h5."),
    (
        "haploop button make {button}-press.h5 -c calibration.h5 -o {button}.h5 --rig rig.toml",
        "Make and check the digital button.",
    ),
    ("haploop report . {button}.h5", "All of it on one page."),
    (
        'haploop calibrations adopt {button}.h5 --rig rig.toml --reason "first"',
        "From then on, every night: haploop recalibrate --rig rig.toml.",
    ),
)
_EXPERIMENT = (
    "haploop experiment run experiment --participant P01",
    "Which button is it? First edit experiment/experiment.toml.",
)
_REHEARSE = (
    "The rig is simulated as long as rig.toml says so: describe yours (`haploop rig new mine.toml`), and put "
    "it in place of rig.toml. Nothing that is measured until then is real."
)
_REAL = (
    "Rehearse all of it without touching an instrument: `--simulate twin` behind each command, into another "
    "folder."
)


@click.command("new")
@click.argument("folder", type=PATH)
@click.option(
    "--buttons", metavar="LIST", help="Buttons, for example latch,toggle,push.  [default: asked for]"
)
@click.option(
    "--participants", type=click.IntRange(1, 999), metavar="N", help="How many.  [default: asked for]"
)
@click.option(
    "--presses", "-n", type=click.IntRange(1, 1000), metavar="N", default=10, show_default=True,
    help="Presses of each button.",
)  # fmt: skip
@click.option("--rig", "-r", metavar="FILE", help="Rig file, or name of a shipped rig.  [default: asked for]")
@click.option("--no-open", is_flag=True, help="Do not open the folder's page in a browser.")
def new(
    folder: Path, buttons: str | None, participants: int | None, presses: int, rig: str | None, no_open: bool
) -> int:
    """Make a FOLDER for a study, with all that it needs.

    It gets a rig file, a study, an experiment, and a page of what to run in which order (start.html, which is
    opened in a browser, and README.md).

    What is not given is asked for at a terminal. Edit the files as you like; nothing that exists is
    overwritten.
    """
    named = _buttons(_given("buttons", buttons, "Which buttons?", "latch,toggle,push"))
    count = int(_given("participants", participants, "How many participants?", "3"))
    chosen = _given("rig", rig, "Which rig: a file, or a shipped rig's name?", "simulated")
    names = ("rig.toml", "study.toml", "experiment/experiment.toml", "README.md", "start.html")
    paths = [folder / name for name in names]
    simulated = haploop.load_rig_file(chosen).simulate is not None
    if not (name := folder.resolve().name):
        raise haploop.ConfigurationError(
            f"{folder} has no name, and a study is named as its folder: choose another one."
        )
    for path in paths:
        outputs.check_destination(path)
    haploop.new_rig_on(paths[0], chosen, name)
    people = [f"P{number:02d}" for number in range(1, count + 1)]
    said = {"rig": "rig.toml", "buttons": named, "participants": people, "presses": presses}
    _write(paths[1], _study(name, said))
    if len(named) > 1:
        _write(paths[2], _experiment(named))
    steps = [
        (command.format(button=named[0]), told)
        for command, told in (*_STEPS, *([_EXPERIMENT] if len(named) > 1 else []))
    ]
    rehearse = _REHEARSE if simulated else _REAL
    _write(paths[3], _README.format(name=name, rehearse=rehearse, steps=_listed(steps)))
    _write(paths[4], _page(name, rehearse, steps))
    haploop.load_study(folder)
    haploop.load_rig_file(paths[0])
    print_line(
        f"Made {folder}: {paths[4]} says what to run; first: cd {shlex.quote(str(folder))}, haploop doctor "
        "--rig rig.toml"
    )
    if not no_open:
        open_page(paths[4])
    return 0


def _listed(steps: Sequence[tuple[str, str]]) -> str:
    return "\n".join(f"{number}. `{command}`: {told}" for number, (command, told) in enumerate(steps, 1))


def _page(name: str, rehearse: str, steps: Sequence[tuple[str, str]]) -> str:
    """The README as a page."""
    from ..reports.html import Page  # noqa: PLC0415

    rows = [(str(number), command, told) for number, (command, told) in enumerate(steps, 1)]
    grid = contents.Grid("", ("", "Command", "What it does"), rows, words=3)
    notes = [rehearse.replace("`", "")]
    told = contents.Contents("What to run here, in this order", tables=[grid], notes=notes)
    return Page(name, "Each command says what comes next, and haploop alone what is due.", [told]).html()


def _given(option: str, value: str | int | None, question: str, default: str) -> str:
    """A value that was given, or that a person at the terminal answers. Raises ConfigurationError."""
    if value is not None:
        return str(value)
    if not sys.stdin.isatty():
        raise haploop.ConfigurationError(
            f"Nobody is there to ask: say it with --{option}, such as {default}."
        )
    answer = asker(f"say it with --{option}")(question, default)
    if option == "participants" and not (answer.isdecimal() and 0 < int(answer) < 1000):
        raise haploop.ConfigurationError(f"{answer!r} is not a number of participants: use 1 to 999.")
    return answer


def _buttons(text: str) -> list[str]:
    named = [one.strip() for one in text.split(",") if one.strip()]
    wrong = [one for one in named if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}", one)]
    if wrong or not named or len(set(named)) < len(named):
        raise haploop.ConfigurationError(
            f"Buttons are different names of letters, digits, _ and -, such as latch,push (found {text!r})."
        )
    return named


def _study(name: str, said: Mapping[str, Any]) -> str:
    text = STUDY_FORM.format(name=json.dumps(name))
    for key, value in said.items():  # nothing in these names needs a backslash
        text = re.sub(rf"^{key} = .*?(?= *#|$)", f"{key} = {json.dumps(value)}", text, flags=re.MULTILINE)
    return text.replace("[button.latch]", f"[button.{said['buttons'][0]}]")


def _experiment(buttons: Sequence[str]) -> str:
    text = satellites.owned("folder experiment")("matching").path.read_text(encoding="utf-8")
    levels = f"levels = {json.dumps(list(buttons))}"
    return re.sub(r"^levels = \[.*\"latch\".*\]$", levels, text, count=1, flags=re.MULTILINE)


def _write(path: Path, text: str) -> None:
    with outputs.new_file(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")
