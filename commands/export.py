"""`haploop export`, `import`: exchange files with other programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from ..reports import contents, show
from ..terminal.progress import SIMULATED, print_json, print_line
from . import front as haploop
from .options import JSON, NEW, PATH, RIG, FiniteRange

__all__ = ["export", "import_"]

_FORMATS = (
    "csv", "wav", "wav48", "mat", "uff", "sep005", "netcdf", "parquet", "nwb", "ahap", "haptic", "android",
    "hjif",
)  # fmt: skip


@click.command()
@click.argument("files", nargs=-1, required=True, type=PATH, metavar="FILE...")
@click.option(
    "--to", "format", required=True, type=click.Choice(_FORMATS), help="Format, see above.", metavar="FORMAT"
)
@click.option("--out", "-o", required=True, type=PATH, metavar="PATH", help="File to write.")
@JSON
def export(files: Sequence[Path], format: str, out: Path, as_json: bool) -> int:
    """Export FILE for other programs.

    FILE is a recording, a representative press, a drive, a check, a calibration, a digital button, the folder
    of a vibration map, or a study (its study.toml or its folder). A study, or several recordings, become a
    table with one row a press.

    \b
    csv, mat, uff, netcdf      all but a study (a study: csv)
    wav, wav48, sep005         signals; wav48: for a sound card, at 48 kHz
    parquet                    all (pip install "haploop[parquet]")
    nwb                        recordings (pip install "haploop[nwb]")
    ahap, haptic, android, hjif
                               phones and headsets: envelope and frequency
                               of a press, a drive, a check or a button

    A file of a format without units gets a sidecar, PATH.json.
    """  # noqa: D301 - click's mark must be the character itself
    done = haploop.export_file(files, format, out)
    if as_json:
        written = [str(file) for file in done.files]
        print_json({"kind": done.kind, "to": done.format, "files": written, "simulated": done.simulated})
    else:
        print_line(f"{' and '.join(map(str, done.files))}: {done.kind} as {done.format}.")
        if done.simulated:
            print_line(SIMULATED)
    return 0


@click.command("import")
@click.argument("file", type=PATH)
@click.option("--out", "-o", required=True, type=NEW, metavar="FILE.h5", help="File to write.")
@click.option(
    "--from",
    "format",
    type=click.Choice(("wav", "csv", "mat", "uff", "sep005")),
    help="Format of FILE: wav, csv, mat, uff or sep005.  [default: as its name ends]",
    metavar="FORMAT",
)
@click.option("--button", help="Name of the button that was pressed.  [default: as the file states]")
@click.option("--channel", help="Name of the vertical acceleration.  [default: the only one]")
@click.option(
    "--scale", type=float, metavar="NUMBER", help="m/s^2 per unit of the file.  [default: as the file states]"
)
@click.option(
    "--rate",
    type=FiniteRange(min=1),
    metavar="HZ",
    help="Sample rate of the file.  [default: as the file states]",
)
@click.option(
    "--activation",
    type=FiniteRange(min=0),
    metavar="SECONDS",
    help="When the button switched.  [default: as the file states, where its channel activation rises, or at "
    "the largest acceleration]",
)
@click.option("--patch", help="Response: patch that was driven.  [default: as the file states]")
@click.option(
    "--point",
    help="Response: measured point, button or a grid point's number.  [default: as the file states]",
)
@RIG
@JSON
def import_(
    file: Path,
    out: Path,
    format: str | None,
    button: str | None,
    channel: str | None,
    scale: float | None,
    rate: float | None,
    activation: float | None,
    patch: str | None,
    point: str | None,
    rig: str,
    as_json: bool,
) -> int:
    """Import a press, or a response, that another program measured.

    A signal (.wav, .csv, .mat, .uff, .unv, or SEP-005 as .sep005 or .json) becomes a representative press,
    which `haploop button make` turns into a digital button. Responses (.uff with frequency response
    functions, for example the export of a scanning vibrometer) become a calibration of --rig; --patch and
    --point select one of several.
    """
    if haploop.is_response_file(file, format):
        response = haploop.import_response(file, haploop.load_rig_file(rig), patch, point)
        haploop.Calibration.of(response).save(out)
    else:
        haploop.import_press(
            file, button, format=format, channel=channel, scale=scale, rate_hz=rate, activation=activation
        ).save(out)
    show.print_contents(contents.file_contents(out), as_json)
    return 0
