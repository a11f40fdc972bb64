"""The command line: `haploop demo`, `record`, `show`, `calibrate`, `check`, `doctor`, `schema`, `twin`.

How a command ends stands in `haploop.exits`. Heavy imports wait until a command needs them, so that
`haploop --help` answers at once.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haploop.exits import Commands, Session
from haploop.serve import twin
from instruments import HaploopError

if TYPE_CHECKING:
    from instruments import Rig, RigFile
    from instruments.rig import Mode

__all__ = ["cli", "main"]

_RIG = click.option(
    "--rig",
    "-r",
    default="simulated",
    show_default=True,
    metavar="FILE",
    help="Rig file, or the name of a rig that haploop ships.",
)
_SIMULATE = click.option(
    "--simulate",
    type=click.Choice(["twin", "wire"]),
    help="Simulate the rig: twins in process, or wires that the real drivers talk to.",
)
_JSON = click.option("--json", "as_json", is_flag=True, help="Print one JSON object on standard output.")
_PATH = click.Path(path_type=Path)


@click.group(cls=Commands, no_args_is_help=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="haploop", message="haploop %(version)s")
def cli() -> None:
    """From a physical button to a verified digital one.

    Exit codes: 0 done and passed, 1 out of tolerance, 2 wrong request, 3 an instrument failed.
    """


@cli.command()
@click.option("--out", "-o", type=_PATH, help="Folder for the results.  [default: a new haploop-demo]")
@click.option(
    "--seed", type=click.IntRange(min=0), help="Which simulated world.  [default: the rig file's, 0]"
)
@click.option(
    "--participants",
    type=click.IntRange(1, 99),
    default=1,
    show_default=True,
    help="How many press the buttons.",
)
@_RIG
@_SIMULATE
@_JSON
@click.pass_obj
def demo(
    session: Session,
    out: Path | None,
    seed: int | None,
    participants: int,
    rig: str,
    simulate: Mode | None,
    as_json: bool,
) -> int:
    """Run the whole loop on a simulated rig and write a report."""
    from haploop import show as display  # noqa: PLC0415
    from haploop.console import Steps, note, print_json  # noqa: PLC0415
    from haploop.demo import claim_folder, run_demo  # noqa: PLC0415
    from instruments import load_rig_file  # noqa: PLC0415

    load_rig_file(rig)
    folder = claim_folder(out)
    session.recordings = folder / "recordings"
    with Steps() as steps:

        def progress(step: str, done: float, of: float) -> None:
            session.rig_opened = True
            steps(step, done, of)

        summary = run_demo(
            folder, rig, seed=seed, participants=participants, mode=simulate, progress=progress
        )
    if as_json:
        print_json(summary)
        note(f"Everything here is simulated ({summary['mode']}, seed {summary['seed']}).")
    else:
        display.demo(summary)
    return 0 if summary["passed"] else 1


@cli.command()
@click.argument("button")
@click.option("--participant", "-p", required=True, help="Pseudonym of who presses, P01 for example.")
@click.option("--presses", "-n", type=click.IntRange(min=1), default=10, show_default=True)
@click.option(
    "--out", "-o", type=_PATH, default=Path("recordings"), show_default=True, help="Folder for the recording."
)
@_RIG
@_SIMULATE
@_JSON
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
        _alone(rig, simulate) as file,
        _rig(session, file, simulate) as opened,
        Steps() as steps,
    ):
        out.mkdir(parents=True, exist_ok=True)
        session.recordings = out
        recording = haploop.record(
            opened, button, participant, presses, out, lambda done, of: steps(step, done, of)
        )
    display.show(recording.path, as_json)
    return 0


@cli.command()
@click.argument("file", type=_PATH)
@click.option("--plot", type=_PATH, metavar="OUT.png", help="Also draw it.")
@_JSON
def show(file: Path, plot: Path | None, as_json: bool) -> int:
    """What is in a recording, a representative press, a calibration or a drive FILE."""
    from haploop import show as display  # noqa: PLC0415

    display.show(file, as_json, plot)
    return 0


@cli.command()
@click.argument("file", type=_PATH)
@_JSON
def recover(file: Path, as_json: bool) -> int:
    """Make an interrupted recording FILE whole, in a new file beside it."""
    import acquisition  # noqa: PLC0415
    from haploop import show as display  # noqa: PLC0415

    display.show(acquisition.recover(file), as_json)
    return 0


@cli.command()
@click.option("--patch", default="A", show_default=True, help="Patch to excite.")
@click.option(
    "--point",
    default="button",
    show_default=True,
    help="Where the laser is aimed: button, or a grid point's number.",
)
@click.option("--out", "-o", type=_PATH, default=Path("calibration.h5"), show_default=True, metavar="FILE.h5")
@_RIG
@_SIMULATE
@_JSON
@click.pass_obj
def calibrate(
    session: Session, patch: str, point: str, out: Path, rig: str, simulate: Mode | None, as_json: bool
) -> int:
    """Measure the table's response and fit its model."""
    import haploop  # noqa: PLC0415
    from haploop import show as display  # noqa: PLC0415
    from haploop.console import Steps  # noqa: PLC0415

    _new_file(out)
    step = f"Calibrate patch {patch} at the {point} point"
    with (
        _alone(rig, simulate) as file,
        _rig(session, file, simulate) as opened,
        Steps() as steps,
    ):
        _on_table(opened, point)
        calibration = haploop.calibrate(opened, patch, point, lambda done, of: steps(step, done, of))
    calibration.save(out)
    display.show(out, as_json)
    return 0


@cli.command()
@click.argument("recordings", nargs=-1, required=True, type=_PATH)
@click.option(
    "--calibration", "-c", required=True, type=_PATH, metavar="FILE", help="As `haploop calibrate` wrote it."
)
@click.option(
    "--out", "-o", type=_PATH, metavar="DIR", help="Keep the representative press, the drive and a plot here."
)
@_RIG
@_SIMULATE
@_JSON
@click.pass_obj
def check(
    session: Session,
    recordings: Sequence[Path],
    calibration: Path,
    out: Path | None,
    rig: str,
    simulate: Mode | None,
    as_json: bool,
) -> int:
    """Play what stands for RECORDINGS of one button on the table, measure it, and compare."""
    import haploop  # noqa: PLC0415
    from haploop import show as display  # noqa: PLC0415
    from haploop.console import Steps  # noqa: PLC0415

    table = haploop.Calibration.load(calibration)
    press = haploop.representative([haploop.Recording.open(path) for path in recordings])
    if out is not None:
        display.claim(out, press.button)
    with (
        _alone(rig, simulate) as file,
        _rig(session, file, simulate) as opened,
        Steps() as steps,
    ):
        if table.response.simulated != opened.simulated:
            raise haploop.ConfigurationError(
                f"{calibration} is of a {_kind(table.response.simulated)} table and the rig {opened.name!r} "
                f"is {_kind(opened.simulated)}: calibrate that rig first."
            )
        drive = haploop.drive_for(press, table, opened.limits)
        step = f"Play and measure the {press.button} button"
        result = haploop.check(opened, drive, progress=lambda done, of: steps(step, done, of))
    display.check(press, result, as_json)
    if out is not None:
        display.keep(out, press, result)
    return 0 if result.passed else 1


@cli.command()
@click.option(
    "--mass",
    type=click.FloatRange(0.05, 10),
    default=0.5,
    show_default=True,
    metavar="KG",
    help="Known mass, to be put on the force sensor when asked.",
)
@_RIG
@_SIMULATE
@_JSON
@click.pass_obj
def doctor(session: Session, mass: float, rig: str, simulate: Mode | None, as_json: bool) -> int:
    """Look at each instrument of a rig: is it there, wired and set as the rig file says?

    Exit codes: 0 nothing is red, 1 something is, 3 an instrument cannot be opened.
    """
    from haploop import doctor as diagnosis  # noqa: PLC0415
    from haploop.console import Steps  # noqa: PLC0415

    missing = False
    with _alone(rig, simulate) as file:
        simulated = (simulate or file.simulate) is not None
        try:
            with _rig(session, file, simulate) as opened, Steps() as steps:
                simulated = opened.simulated
                findings = diagnosis.examine(opened, mass, steps)
        except HaploopError as error:
            # Once it is open, only a safe state that was not reached comes here: that is the message.
            if session.rig_opened:
                raise
            findings, missing = diagnosis.find_each(file, simulate, error), True
    diagnosis.tell(findings, file.name, simulated, as_json)
    if missing:
        return 3
    return int(any(finding.status == "red" for finding in findings))


@cli.command()
def schema() -> None:
    """Print the JSON schema of rig files, for editors."""
    from haploop.console import print_json  # noqa: PLC0415
    from instruments.rig_schema import rig_schema  # noqa: PLC0415

    print_json(rig_schema())


def _kind(simulated: bool) -> str:
    return "simulated" if simulated else "real"


def _on_table(rig: Rig, point: str) -> None:
    from instruments import ConfigurationError  # noqa: PLC0415

    points = rig.table.rows * rig.table.columns
    if point != "button" and not (point.isdecimal() and int(point) < points):
        raise ConfigurationError(
            f"{point!r} is no point of the table: it is 'button', or a number from 0 to {points - 1}."
        )


def _new_file(path: Path) -> None:
    """Refuse before anything is measured what could not be written after it."""
    from acquisition.store import check_target  # noqa: PLC0415
    from instruments import ConfigurationError  # noqa: PLC0415

    if path.exists():
        raise ConfigurationError(f"{path} exists, and nothing is overwritten: name another file with --out.")
    if not path.parent.is_dir():
        raise ConfigurationError(f"There is no folder {path.parent} to write {path.name} to.")
    check_target(path)


@contextmanager
def _alone(rig: str, simulate: Mode | None) -> Iterator[RigFile]:
    """The rig file, and its hardware for this program only: two would switch one relay."""
    from haploop.lock import hold  # noqa: PLC0415
    from instruments import load_rig_file  # noqa: PLC0415

    file = load_rig_file(rig)
    if simulate or file.simulate:
        yield file
        return
    with hold(Path(rig), f"haploop {click.get_current_context().info_name}"):
        yield file


@contextmanager
def _rig(session: Session, file: RigFile, simulate: Mode | None) -> Iterator[Rig]:
    """The rig, opened; says so when it is simulated."""
    from haploop.console import note  # noqa: PLC0415
    from instruments import open_rig  # noqa: PLC0415

    with open_rig(file, simulate=simulate) as opened:
        session.rig_opened = True
        if opened.simulated:
            world = (
                f"{opened.mode}, seed {opened.file.simulation.seed}" if opened.mode else "by its DAQ cards"
            )
            note(f"Everything here is simulated ({world}).")
        yield opened


cli.add_command(twin)


def main() -> None:
    """The `haploop` command."""
    for stream in (sys.stdout, sys.stderr):
        # A console or a pipe that cannot show a sign gets a replacement, not an error.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    cli()
