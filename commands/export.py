"""`haploop export`, `figures`: files for other programs, and the figures of a lab's data for a paper."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import click

from ..terminal.progress import SIMULATED, Steps, print_either
from . import public as haploop
from .option_groups import COLUMNS
from .options import JSON, PATH


class _Format(click.Choice[str]):
    """A format; of a picture, which command writes it."""

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """See `click.Choice.convert`. Raises ConfigurationError for a picture."""
        if value in ("svg", "pdf", "png"):
            raise haploop.ConfigurationError(
                "Figures, as SVG, PDF and CSV of what each draws, are written by another command: haploop "
                "figures FILE --out DIR."
            )
        return super().convert(value, param, ctx)


_FORMATS = ("csv", "wav", "wav48", "mat", "uff", "xdf", "ahap", "haptic", "android", "hjif")


@click.command()
@click.argument("files", nargs=-1, required=True, type=PATH, metavar="FILE...")
@click.option(
    "--to", "format", required=True, type=_Format(_FORMATS), help="Format, see above.", metavar="FORMAT"
)
@click.option("--out", "-o", required=True, type=PATH, metavar="PATH", help="File to write.")
@click.option(
    "--of",
    type=click.Choice(("table", "press")),
    default="table",
    show_default=True,
    help="Of a digital button, for a phone: what the table plays, or the press that was recorded.",
)
@JSON
def export(
    files: Sequence[Path], format: str, out: Path, of: Literal["table", "press"], as_json: bool
) -> int:
    """Export FILE for other programs.

    FILE is a recording, a representative press, a drive, a check, a calibration, a digital button, a
    curve, the folder of a vibration map, or a study (its study.toml or its folder). A study, or several
    recordings, become a table with one row a press.

    \b
    csv                        all
    mat, uff                   all but a study and a curve
    wav, wav48                 signals; wav48: for a sound card, at 48 kHz
    xdf                        a recording, with its LSL streams on its time
    ahap, haptic, android, hjif
                               phones and headsets: envelope and frequency
                               of a press, a drive, a check or a button

    A file of a format without units gets a sidecar, PATH.json. Figures of FILE, and their data, are
    written by `haploop figures`.
    """  # noqa: D301 - click's mark must be the character itself
    done = haploop.export_file(files, format, out, of=of)
    written = [str(file) for file in done.files]
    values = {"kind": done.kind, "to": done.format, "files": written, "simulated": done.simulated}
    said = f"{' and '.join(written)}: {done.kind} as {done.format}."
    print_either(as_json, values, said, *([SIMULATED] if done.simulated else []))
    return 0


# `haploop figures`: the figures of a lab's data, for a paper.


@click.command()
@click.argument("paths", nargs=-1, required=True, type=PATH, metavar="PATH...")
@click.option("--paper", is_flag=True, help="Only the figures of the paper: 3, 6, 7, 8, 9, 13 and 14.")
@click.option(
    "--out",
    "-o",
    type=PATH,
    default=Path("figures"),
    show_default=True,
    metavar="DIR",
    help="Folder to write.",
)
@COLUMNS
@JSON
def figures(paths: Sequence[Path], paper: bool, out: Path, columns: Literal[1, 2], as_json: bool) -> int:
    """Write figures for a paper, from your own data.

    PATH is a study (its folder) or anything that `haploop report` reads. Each figure is written as PDF, as
    SVG, and as CSV: the numbers that it draws. With `--paper`, a study's folder stands for its recordings,
    digital buttons, vibration maps and experiments, and what a missing figure takes is said.
    """
    with Steps() as steps:
        made = haploop.reports.write_figures(paths, out, paper=paper, columns=columns, progress=steps)
    values = {
        "figures": [str(path) for path in made.files],
        "missing": {str(number): takes for number, takes in made.missing.items()},
        "simulated": made.simulated,
    }
    said = [str(path) for path in made.files if path.suffix == ".pdf"]
    said += [f"No figure {number}: it takes {takes}." for number, takes in made.missing.items()]
    print_either(as_json, values, *said, *([SIMULATED] if made.simulated else []))
    return 0
