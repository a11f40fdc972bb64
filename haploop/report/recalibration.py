"""Result of `haploop recalibrate`: on standard output, and as an HTML report with before and after."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from rich.box import SIMPLE
from rich.table import Table

from haploop.calibration.upkeep import History, Outcome, calibrations_of
from haploop.instruments import DataError
from haploop.instruments.files import new_file, os_error_text
from haploop.progress import print_json, print_line, print_table
from haploop.report.report import CaptionedFigure, render
from haploop.show.history import before_and_after, responses

__all__ = ["tell", "write"]

_TITLES = {
    "unchanged": "The calibration holds",
    "restored": "The table had drifted; every button is within tolerance again",
    "drifted": "The table has drifted; not every button could be brought within tolerance",
    "broken": "Something is broken; nothing was changed",
}


def write(history: History, outcome: Outcome) -> Path | None:
    """Write the report of a table that had drifted into the history's `reports`; None for any other.

    Raises DataError when it cannot be written.
    """
    if not outcome.before:
        return None
    path = history.folder / "reports" / f"{outcome.when:%Y%m%dT%H%M%SZ}-{outcome.kind}.html"
    html = render(_summary(outcome), _captioned_figures(history, outcome), "recalibration.html")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with new_file(path) as part:
            part.write_text(html, encoding="utf-8", newline="\n")
    except (OSError, DataError) as error:
        said = str(error)
        if not isinstance(error, DataError):
            said = f"{path.parent} cannot be created: {os_error_text(error)}."
        raise DataError(
            f"The report could not be written: {said} The active calibration is {outcome.active.name}."
        ) from None
    return path


def tell(outcome: Outcome, assumed: Sequence[str], report: Path | None, as_json: bool) -> None:
    """Print the outcome. `assumed` lists requests that no operator was present to confirm."""
    summary = {**outcome.summary(), "assumed": list(assumed), "report": str(report) if report else None}
    if as_json:
        print_json(summary)
        return
    if summary["buttons"]:
        table = Table(box=SIMPLE, title=_TITLES[outcome.kind], title_justify="left")
        for heading in ("Button", "Before", "After", "Verdict"):
            table.add_column(heading, justify="left" if heading == "Button" else "right")
        for name, checks in summary["buttons"].items():
            after = checks["after"]
            verdict = "not made" if after is None else "pass" if after["passed"] else "FAIL"
            table.add_row(name, _error(checks["before"]), _error(after), verdict)
        print_table(table)
    else:
        print_line(f"{_TITLES[outcome.kind]}.")
    for sentence in outcome.sentences:
        print_line(sentence)
    for sentence in assumed:
        print_line(f"Assumed, with no operator present: {sentence}")
    print_line(f"Active: {outcome.active.name}")
    if outcome.simulated:
        print_line("Simulated: no real instrument measured this.")
    if report is not None:
        print_line(f"Report: {report}")


def _summary(outcome: Outcome) -> dict[str, Any]:
    return {
        **outcome.summary(),
        "title": _TITLES[outcome.kind],
        "rig": calibrations_of(outcome.active)[0].response.rig,
        "software": metadata.version("haploop"),
    }


def _captioned_figures(history: History, outcome: Outcome) -> list[CaptionedFigure]:
    after = {name: button.check for name, button in outcome.after.items()}
    captioned = [
        CaptionedFigure(
            before_and_after(outcome.before, after),
            "Before and after",
            "Target (orange) and measured acceleration (black) of each button, around the largest "
            "acceleration. Left: the old drive on the drifted table. Right: the new drive. A new drive has a "
            "new target, because its carrier is the present resonance.",
        )
    ]
    if outcome.kind == "restored":
        old = calibrations_of(history.find(outcome.active.parent))
        captioned.append(
            CaptionedFigure(
                responses(old, calibrations_of(outcome.active)),
                "The table's response",
                "Models of the previous and of the active calibration.",
            )
        )
    return captioned


def _error(check: dict[str, Any] | None) -> str:
    if check is None or check["nrmse"] is None:
        return "not measured"
    return f"{100 * check['nrmse']:.1f} %"
