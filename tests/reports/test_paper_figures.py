"""Figures for a paper from a lab's own files: those whose data are there, and what the others take."""

import re
from pathlib import Path

import pytest

from haploop import open_rig, record
from haploop.base.errors import ConfigurationError, DataError
from haploop.reports.html import contents_at, write_figures
from tests.command_line import Run
from tests.raising import raises


@pytest.fixture
def matching(run: Run, tmp_path: Path) -> Path:
    """An experiment that simulated people have answered."""
    folder = tmp_path / "study" / "matching"
    folder.parent.mkdir()
    run("experiment new", folder, "--from", "matching", ends=0)
    run("experiment simulate", folder, "--participants", 2, ends=0)
    return folder


@pytest.mark.long
@pytest.mark.parametrize(("columns", "millimetres"), [(1, 88), pytest.param(2, 180, marks=pytest.mark.long)])
def test_a_button_has_its_figures_in_a_journal_s_width(columns, millimetres, made, tmp_path):
    out = tmp_path / "figures"
    done = write_figures(made / "latch.h5", out, paper=True, columns=1 if columns == 1 else 2)
    names = {path.stem for path in done.files}
    assert names == {"figure-6-presses", "figure-8-drives", "figure-9-motion"}
    assert {path.suffix for path in done.files} == {".pdf", ".svg", ".csv"}
    assert sorted(done.missing) == [3, 7, 13, 14] and done.simulated
    points = re.search(r'width="([\d.]+)pt"', (out / "figure-8-drives.svg").read_text("utf-8"))
    assert points and float(points[1]) / 72 * 25.4 == pytest.approx(millimetres, abs=0.6)
    assert "Voltage (V)" in (out / "figure-8-drives.csv").read_text("utf-8")
    raises(ConfigurationError, "figures already exists", write_figures, made / "latch.h5", out, paper=True)


@pytest.mark.long
def test_figure_6_tells_two_people_s_presses_apart(made, tmp_path):
    with open_rig("simulated") as rig:
        recordings = [record(rig, "latch", who, 2, tmp_path / "recordings").path for who in ("P01", "P02")]
    write_figures(recordings, tmp_path / "alone", paper=True)
    drawn = (tmp_path / "alone" / "figure-6-pressed.csv").read_text("utf-8")
    assert "Latch, P01" in drawn and "Latch, P02" in drawn
    done = write_figures([*recordings, made / "latch.h5"], tmp_path / "together", paper=True)
    sixth = {path.stem for path in done.files if "figure-6" in path.name}
    assert sixth == {"figure-6-presses"} and 6 not in done.missing


def test_a_study_s_folder_stands_for_its_experiments(matching, run, tmp_path):
    (matching.parent / "study.toml").write_text(
        'name = "pilot"\nbuttons = ["latch"]\nparticipants = ["P01"]\n', encoding="utf-8"
    )
    result = run("figures", matching.parent, "--paper", "-o", tmp_path / "figures", ends=0)
    assert (tmp_path / "figures" / "figure-13-confusion.pdf").is_file()
    assert "No figure 14: it takes adjective ratings." in result.stdout


def test_an_experiment_says_its_scores_without_an_export(matching):
    told = contents_at(matching)
    assert told.simulated and [one.name for one in told.figures] == ["confusion"]
    headings = {heading.lower() for grid in told.tables for heading in grid.headings}
    assert {"sensitivity", "precision", "accuracy"} <= headings


@pytest.mark.parametrize("name", ["matching", "rating", "staircase", "two-interval"])
def test_an_experiment_without_answers_says_what_it_asks(run, tmp_path, name):
    run("experiment new", tmp_path / name, "--from", name)
    told = contents_at(tmp_path / name / "experiment.toml")
    assert told.notes[0] == "Nobody has answered yet." and told.tables[0].rows and not told.figures
    labels = {label for label, _ in told.rows}
    assert {"Kind", "Question" if name != "rating" else "Pairs"} <= labels


def test_few_answers_say_why_there_are_no_scores(run, tmp_path):
    run("experiment new", tmp_path / "staircase", "--from", "staircase")
    plan = tmp_path / "staircase" / "experiment.toml"
    plan.write_text(re.sub(r"max_trials.*|reversals.*", "", plan.read_text("utf-8")), encoding="utf-8")
    text = plan.read_text("utf-8").replace("[comparison]", "[comparison]\nmax_trials = 6")
    plan.write_text(text, encoding="utf-8")
    run("experiment simulate", tmp_path / "staircase", "--participants", "1", ends=0)
    told = contents_at(tmp_path / "staircase")
    assert told.notes[0].startswith("There are no scores yet. ") and str(tmp_path) not in told.notes[0]
    assert told.tables[1].title == "Sessions" and told.simulated


def test_data_without_a_figure_are_refused(run, tmp_path):
    run("experiment new", tmp_path / "rating", "--from", "rating")
    raises(DataError, "no such figure", write_figures, tmp_path / "rating", tmp_path / "figures", paper=True)
    assert not (tmp_path / "figures").exists()
