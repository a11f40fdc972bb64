"""What stands in the cells of the command line's tables, and in its JSON."""

from __future__ import annotations

import math
from typing import Any

from rich.box import SIMPLE
from rich.table import Table
from rich.text import Text

__all__ = ["fixed", "number", "pairs", "percent", "verdict"]


def pairs(title: str) -> Table:
    """A table of names and values."""
    table = Table(box=SIMPLE, title=title, title_justify="left", show_header=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    return table


def verdict(passed: bool) -> Text:
    """Whether something passed, in colour."""
    return Text("pass", style="bold green") if passed else Text("FAIL", style="bold red")


def percent(value: float | None) -> str:
    """A share; a dash where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{100 * value:.1f} %"


def fixed(value: float | None, digits: int, unit: str = "") -> str:
    """A number with so many digits, and its unit; a dash where there is none."""
    return "-" if value is None else f"{value:.{digits}f}{unit and ' ' + unit}"


def number(value: Any) -> float | None:
    """A number that JSON can say, or None."""
    return float(value) if value is not None and math.isfinite(value) else None
