"""Console output: progress on standard error, results on standard output."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table

__all__ = ["Bars", "Steps", "note", "print_json", "print_line", "print_table"]


class Bars:
    """Progress bars on standard error, with `numbers` after each, where that is a terminal; a context."""

    def __init__(self, *numbers: ProgressColumn, wanted: bool = True) -> None:
        self._console = _console(stderr=True)
        self._progress = Progress(
            SpinnerColumn(finished_text="[green]done[/green]"),
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=24),
            *numbers,
            TimeElapsedColumn(),
            console=self._console,
            disable=not (wanted and self._console.is_terminal),
        )

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()


class Steps(Bars):
    """Steps of a longer command on standard error: a bar each on a terminal, else a line each."""

    def __init__(self) -> None:
        super().__init__(TextColumn("{task.percentage:>3.0f} %"), TextColumn("{task.fields[amount]}"))
        self._tasks: dict[str, TaskID] = {}

    def __call__(self, doing: str, done: float, total: float, unit: str) -> None:
        """Show a step's progress; a new step is added. See `haploop.Progress`."""
        if doing not in self._tasks:
            self._tasks[doing] = self._progress.add_task(doing, total=total, amount="")
            if self._progress.disable:
                self._console.print(doing, markup=False, highlight=False)
        self._progress.update(
            self._tasks[doing], completed=done, total=total, amount=_amount(done, total, unit)
        )


def _amount(done: float, total: float, unit: str) -> str:
    """`done` of `total` in words: whole numbers for what is counted, tenths of a second."""
    if not unit:
        return ""
    digits = 1 if unit == "s" else 0
    return f"{done:.{digits}f} of {total:.{digits}f} {unit}"


def note(sentence: str) -> None:
    """Print a sentence on standard error."""
    _console(stderr=True).print(sentence, markup=False, highlight=False, soft_wrap=True)


def print_json(values: Mapping[str, Any]) -> None:
    """Print the JSON object of a command with `--json`. NaN and infinity raise ValueError."""
    print(json.dumps(values, indent=2, allow_nan=False))


def print_line(sentence: str) -> None:
    """A sentence on standard output."""
    _console(stderr=False).print(sentence, markup=False, highlight=False, soft_wrap=True)


def print_table(table: Table) -> None:
    """A table on standard output, as wide as it needs to be when that is no terminal."""
    console = _console(stderr=False)
    if not console.is_terminal:
        console.width = 160
    console.print(table)


def _console(stderr: bool) -> Console:
    # Made when needed: standard output may have been replaced since the program began.
    return Console(file=sys.stderr if stderr else sys.stdout)
