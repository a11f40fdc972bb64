"""`haploop study`: record several buttons with many participants, in any number of sessions."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..reports import contents, outputs, show
from ..terminal.progress import Steps, print_either, print_line
from . import public as haploop
from .option_groups import Prompts, on_prompts
from .options import JSON, NOTES, PATH, ChosenRig, average_option, on_rig

if TYPE_CHECKING:
    from ..acquisition import AverageMethod

STUDY = click.option(
    "--study",
    "-s",
    "path",
    type=PATH,
    default=Path(),
    metavar="PATH",
    help="Study file, or the folder with its study.toml.  [default: this folder]",
)
REASON = click.option("--reason", default="", help="Reason; stored with the rejection.")
_RIG = click.option("--rig", "-r", metavar="FILE", help="Rig file instead of the study's own.")

STUDY_FORM = """\
# A haploop study: participants, buttons and their order. `haploop study run` records what is still due.

name = {name}
rig = "simulated"                   # your rig file, beside this one
buttons = ["latch", "toggle", "push"]
participants = ["P01", "P02", "P03"] # pseudonyms only; add new ones at the end
presses = 10                        # of each button by each participant
patience = 15                       # s after which a prompt is repeated
wait = 600                          # s that a session waits for a participant who is away, in all
attempts = 5                        # at one press, before a session ends
order = "counterbalanced"           # or "as-listed", or "random" with a seed
consent = true                      # ask whether the consent form is signed, and store the answer
method = "automatic"                # of representative presses; or "barycentre", "registration", "mean"

# [prompts]
# consent = "Has {{participant}} signed the form KU-17?"
# ready = "{{participant}}: index finger at the {{button}} button, {{presses}} presses. Ready?"
# press = "Press {{button}} now ({{number}} of {{of}})."

# [participant.P01]                 # what a paper reports of a participant: columns of your own
# age = 31
# sex = "f"
# handedness = "right"

# [button.latch]
# presses = 20
# force = [3, 15]                   # N at activation; a press outside is asked for again
# prompt = "Press the latch until it stays."
"""


@click.group(no_args_is_help=True)
def study() -> None:
    """Record a study with many participants and buttons."""


@study.command()
@click.argument("folder", type=PATH)
def new(folder: Path) -> int:
    """Create a study: a FOLDER with a study.toml to fill in."""
    path = folder / "study.toml"
    outputs.check_destination(path)
    # A JSON string is a valid TOML string for any folder name.
    with outputs.new_file(path) as part:
        part.write_text(STUDY_FORM.format(name=json.dumps(folder.resolve().name)), encoding="utf-8")
    print_line(f"Fill in {path}, then: haploop study run --study {folder}")
    return 0


@study.command()
@STUDY
@click.option("--participant", "-p", "participants", multiple=True, help="Only this one; repeatable.")
@click.option("--button", "-b", "buttons", multiple=True, help="Only this one; repeatable.")
@NOTES
@on_prompts
@on_rig(_RIG)
@JSON
def run(
    path: Path,
    participants: Sequence[str],
    buttons: Sequence[str],
    notes: str,
    prompts: Prompts,
    rig: ChosenRig,
    as_json: bool,
) -> int:
    """Record the presses still due. Stop with Ctrl-C; the next run continues there.

    A press that fails its quality check is kept, marked, and asked for again. At a console, type r and
    Enter to reject the preceding press.
    """
    opened = haploop.load_study(path)
    rig = replace(rig, name=rig.name or _own_rig(opened.path, opened.file.rig))
    with rig.opened() as instruments:
        rig.state.recordings = opened.folder
        with show.StudyMeter(instruments, opened.progress()) as meter:
            haploop.run_study(
                instruments,
                opened,
                participants,
                buttons,
                progress=meter.progress,
                on_verdict=meter.on_study_verdict,
                on_request=meter.on_request,
                notes=notes,
                adapt=prompts.adapt,
            )
    show.print_contents(contents.study_contents(opened, opened.progress()), as_json)
    return 0


@study.command("status")
@STUDY
@JSON
def status_(path: Path, as_json: bool) -> int:
    """Show progress: presses, sessions and consents.

    Presses are accepted, bad, or rejected; sessions interrupted, or in progress.
    """
    opened = haploop.load_study(path)
    show.print_contents(contents.study_contents(opened, opened.progress()), as_json)
    return 0


@study.command()
@click.argument("button")
@click.option(
    "--out",
    "-o",
    type=PATH,
    metavar="FILE.h5",
    help="Representative press file to write.  [default: BUTTON-press.h5]",
)
@average_option(default=None)
@STUDY
@JSON
def represent(button: str, out: Path | None, average: AverageMethod | None, path: Path, as_json: bool) -> int:
    """Compute the representative press of BUTTON.

    Only a press that passed its quality check counts.
    """
    opened = haploop.load_study(path)
    out = out or Path(f"{button}-press.h5")
    outputs.check_new_file(out)
    with Steps() as steps:
        press = opened.representative(button, average, steps)
    press.save(out)
    show.print_contents(contents.file_contents(out), as_json)
    return 0


@study.command()
@click.option("--out", "-o", type=PATH, default=Path("processed"), show_default=True, help="Folder to write.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes.  [default: one for each core]")
@click.option("--dask", metavar="ADDRESS", help="Compute on the cluster of this Dask scheduler instead.")
@STUDY
@JSON
def process(out: Path, workers: int | None, dask: str | None, path: Path, as_json: bool) -> int:
    """Process all presses: rows, representatives, statistics.

    OUT gets presses.csv (a row a press), statistics.csv, BUTTON.h5 (the representative press of each button)
    and parts/, from which an interrupted run continues. Run it again after a session: only what is new or
    changed is computed, and presses.csv, statistics.csv and the buttons are replaced.
    """
    opened = haploop.load_study(path)
    with Steps() as steps:
        done = haploop.acquisition.process_study(opened, out, workers=workers, dask=dask, progress=steps)
    print_either(
        as_json,
        {
            "folder": str(done.folder),
            "presses": done.presses,
            "parts": done.parts,
            "computed": done.computed,
            "buttons": done.buttons,
        },
        f"{done.folder}: {done.presses} presses; {done.computed} of {done.parts} parts computed.",
    )
    return 0


@study.command()
@click.argument("participant")
@click.argument("button")
@click.argument("numbers", nargs=-1, required=True, type=click.IntRange(min=1), metavar="NUMBER...")
@REASON
@STUDY
def reject(participant: str, button: str, numbers: Sequence[int], reason: str, path: Path) -> int:
    """Reject presses of BUTTON by PARTICIPANT.

    The next run asks for them again. The recordings are not changed.
    """
    return _reject(path, participant, button, numbers, reason)


@study.command()
@click.argument("participant")
@click.argument("button")
@REASON
@STUDY
def repeat(participant: str, button: str, reason: str, path: Path) -> int:
    """Reject all presses of BUTTON by PARTICIPANT.

    The next run asks for them again. The recordings are not changed.
    """
    return _reject(path, participant, button, (), reason or "the button is repeated")


def _reject(path: Path, participant: str, button: str, numbers: Sequence[int], reason: str) -> int:
    rejected = haploop.load_study(path).reject(participant, button, numbers, reason)
    numbers = sorted({one.number for one in rejected})
    print_line(
        f"Rejected presses of {button} by {participant}: {', '.join(map(str, numbers))}. "
        "`haploop study run` asks for them again."
    )
    return 0


def _own_rig(path: Path, rig: str | None) -> str:
    """The study's rig: a file beside the study file, or the name of a shipped rig."""
    if rig is None:
        raise haploop.ConfigurationError(f'{path} names no rig: add `rig = "FILE"`, or use --rig FILE.')
    beside = path.parent / rig
    return str(beside) if beside.is_file() else rig
