"""`haploop report`: a report of recordings, studies, calibrations, maps, digital buttons and answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import click

from ..terminal.progress import SIMULATED, Steps, print_json, print_line
from . import front as haploop
from .options import JSON, PATH

__all__ = ["report"]


@click.command()
@click.argument("paths", nargs=-1, required=True, type=PATH, metavar="PATH...")
@click.option(
    "--out", "-o", type=PATH, default=Path("report.html"), show_default=True, help="HTML file to write."
)
@click.option("--pdf", is_flag=True, help="Also write the whole report as a PDF.")
@JSON
def report(paths: Sequence[Path], out: Path, pdf: bool, as_json: bool) -> int:
    """Write a report with verdicts, figures and captions.

    PATH is a recording, a representative press, a calibration, a drive, a check, a digital button, the
    folder of a vibration map, a study (its study.toml or its folder), a folder of such files, or a table of
    `haploop experiment export` (CSV). OUT is one HTML file that needs no other file; the folder OUT-figures
    beside it holds each figure as PDF and SVG.
    """
    if out.suffix.lower() not in (".html", ".htm"):
        raise haploop.ConfigurationError(f"{out} has the wrong file type: use a name that ends with .html.")
    with Steps() as steps:
        made = haploop.write_report(paths, out, pdf, steps)
    if as_json:
        print_json(
            {
                "report": str(made.html),
                "pdf": str(made.pdf) if made.pdf else None,
                "figures": [str(path) for path in made.figures],
                "simulated": made.simulated,
                "verdicts": [asdict(verdict) for verdict in made.verdicts],
            }
        )
        return 0
    if made.simulated:
        print_line(SIMULATED)
    print_line(f"Report: {made.html}")
    if made.pdf:
        print_line(f"PDF: {made.pdf}")
    if made.figures:
        print_line(f"Figures as PDF and SVG: {made.figures[0].parent}")
    return 0
