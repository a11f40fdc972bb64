"""Things that a person does on the first days, and the sentence that each gets."""

from pathlib import Path

import numpy as np
import pytest

import haploop
from haploop.experiments import Store, new_experiment


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one recording."""
    folder = tmp_path_factory.mktemp("recordings")
    with haploop.open_rig("simulated") as rig:
        haploop.record(rig, "push", "P01", 2, folder)
    return folder


def test_a_folder_that_is_named_like_a_shipped_rig_hides_it_not(tmp_path, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "usb-6211").mkdir()
    assert haploop.load_rig_file("usb-6211").name == "usb-6211"
    run("rig check usb-6211", ends=0)


def test_one_recording_and_a_folder_are_represented(recorded, run, tmp_path):
    (path,) = recorded.glob("*.h5")
    one = haploop.representative(haploop.Recording.open(path), method="mean")
    assert one.button == "push"
    run("represent", recorded, "--average", "mean", "--out", tmp_path / "press.h5", ends=0)
    assert np.array_equal(haploop.load(tmp_path / "press.h5").acceleration, one.acceleration)


def test_a_second_operator_and_a_second_day_get_their_own_words(run, tmp_path):
    folder = tmp_path / "matching"
    new_experiment(folder, "matching")
    store = Store(haploop.experiments.load_experiment(folder), folder / "answers")
    with store.hold("The experiment"):
        result = run("experiment run", folder, "-p", "P01", "--simulated")
    assert result.exit_code == 2 and "is open in this program already" in result.stderr, result.stderr
    days = store.experiment.file.sessions
    assert days > 1
    for day in range(1, days + 1):
        result = run("experiment run", folder, "-p", "P01", "--simulated", ends=0)
        assert ("is this really day 2?" in " ".join(result.stderr.split())) == (day == 2)
