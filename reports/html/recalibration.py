"""The HTML report of a recalibration, with before and after."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path
from typing import Any

from ...calibration.upkeep import History, Outcome, calibrations_of
from ...instruments import DataError
from ...instruments.files import new_file, os_error_text
from ..figures import before_and_after, responses
from ..show import OUTCOME_TITLES
from .rendering import CaptionedFigure, render

__all__ = ["write_recalibration"]


def write_recalibration(history: History, outcome: Outcome) -> Path | None:
    """Write the report of a drifted table into the history's `reports`; None for an unchanged one.

    Raises DataError when it cannot be written.
    """
    if outcome.kind == "unchanged" or not outcome.before:
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


def _summary(outcome: Outcome) -> dict[str, Any]:
    return {
        **outcome.summary(),
        "title": OUTCOME_TITLES[outcome.kind],
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
            outcome.simulated,
        )
    ]
    if outcome.kind == "restored":
        old = calibrations_of(history.find(outcome.active.parent))
        captioned.append(
            CaptionedFigure(
                responses(old, calibrations_of(outcome.active)),
                "The table's response",
                "Models of the previous and of the active calibration.",
                outcome.simulated,
            )
        )
    return captioned
