"""`haploop import`: files of other programs and of any lab."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ...base.wording import capital
from ...commands import public as haploop
from ...commands.options import JSON, PATH, PICTURE, RIG, FiniteRange
from ...reports import contents, outputs, show
from ...terminal.progress import Steps, note, print_json, print_line
from .. import shown

if TYPE_CHECKING:
    from ..importing import FileMapping, Question, Understanding

_FORMATS = (
    "csv", "wav", "mat", "hdf5", "netcdf", "nwb", "numpy", "parquet", "tdms", "xdf", "xlsx", "uff", "sep005",
)  # fmt: skip
_LARGE = 1 << 22
"""Bytes of a file that takes a second."""
_FLIPPED = ("force", "acceleration", "displacement", "activation")


@click.command("import")
@click.argument("files", nargs=-1, required=True, type=PATH, metavar="FILE...")
@click.option("--out", "-o", type=PATH, metavar="OUT", help="File to write, or the folder for several.")
@click.option(
    "--mapping", "-m", type=PATH, metavar="FILE.toml", help="What is said of such files, saved before."
)
@click.option("--save-mapping", type=PATH, metavar="FILE.toml", help="Save what is said and understood.")
@click.option("--time", metavar="COLUMN", help="Column of the time: a heading, or its number from 0.")
@click.option("--force", metavar="COLUMN", help="Column of the force.")
@click.option("--acceleration", metavar="COLUMN", help="Column of the vertical acceleration.")
@click.option("--displacement", metavar="COLUMN", help="Column of the cap's travel.")
@click.option("--activation", metavar="COLUMN", help="Column of the switch.")
@click.option("--rate", type=FiniteRange(min=1), metavar="HZ", help="Sample rate; stamps are not looked at.")
@click.option(
    "--unit",
    "units",
    multiple=True,
    metavar="WHAT=UNIT",
    help="Unit or sensitivity of a column: force=mN, 'force=40 N' (what one of the file is), "
    "'acceleration=100 mV/g', time=ms, 'response=(mm/s)/V'.",
)
@click.option("--flip", multiple=True, type=click.Choice(_FLIPPED), help="Change the sign of a column.")
@click.option(
    "--where",
    multiple=True,
    metavar="COLUMN=VALUE",
    help="Of a table of several measurements, the rows to take: Sensor=left, or Sensor=* for all.",
)
@click.option(
    "--each", metavar="COLUMN", help="Of such a table, import the rows of each value into a file of its own."
)
@click.option("--skip-damaged", is_flag=True, help="Leave damaged rows of a text out, as gaps.")
@click.option(
    "--rest",
    multiple=True,
    metavar="WHAT=start|end",
    help="Which end of the file shows force or displacement without a finger, where they disagree.",
)
@click.option(
    "--from",
    "format",
    type=click.Choice(_FORMATS),
    help=f"Format of FILE: {', '.join(_FORMATS)}.  [default: as its name ends]",
    metavar="FORMAT",
)
@click.option(
    "--zone",
    metavar="ZONE",
    help="Time zone of dates that state none, +02:00 or Europe/Berlin.  [default: they are kept as stated]",
)
@click.option("--decimal", type=click.Choice((".", ",")), help="Decimal sign of a text that leaves a doubt.")
@click.option(
    "--as",
    "make",
    type=click.Choice(("recording", "press", "curve")),
    help="What to make of it; a curve is slow force over travel.  [default: a recording when it holds "
    "several presses]",
)
@click.option("--button", help="Name of the button that was pressed.  [default: as the file states]")
@click.option("--participant", "-p", help="Pseudonym of the participant, for a recording: P01.")
@click.option(
    "--names", metavar="PATTERN", help="Where both stand in the files' names: '{participant}_{button}_*'."
)
@click.option(
    "--at",
    type=FiniteRange(min=0),
    metavar="SECONDS",
    help="Press: when the button switched.  [default: as the file states, where its contact closed, or "
    "at the largest acceleration]",
)
@click.option("--patch", help="Response: patch that was driven.  [default: as the file states]")
@click.option(
    "--point",
    help="Response: measured point, button or a grid point's number.  [default: as the file states]",
)
@click.option(
    "--plot", type=PICTURE, metavar="OUT.png", help="Also draw what was understood (PNG, PDF, SVG, CSV)."
)
@RIG
@JSON
def import_(
    files: Sequence[Path],
    out: Path | None,
    mapping: Path | None,
    save_mapping: Path | None,
    at: float | None,
    patch: str | None,
    point: str | None,
    each: str | None,
    plot: Path | None,
    rig: str,
    as_json: bool,
    **told: Any,
) -> int:
    """Import recordings, presses or responses of other programs.

    Without --out, show what was understood of FILE: its columns, units, rate and presses, and what it does
    not say. With --out, a file of several presses becomes a recording, which is judged and represented like
    one's own; one of a single press a representative press. What a file does not say is asked for at a
    terminal, and an error elsewhere. Several files, or with --each several measurements of one, are read
    alike, into the folder OUT.

    FILE is a text of any shape (.csv, .tsv, .txt, .lvm, .asc, .dat), .mat, .h5, .nc, .nwb, .npy, .npz,
    .parquet, .tdms, .wav, .xdf, .xlsx, .uff, .unv, or SEP-005 (.sep005, .json). A .uff file with frequency
    responses becomes a calibration of --rig; --patch and --point select one of several.
    """
    said = _mapping(mapping, told)
    for new in filter(None, (save_mapping, None if out is None or _into_folder(files, out) else out)):
        outputs.check_new_file(new, ())
    if haploop.exchange.is_response_file(files[0], said.format):
        return _response(files, out, rig, (patch, point, said.units.get("response")), as_json)
    wanted = _Wanted(out, at, plot, as_json)
    if each is not None or len(files) > 1:
        return _several(files, said, each, wanted)
    found = _asked(files[0], said)
    if save_mapping is not None:
        found.require()
        found.mapping.save(save_mapping)
        note(f"Saved for the next files: --mapping {save_mapping}.")
    if out is None:
        show.print_contents(shown.understanding_contents(found), as_json, plot)
        return 0
    path = haploop.exchange.destination(files[0].stem, out) if _into_folder(files, out) else out
    with _patience("Importing", files[0]):
        haploop.import_file(found, path, at)
    if plot is not None:
        outputs.save_picture(shown.understanding_contents(found).draw(), plot, False)
    said_there = contents.file_contents(path)
    if not as_json and said_there.kind not in ("recording", "curve"):  # which keep them
        for sentence in found.notes:
            print_line(sentence)
    show.print_contents(said_there, as_json)
    return 0


@dataclass(frozen=True)
class _Wanted:
    """What is to be done with files."""

    out: Path | None
    at: float | None
    plot: Path | None
    as_json: bool


def _mapping(file: Path | None, told: dict[str, Any]) -> FileMapping:
    """The mapping of a file, changed by the options."""
    units = _by_name("unit", "force=mN", told.pop("units"))
    told["rest"] = _by_name("rest", "force=start", told["rest"])
    told["where"] = _by_name("where", "Sensor=left", told["where"])
    said = {key: value for key, value in told.items() if value not in (None, (), {}, False)}
    if "rate" in said:
        said["rate_hz"] = said.pop("rate")
    mapping = haploop.exchange.FileMapping.told(
        {**said, **({"units": units} if units else {})}, "the options"
    )
    return mapping if file is None else haploop.exchange.FileMapping.load(file).but(mapping)


def _by_name(option: str, example: str, given: Sequence[str]) -> dict[str, str]:
    """What an option says of columns, by their role. Raises ConfigurationError."""
    said = {}
    for one in given:
        role, sign, value = one.partition("=")
        if not sign or not value.strip():
            raise haploop.ConfigurationError(
                f"--{option} {one!r} says nothing: write it as --{option} {example}."
            )
        said[role.strip()] = value.strip()
    return said


def _asked(path: Path, mapping: FileMapping) -> Understanding:
    """What is understood of a file, with what a person at a terminal says when asked."""
    with _patience("Reading", path):
        found = haploop.exchange.understand(path, haploop.exchange.named(path, mapping))
    if not (_at_a_terminal() and found.questions):
        return found
    show.print_contents(shown.understanding_contents(found), False)
    while found.questions:
        found = haploop.exchange.understand(
            path, found.answered(found.questions[0], _ask(found.questions[0]))
        )
    return found


@contextmanager
def _patience(doing: str, file: Path) -> Iterator[None]:
    """Say what is being done with a large file, while it is."""
    if not file.is_file() or file.stat().st_size < _LARGE:
        yield
        return
    with Steps() as steps:
        steps(f"{doing} {file.name}", 0, 1, "")
        yield
        steps(f"{doing} {file.name}", 1, 1, "")


def _at_a_terminal() -> bool:
    return sys.stdin.isatty() and sys.stderr.isatty()


def _ask(question: Question) -> str:
    return str(click.prompt(f"{capital(question.what)} ({question.option})", err=True))


def _several(files: Sequence[Path], mapping: FileMapping, each: str | None, wanted: _Wanted) -> int:
    """Import each file, or each measurement in it; one that cannot be is said, and the others go on."""
    if wanted.out is None:
        what = f"{len(files)} files" if each is None else f"what {each} tells apart"
        raise haploop.ConfigurationError(f"Name the folder for {what} (--out), or look at one of them first.")
    if each is None:
        parts = [(file, file.stem, mapping) for file in files]
    else:
        parts = [
            (file, *one)
            for file in files
            for one in haploop.exchange.each_of(file, mapping, each, note).items()
        ]
    told: list[dict[str, Any]] = []
    failed = 0
    for file, name, own in parts:
        path = haploop.exchange.destination(name, wanted.out)
        try:
            with _patience("Importing", file):
                found = haploop.exchange.understand(file, haploop.exchange.named(file, own))
                haploop.import_file(found, path, wanted.at)
        except (haploop.ConfigurationError, haploop.DataError) as error:
            failed += 1
            told.append({"file": str(file), "error": str(error)})
            line = str(error)
        else:
            said = contents.file_contents(path)
            accepted = said.values.get("presses_accepted")
            told.append({"file": str(file), "out": str(path), "notes": list(found.notes), **said.values})
            line = f"{file} -> {path}: {said.kind}"
            if accepted is not None:
                line += f", {accepted} of {said.values['presses_detected']} presses accepted"
        if not wanted.as_json:
            print_line(line)
    if wanted.as_json:
        print_json({"files": told})
    elif failed:
        print_line(f"{failed} of {len(parts)} files were not imported.")
    return 2 if failed else 0


def _into_folder(files: Sequence[Path], out: Path) -> bool:
    return len(files) > 1 or out.is_dir() or out.suffix.lower() != ".h5"


def _response(
    files: Sequence[Path], out: Path | None, rig: str, which: tuple[str | None, ...], as_json: bool
) -> int:
    if len(files) > 1 or out is None:
        raise haploop.ConfigurationError(
            f"{files[0]} holds frequency responses: import one file at a time, into a file (--out FILE.h5)."
        )
    response = haploop.exchange.import_response(files[0], haploop.load_rig_file(rig), *which)
    haploop.Calibration.of(response).save(out)
    show.print_contents(contents.file_contents(out), as_json)
    return 0
