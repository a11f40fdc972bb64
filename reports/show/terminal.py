"""Results on standard output: tables, sentences and verdicts drawn in braille, or one JSON object."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...terminal.progress import print_json, print_line, print_table
from .. import outputs
from ..contents import Cell, Contents, Grid, one_style, text_of

if TYPE_CHECKING:
    from ...base.arrays import FloatArray
    from ..contents import Gauge, Glance, Motion
    from ..figures import Columns

_KEY = {"recorded": "grey: recorded press", "measured": "blue: measured", "activation": "yellow: activation"}
_ROWS, _WIDEST = 6, 72
"""Lines of the figure, and its largest width (characters)."""
_GAUGE = 24
"""Characters of a gauge's scale."""
_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bits of a braille character (rows, columns)."""
_MARKS = {"scale": "─", "range": "░", "interval": "━", "limit": "│", "value": "●"}
_COLOURS = {
    "measured": "blue",
    "recorded": "bright_black",
    "activation": "yellow",
    "limit": "yellow",
    "value": "bold",
    "scale": "bright_black",
    "range": "bright_black",
    "interval": "",
}
_TONES = {"good": "bold green", "bad": "bold red", "doubtful": "bold yellow"}


def print_glance(glance: Glance, console: Console) -> None:
    """Print a glance: drawn where the terminal shows braille, and in words elsewhere."""
    tone = _TONES.get(glance.verdict.tone, "bold")
    head = Text.assemble(glance.title, "  ", (text_of(glance.verdict), tone))
    console.print(head, highlight=False)
    drawn = console.is_terminal and not console.is_dumb_terminal and not console.legacy_windows
    if drawn and console.encoding.lower().startswith("utf"):
        console.print(_figure(glance.motion, min(console.width - 1, _WIDEST)), no_wrap=True, highlight=False)
        widest = max(len(one.label) for one in glance.gauges)
        for one in glance.gauges:
            line = Text.assemble(f"{one.label:<{widest}}  ", _scale(one), f"  {one.said}")
            console.print(line, no_wrap=True, overflow="ellipsis", highlight=False)
    else:
        said = "; ".join(f"{one.label}: {one.said}" for one in glance.gauges)
        console.print(f"{said}.", soft_wrap=True, highlight=False)
    console.print(glance.sentence, soft_wrap=not console.is_terminal, highlight=False)


def _figure(motion: Motion, width: int) -> Text:
    """Recorded press (grey), measured motion (blue) and activation (yellow); the later one is on top."""
    cells = np.zeros((_ROWS, width), dtype=int)
    owner = np.full((_ROWS, width), "", dtype=object)
    time = np.linspace(motion.time[0], motion.time[-1], 2 * width)
    if motion.activation is not None:
        across = int(np.argmin(np.abs(time - motion.activation)))
        for down in range(0, 4 * _ROWS, 2):
            _dot(cells, owner, (down, across), "activation")
    curves = {"recorded": motion.recorded, "measured": motion.measured}
    for name, curve in curves.items():
        if curve is not None:
            _curve(cells, owner, np.interp(time, motion.time, curve) / motion.top, name)
    text = Text()
    for row in range(_ROWS):
        for bits, name in zip(cells[row], owner[row], strict=True):
            text.append(chr(0x2800 + bits), _COLOURS.get(name, ""))
        text.append("\n")
    first, last = motion.ends
    room = width - len(first) - len(last)
    key = f" {'; '.join(_KEY[name] for name, _ in motion.strokes() if name in _KEY)} "
    text.append(f"{first}{key[:room]:^{room}}{last}", "bright_black")
    return text


def _curve(cells: np.ndarray, owner: np.ndarray, values: FloatArray, name: str) -> None:
    """Draw a curve (dots across) of values from -1 to 1, joined from dot to dot."""
    down = np.round((4 * _ROWS - 1) * (0.5 - 0.5 * np.clip(values, -1, 1))).astype(int)
    for across, (here, before) in enumerate(zip(down, [down[0], *down[:-1]], strict=True)):
        step = 1 if here >= before else -1
        for level in range(before + step if here != before else here, here + step, step):
            _dot(cells, owner, (level, across), name)


def _dot(cells: np.ndarray, owner: np.ndarray, at: tuple[int, int], name: str) -> None:
    (row, line), (column, side) = divmod(at[0], 4), divmod(at[1], 2)
    cells[row, column] |= _DOTS[line][side]
    owner[row, column] = name


def _scale(gauge: Gauge) -> Text:
    """A gauge's scale with its marks, each on top of those before it."""
    line = [("scale", _MARKS["scale"])] * _GAUGE
    for name, x, _, width, _ in gauge.marks()[1:]:
        middle = x + width / 2 if name in ("limit", "value") else x
        first = min(_GAUGE - 1, int(middle / 100 * _GAUGE))
        count = 1 if name in ("limit", "value") else max(1, round(width / 100 * _GAUGE))
        line[first : first + count] = [(name, _MARKS[name])] * len(line[first : first + count])
    return Text.assemble(*((mark, _COLOURS[name]) for name, mark in line))


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
