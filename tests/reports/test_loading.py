"""`haploop.load`: one function for every kind of file, and a string is a path wherever a list is taken."""

import haploop
from haploop.reports.catalogue import index as catalogue_index
from tests.raising import raises


def test_every_file_of_a_demo_is_loaded_as_what_it_holds(demo):
    files = sorted(demo.folder.glob("**/*.h5"))
    found = {type(one).__name__ for one in haploop.load(files)}
    assert found == {
        "Calibration", "Check", "Drive", "Recording", "Representative", "Waveforms",
    }  # fmt: skip


def test_folders_are_loaded_by_what_stands_in_them(tmp_path):
    study, experiment = tmp_path / "study", tmp_path / "experiment"
    study.mkdir()
    (study / "study.toml").write_text(
        'name = "pilot"\nbuttons = ["latch"]\nparticipants = ["P01"]\n', encoding="utf-8"
    )
    haploop.experiments.new_experiment(experiment, "matching")
    for named in (study, study / "study.toml"):
        assert isinstance(haploop.load(named), haploop.acquisition.Study)
    for named in (experiment, experiment / "experiment.toml"):
        assert haploop.load(named) == haploop.experiments.load_experiment(experiment)
    raises(haploop.DataError, "a folder without", haploop.load, tmp_path)
    raises(haploop.DataError, "no file", haploop.load, tmp_path / "nothing.h5")


def test_a_string_is_a_path_and_not_its_letters(demo, tmp_path, monkeypatch):
    monkeypatch.setattr(catalogue_index, "user_cache_path", lambda _: tmp_path / "cache")
    recording = str(demo.folder / "recordings" / "P01-latch.h5")
    assert haploop.load_press(recording).button == "latch"
    found = haploop.list_files(str(demo.folder / "recordings"), "button=latch")
    assert [entry.file for entry in found] == [recording]
    assert haploop.write_report(recording, tmp_path / "report.html").html.is_file()
