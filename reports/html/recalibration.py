"""The HTML report of a recalibration, with before and after."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

from ...base.errors import DataError, HaploopError
from ...base.files import new_file, os_error_text
from ...calibration.upkeep import History, Outcome
from ..contents import outcome_contents
from .page import CaptionedFigure, Page
from .sections import write_formats


def write_recalibration(history: History, outcome: Outcome) -> Path | None:
    """Write the report of a look into the history's `reports`, with a folder of its figures beside it; None
    for an unchanged table.

    Raises DataError when it cannot be written.
    """
    if outcome.kind == "unchanged":
        return None
    path = history.report(outcome.when, outcome.kind)
    contents = outcome_contents(history, outcome)
    figures = [
        CaptionedFigure(
            one.draw(one.things, 2), one.title, one.caption, outcome.simulated, f"{path.stem}/{one.name}"
        )
        for one in contents.figures
    ]
    html = Page(contents.title, f"haploop {metadata.version('haploop')}", [contents], figures).html()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        for figure in figures:
            write_formats(figure, path.parent / figure.beside)
        with new_file(path) as part:
            part.write_text(html, encoding="utf-8", newline="\n")
    except (OSError, HaploopError) as error:
        said = str(error)
        if not isinstance(error, HaploopError):
            said = f"{path.parent} cannot be created: {os_error_text(error)}."
        raise DataError(
            f"The report could not be written: {said} The active calibration is {outcome.active.name}."
        ) from None
    return path
