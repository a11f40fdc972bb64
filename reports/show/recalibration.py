"""The outcome of `haploop recalibrate`, on standard output."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.box import SIMPLE
from rich.table import Table

from ...calibration.upkeep import Outcome
from ...terminal.progress import SIMULATED, print_json, print_line, print_table
from .formatting import verdict

__all__ = ["OUTCOME_TITLES", "show_outcome"]

OUTCOME_TITLES = {
    "unchanged": "The calibration holds",
    "restored": "The table had drifted; every button is within tolerance again",
    "drifted": "The table has drifted; not every button could be brought within tolerance",
    "broken": "Something is broken; nothing was changed",
}
"""Title of each kind of outcome."""


def show_outcome(outcome: Outcome, assumed: Sequence[str], report: Path | None, as_json: bool) -> None:
    """Print the outcome. `assumed` lists requests that no operator was present to confirm."""
    summary = {**outcome.summary(), "assumed": list(assumed), "report": str(report) if report else None}
    if as_json:
        print_json(summary)
        return
    if summary["buttons"]:
        table = Table(box=SIMPLE, title=OUTCOME_TITLES[outcome.kind], title_justify="left")
        for heading in ("Button", "Before", "After", "Verdict"):
            table.add_column(heading, justify="left" if heading == "Button" else "right")
        for name, checks in summary["buttons"].items():
            after = checks["after"]
            # On an unchanged table, the old drive is the one that is judged.
            judged = checks["before"] if outcome.kind == "unchanged" else after
            said = verdict(judged["verdict"]) if judged else "not made"
            table.add_row(name, _error(checks["before"]), _error(after), said)
        print_table(table)
    else:
        print_line(f"{OUTCOME_TITLES[outcome.kind]}.")
    for sentence in outcome.sentences:
        print_line(sentence)
    for sentence in assumed:
        print_line(f"Assumed, with no operator present: {sentence}")
    print_line(f"Active: {outcome.active.name}")
    if outcome.simulated:
        print_line(SIMULATED)
    if report is not None:
        print_line(f"Report: {report}")


def _error(check: dict[str, Any] | None) -> str:
    if check is None or check["wideband_nrmse"] is None:
        return "not measured"
    return f"{100 * check['wideband_nrmse']:.1f} %"
