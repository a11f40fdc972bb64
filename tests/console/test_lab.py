"""The first page's state of the lab: calibration and drift, newest results, what studies still want."""

import os
import shutil
from pathlib import Path

import pytest

from haploop.console.data_folder import DataFolder
from haploop.console.server.lab import lab, names
from haploop.reports.catalogue import index


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> DataFolder:
    monkeypatch.setattr(index, "user_cache_path", lambda _: tmp_path / "cache")
    return DataFolder(tmp_path / "data", tmp_path / "history")


def test_an_empty_folder_has_nothing_and_no_fault(data):
    found = lab(data, {})
    assert found == {"calibration": {"name": "", "problem": ""}, "newest": [], "studies": []}


def test_newest_results_come_first_with_their_verdicts(data, demo):
    shutil.copytree(demo.folder / "recordings", data.root / "recordings")
    shutil.copytree(demo.folder / "checks", data.root / "checks")
    for number, path in enumerate(sorted((data.root / "checks").iterdir())):
        os.utime(path, (4e9 + number, 4e9 + number))
    newest = lab(data, {})["newest"]
    assert [one["kind"] for one in newest] == ["check"] * 3 + ["recording"] * 3
    assert [one["about"] for one in newest[:3]] == ["toggle", "push", "latch"]
    assert newest[0]["result"] == "pass"
    assert newest[3]["result"].startswith("complete ") and newest[3]["about"].startswith("P01 ")


def test_names_are_those_of_studies_and_of_recordings(data, demo):
    assert names(data, {})["participants"] == {"study": [], "recorded": []}
    shutil.copytree(demo.folder / "recordings", data.root / "recordings")
    for name, text in (
        ("pilot", 'name = "pilot"\nbuttons = ["soft"]\nparticipants = ["P07"]\n'),
        ("wrong", 'name = "wrong"\n'),  # what is wrong with it, the first page says
    ):
        (data.root / name).mkdir()
        (data.root / name / "study.toml").write_text(text, encoding="utf-8")
    found = names(data, {})
    assert found["participants"] == {"study": ["P07"], "recorded": ["P01"]}
    assert found["buttons"] == {"study": ["soft"], "recorded": ["latch", "push", "toggle"]}
    assert found["recordings"] == ["P01-latch", "P01-push", "P01-toggle"]


def test_studies_say_what_is_due_and_a_broken_one_what_is_wrong(data):
    for name, text in (
        (
            "pilot",
            'name = "pilot"\nbuttons = ["latch", "push"]\nparticipants = ["P01", "P02"]\npresses = 3\n',
        ),
        ("wrong", 'name = "wrong"\n'),
    ):
        (data.root / name).mkdir(parents=True)
        (data.root / name / "study.toml").write_text(text, encoding="utf-8")
    pilot, wrong = lab(data, {})["studies"]
    assert (pilot["accepted"], pilot["of"]) == (0, 12)
    assert len(pilot["due"]) == 3 and pilot["more"] == 1 and pilot["due"][0].startswith("P01 ")
    assert "the key" in wrong["problem"]
