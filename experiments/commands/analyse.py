"""`haploop analyse`: statistics of an experiment's answers and ratings, and of a plan."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ...commands import public as haploop
from ...commands.option_groups import Shown, showing
from ...commands.options import JSON, ONLY, PATH
from ...reports import show
from ...terminal.progress import Steps
from .. import shown as contents

if TYPE_CHECKING:
    from ..analysis import Rows


@click.group(no_args_is_help=True)
def analyse() -> None:
    """Analyse answers and ratings, or a plan's power."""


@analyse.command()
@click.argument("file", type=PATH)
@click.option(
    "--within", metavar="COLUMN", default="", help="Within factor.  [default: confirmation, or day]"
)
@click.option("--between", metavar="COLUMN", default="", help="Between factor.  [default: group]")
@ONLY
@showing
def confusion(file: Path, within: str, between: str, only: Sequence[tuple[str, str]], shown: Shown) -> int:
    """Confusion matrices, and how well each class was told.

    For each class accuracy, precision and sensitivity. FILE is a CSV with the columns presented, answered and
    count (without count, each line is one trial). With group and day there is a matrix for each; with
    participant, effects are tested by a mixed analysis of variance, and intervals are over participants.
    """
    rows = _rows(file, only)
    result = haploop.experiments.analyse_identification(rows, within, between)
    shown.print(contents.identification_contents(result, rows.simulated))
    return 0


@analyse.command()
@click.argument("file", type=PATH)
@click.option(
    "--factors",
    nargs=2,
    default=("category", "button"),
    show_default=True,
    metavar="COLUMN COLUMN",
    help="The two within factors.",
)
@click.option("--between", metavar="COLUMN", default="", help="Between factor.  [default: group]")
@click.option("--as-rated", is_flag=True, help="Do not normalise by geometric means.")
@ONLY
@showing
def ratings(
    file: Path,
    factors: tuple[str, str],
    between: str,
    as_rated: bool,
    only: Sequence[tuple[str, str]],
    shown: Shown,
) -> int:
    """Effects on ratings: all adjective pairs together, and each.

    FILE is a CSV with the columns participant, category, button, pair and rating (and group).
    """
    rows = _rows(file, only)
    result = haploop.experiments.analyse_ratings(rows, factors, between, normalised=not as_rated)
    shown.print(contents.ratings_contents(result, rows.simulated))
    return 0


@analyse.command()
@click.argument("file", type=PATH)
@click.option("--by", multiple=True, metavar="COLUMN", help="Further column that tells functions apart.")
@click.option(
    "--of",
    "button",
    type=PATH,
    metavar="BUTTON.h5",
    help="Digital button whose amplitude was compared with nothing: state what people of this lab feel.",
)
@ONLY
@JSON
def thresholds(
    file: Path, by: Sequence[str], button: Path | None, only: Sequence[tuple[str, str]], as_json: bool
) -> int:
    """Psychometric function of each participant.

    Of two-interval forced choice or staircases. FILE is a CSV with the columns comparison and correct (and
    participant). Needs psignifit (pip install "haploop[psychometrics]").

    With --of, the thresholds of a button's amplitude become the table [people] of a rig file: from then on
    each check on that rig says by them, and no longer by an estimate, whether a person feels a button.

    No threshold is stated of answers no better than chance, that fall, or whose threshold lies outside what
    was compared; --of leaves them out, by name.

    Exit codes: 0 each has a threshold, 1 somebody has none.
    """
    rows = _rows(file, only)
    played = None if button is None else haploop.DigitalButton.load(button)
    found = haploop.experiments.analyse_thresholds(rows, tuple(by))
    columns = [column for column in ("participant", *by) if column in rows.columns]
    lab = None
    if played is not None:
        lab = haploop.experiments.lab_threshold_of(found, played, simulated=rows.simulated)
    show.print_contents(contents.thresholds_contents(found, columns, rows, lab), as_json)
    return 1 if any(one.why_none for one in found) else 0


@analyse.command()
@click.argument("plan", type=PATH)
@click.option(
    "--runs",
    type=click.IntRange(10, 100_000),
    default=500,
    show_default=True,
    help="Simulated experiments for each number of participants.",
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the simulation."
)
@JSON
def power(plan: Path, runs: int, seed: int, as_json: bool) -> int:
    """Power of a planned identification experiment, by simulation.

    PLAN is a TOML file: numbers of participants, trials, and expected fractions of right answers.
    """
    loaded = haploop.experiments.load_power_plan(plan)
    with Steps() as steps:
        found = haploop.experiments.power_of(loaded, runs, seed, progress=steps)
    show.print_contents(contents.power_contents(found), as_json)
    return 0


def _rows(file: Path, only: Sequence[tuple[str, str]]) -> Rows:
    rows = haploop.experiments.read_rows(file)
    for column, value in only:
        rows = rows.choose(column, value)
    return rows
