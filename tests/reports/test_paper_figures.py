"""Figures for a paper from a lab's own files: those whose data are there, and what the others take."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from haploop.base.errors import ConfigurationError, DataError
from haploop.reports.html import contents_at, write_figures
from tests.command_line import Run


@pytest.fixture
def matching(run: Run, tmp_path: Path) -> Path:
    """An experiment that simulated people have answered."""
    folder = tmp_path / "study" / "matching"
    folder.parent.mkdir()
    assert run("experiment", "new", folder, "--from", "matching").exit_code == 0
    assert run("experiment", "simulate", folder, "--participants", 2).exit_code == 0
    return folder


@pytest.mark.parametrize(("columns", "millimetres"), [(1, 88), (2, 180)])
def test_a_button_has_its_figures_in_a_journal_s_width(
    columns: int, millimetres: float, made: Path, tmp_path: Path
) -> None:
    out = tmp_path / "figures"
    done = write_figures(made / "latch.h5", out, paper=True, columns=1 if columns == 1 else 2)
    names = {path.stem for path in done.files}
    assert names == {"figure-6-presses", "figure-8-drives", "figure-9-motion"}
    assert {path.suffix for path in done.files} == {".pdf", ".svg", ".csv"}
    assert sorted(done.missing) == [3, 7, 13, 14] and done.simulated
    points = re.search(r'width="([\d.]+)pt"', (out / "figure-8-drives.svg").read_text("utf-8"))
    assert points and float(points[1]) / 72 * 25.4 == pytest.approx(millimetres, abs=0.6)
    assert "Voltage (V)" in (out / "figure-8-drives.csv").read_text("utf-8")
    with pytest.raises(ConfigurationError, match="figures already exists"):
        write_figures(made / "latch.h5", out, paper=True)


def test_a_study_s_folder_stands_for_its_experiments(matching: Path, run: Run, tmp_path: Path) -> None:
    (matching.parent / "study.toml").write_text(
        'name = "pilot"\nbuttons = ["latch"]\nparticipants = ["P01"]\n', encoding="utf-8"
    )
    result = run("figures", matching.parent, "--paper", "-o", tmp_path / "figures")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "figures" / "figure-13-confusion.pdf").is_file()
    assert "No figure 14: it takes adjective ratings." in result.stdout


def test_an_experiment_says_its_scores_without_an_export(matching: Path) -> None:
    told = contents_at(matching)
    assert told.simulated and [one.name for one in told.figures] == ["confusion"]
    headings = {heading.lower() for grid in told.tables for heading in grid.headings}
    assert {"sensitivity", "precision", "accuracy"} <= headings


def test_data_without_a_figure_are_refused(run: Run, tmp_path: Path) -> None:
    run("experiment", "new", tmp_path / "rating", "--from", "rating")
    with pytest.raises(DataError, match="holds no answer"):
        write_figures(tmp_path / "rating", tmp_path / "figures", paper=True)
    assert not (tmp_path / "figures").exists()
