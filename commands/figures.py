"""`haploop figures`: the figures of a lab's data, for a paper."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import click

from ..terminal.progress import SIMULATED, Steps, print_either
from . import public as haploop
from .option_groups import COLUMNS
from .options import JSON, PATH


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
