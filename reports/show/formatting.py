"""Formatting of values for the command line's tables and JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from rich.box import SIMPLE
from rich.table import Table
from rich.text import Text

from ...calibration import Resonance

__all__ = [
    "ANSWERS_SIMULATED",
    "damping",
    "fixed",
    "interval",
    "json_number",
    "percent",
    "property_table",
    "verdict",
]

ANSWERS_SIMULATED = "Simulated participants answered: no person did."


def property_table(title: str) -> Table:
    """Create a table with two columns: property and value."""
    table = Table(box=SIMPLE, title=title, title_justify="left", show_header=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    return table


def verdict(said: str) -> Text:
    """The words "pass", "FAIL" or "not shown", in colour."""
    styles = {"pass": "bold green", "fail": "bold red", "not shown": "bold yellow"}
    return Text("FAIL" if said == "fail" else said, style=styles[said])


def interval(edges: Sequence[float | None]) -> str:
    """A confidence interval as percentages."""
    low, high = edges
    return f"{percent(low)} to {percent(high)}"


def percent(value: float | None) -> str:
    """A fraction as a percentage; "-" for None and NaN."""
    return "-" if value is None or not math.isfinite(value) else f"{100 * value:.1f} %"


def fixed(value: float | None, digits: int, unit: str = "") -> str:
    """A number with fixed decimals and its unit; "-" for None."""
    return "-" if value is None else f"{value:.{digits}f}{unit and ' ' + unit}"


def json_number(value: Any) -> float | None:
    """A finite float for JSON; None for None, NaN and infinity."""
    return float(value) if value is not None and math.isfinite(value) else None


def damping(resonance: Resonance) -> str:
    """Damping ratio of a resonance in percent, with its interval of 95 %, or the bound that is known."""
    low, high = resonance.damping_interval
    if resonance.damping_is_bound:
        return f"at most {100 * high:.2g} %"
    return f"{100 * resonance.damping:.3g} % ({100 * low:.3g} to {100 * high:.3g} %)"
