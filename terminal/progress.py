"""Console output: progress on standard error, results on standard output."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self

from rich.console import Console
from rich.measure import Measurement
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Column, Table
from rich.text import Text

SIMULATED = "Simulated: no real instrument measured this."
"""What stands below each result, in each file and on each page of a simulated rig."""

_shown: list[Console] = []
"""Consoles that show something at the foot of the terminal: a sentence goes through them, above it."""
_WORD = 40
"""Longest word (characters) that a table does not break."""


class Bars:
    """Context manager: progress bars on standard error, with `numbers` after each, if it is a terminal."""

    def __init__(self, *numbers: ProgressColumn, wanted: bool = True) -> None:
        self._console = _console(stderr=True)
        self._progress = Progress(
            SpinnerColumn(finished_text="[green]done[/green]"),
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=12),
            *numbers,
            TimeElapsedColumn(),
            console=self._console,
            disable=not (wanted and self._console.is_terminal),
        )

    def __enter__(self) -> Self:
        self._progress.start()
        _shown.append(self._console)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        _shown.remove(self._console)
        self._progress.stop()


class Steps(Bars):
    """Steps of a longer command on standard error: one bar each on a terminal, otherwise one line each."""

    def __init__(self) -> None:
        super().__init__(TextColumn("{task.percentage:>3.0f} %"), TextColumn("{task.fields[amount]}"))
        self._tasks: dict[str, TaskID] = {}

    def __call__(self, doing: str, done: float, total: float, unit: str) -> None:
        """Show the progress of a step, and add it when it is new. See `haploop.base.progress.Progress`."""
        if doing not in self._tasks:
            self._tasks[doing] = self._progress.add_task(doing, total=total, amount="")
            if self._progress.disable:
                say(self._console, doing)
        self._progress.update(
            self._tasks[doing], completed=done, total=total, amount=_amount(done, total, unit)
        )


def _amount(done: float, total: float, unit: str) -> str:
    """Format `done` of `total`: tenths for seconds, whole numbers for counts."""
    if not unit:
        return ""
    digits = 1 if unit == "s" else 0
    return f"{done:.{digits}f} of {total:.{digits}f} {unit}"


def note(sentence: str) -> None:
    """Print a sentence on standard error."""
    say(_console(stderr=True), sentence)


def say(console: Console, sentence: str | Text) -> None:
    """Print a sentence, broken between words at the terminal's width; as one line if it is no terminal."""
    console.print(sentence, markup=False, highlight=False, soft_wrap=not console.is_terminal)


@contextmanager
def shown(console: Console) -> Iterator[None]:
    """Let sentences go above what `console` shows at the foot of the terminal, while this context lasts."""
    _shown.append(console)
    try:
        yield
    finally:
        _shown.remove(console)


def print_json(values: Mapping[str, Any]) -> None:
    """Print the JSON object of a command with `--json`. NaN and infinity raise ValueError."""
    print(json.dumps(values, indent=2, allow_nan=False))


def print_line(sentence: str) -> None:
    """Print a sentence on standard output."""
    say(_console(stderr=False), sentence)


def print_either(as_json: bool, values: Mapping[str, Any], *sentences: str) -> None:
    """Print a command's JSON object, or else its sentences."""
    if as_json:
        print_json(values)
        return
    for sentence in sentences:
        print_line(sentence)


def print_table(table: Table) -> None:
    """Print a table on standard output, at the terminal's width; 160 columns if it is no terminal.

    Lines break between words. A table that would have to break words is printed row by row instead.
    """
    console = _console(stderr=False)
    if not console.is_terminal and not os.environ.get("COLUMNS"):
        console.width = 160
    narrow, wide = zip(*(_widths(console, table, column) for column in table.columns), strict=True)
    # In the box SIMPLE each column has two blanks and one line beside it; the last has one more line.
    room = console.width - 3 * len(narrow) - 1
    if sum(narrow) > room and table.show_header:
        _print_rows(console, table)
        return
    widths = list(wide)
    while sum(widths) > room and (shrinking := [i for i, w in enumerate(widths) if w > narrow[i]]):
        widths[max(shrinking, key=widths.__getitem__)] -= 1
    for column, width in zip(table.columns, widths, strict=True):
        column.overflow = "fold"
        column.width = width
        column.no_wrap = False
    console.print(table)


def rows_of(table: Table) -> Iterator[tuple[Any, ...]]:
    """Yield the cells of each row of a table."""
    return zip(*(column.cells for column in table.columns), strict=True)


def _widths(console: Console, table: Table, column: Column) -> tuple[int, int]:
    """Widths of a column's longest word (a hash is not one) and of its longest line."""
    cells = [*([column.header] if table.show_header else []), *column.cells]
    found = [Measurement.get(console, console.options.update_width(10_000), cell) for cell in cells]
    wide = max((one.maximum for one in found), default=0)
    if column.no_wrap:
        return wide, wide
    longest = max((one.minimum for one in found), default=0)
    return min(longest, _WORD if table.show_header else _WORD // 2), wide


def _print_rows(console: Console, table: Table) -> None:
    """Print each row of a table as lines of heading and cell."""
    if table.title:
        console.print(table.title, style="italic")
    for cells in rows_of(table):
        row = Table.grid(padding=(0, 2, 0, 2))
        row.add_column()
        row.add_column(overflow="fold")
        for column, cell in zip(table.columns, cells, strict=True):
            if str(cell):
                row.add_row(str(column.header), cell)
        console.print()
        console.print(row)
    console.print()


def _console(stderr: bool) -> Console:
    if stderr and _shown:
        return _shown[-1]
    # Created on use, because standard output may have been replaced since the program began.
    # Without markup, because names, notes and reasons are plain text.
    return Console(file=sys.stderr if stderr else sys.stdout, markup=False, emoji=False)
