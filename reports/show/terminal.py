"""Results on standard output: tables and sentences, or one JSON object."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...terminal.progress import print_json, print_line, print_table
from .. import outputs
from ..contents import Cell, Contents, Grid, one_style, text_of
from .glance import print_glance

if TYPE_CHECKING:
    from ..figures import Columns

_MANY = 300
"""Rows from which a table is not fitted to the terminal: that takes 0.6 ms a row."""
_STYLES = {"": "", "good": "green", "bad": "bold red", "doubtful": "yellow", "aside": "dim"}


def print_contents(contents: Contents, as_json: bool, plot: Path | None = None, columns: Columns = 2) -> None:
    """Print what a result says, and plot it into the new file `plot` (PNG, PDF, SVG or CSV).

    Raises DataError when it has no figure, and ConfigurationError when `plot` cannot be written.
    """
    if plot is not None:
        outputs.save_picture(contents.draw(columns), plot, bool(contents.simulated))
    if as_json:
        print_json(contents.values | ({"plot": str(plot)} if plot else {}))
        return
    for glance in contents.glances:
        print_glance(glance(), Console(markup=False, emoji=False))
    if contents.rows:
        print_table(_properties(contents))
    elif contents.title:
        print_line(contents.title)
    for grid in contents.tables:
        _print_grid(grid)
    for sentence in contents.said:
        print_line(one_style(sentence))
    if plot is not None:
        print_line(f"Plot: {plot}")


def print_made(contents: Contents, file: Path, as_json: bool) -> None:
    """Print what a result that was written to a file says, without its details."""
    print_contents(contents if as_json else contents.brief(), as_json)
    if not as_json:
        print_line(f"More of it: haploop show {file}")


def _properties(contents: Contents) -> Table:
    table = Table(box=SIMPLE, title=Text(contents.title), title_justify="left", show_header=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for label, cell in contents.rows:
        table.add_row(Text(label), _text(cell))
    return table


def _print_grid(grid: Grid) -> None:
    if len(grid.rows) > _MANY:
        _print_aligned([grid.headings, *(list(map(text_of, row)) for row in grid.rows)])
    elif not grid.rows:
        print_line(grid.title)
    else:
        if grid.title:
            print_line(f"\n{grid.title}")  # a table's own title would be broken at the table's width
        table = Table(box=SIMPLE, show_header=bool(grid.headings), pad_edge=False)
        for index, heading in enumerate(grid.headings or grid.rows[0]):
            table.add_column(
                text_of(heading) if grid.headings else "",
                overflow="fold",
                justify="left" if index < grid.words else "right",
            )
        for row in grid.rows:
            table.add_row(*map(_text, row))
        print_table(table)
    if grid.below:
        print_line(one_style(grid.below))


def _print_aligned(rows: Sequence[Sequence[str]]) -> None:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        click.echo("  ".join(map(str.ljust, row, widths)).rstrip())


def _text(cell: str | Cell) -> Text:
    """A cell as text: names may look like rich markup."""
    return Text(one_style(text_of(cell)), style="" if isinstance(cell, str) else _STYLES[cell.tone])
