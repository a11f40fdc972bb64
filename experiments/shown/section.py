"""Experiments and tables of answers as sections of a report."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from tempfile import TemporaryDirectory

from ...base.errors import DataError, HaploopError
from ...reports.contents import Contents
from ...reports.html import Section
from ..analysis import analyse_identification, analyse_ratings, analyse_thresholds, read_rows
from ..protocol import load_experiment
from ..session import Store, export_answers
from .analysis import identification_contents, ratings_contents, thresholds_contents
from .experiment import plan_of_experiment


def experiment_section(folder: Path) -> Section:
    """The answers of an experiment, as its exported table would say them; without scores, what it is.

    Raises DataError.
    """
    store = Store(load_experiment(folder), folder / "answers")
    if not any(step.analysed for one in store.sessions() for step, *_ in one.answers):
        return _plan(store, "Nobody has answered yet.")
    with TemporaryDirectory() as place:
        table = Path(place) / f"{folder.resolve().name}.csv"
        export_answers(store, table)
        try:
            return answers_section(table)
        except HaploopError as error:
            return _plan(store, f"There are no scores yet. {str(error).replace(f'{place}{os.sep}', '')}")


def answers_section(path: Path) -> Section:
    """A CSV of answers or of ratings, analysed as `haploop analyse` does by default. Raises DataError."""
    return Section(_answers(path), [(path.name, hashlib.sha256(path.read_bytes()).hexdigest())])


def _plan(store: Store, why: str) -> Section:
    return Section(
        plan_of_experiment(store, why), [(store.experiment.path.name, store.experiment.content_hash)]
    )


def _answers(path: Path) -> Contents:
    rows, of = read_rows(path), f", {path.name}"
    if {"presented", "answered"} <= set(rows.columns):
        return identification_contents(analyse_identification(rows), rows.simulated, of)
    if {"pair", "rating"} <= set(rows.columns):
        return ratings_contents(analyse_ratings(rows), rows.simulated, of)
    if {"comparison", "correct"} <= set(rows.columns):
        return thresholds_contents(analyse_thresholds(rows), ("participant",), rows, title=f"Thresholds{of}")
    raise DataError(
        f"{path} has none of the columns presented and answered, pair and rating, or comparison and "
        "correct: name a table of `haploop experiment export`."
    )
