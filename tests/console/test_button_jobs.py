"""Digital buttons of a page: how loud, other points, a second button; and what is shown of them."""

import json
from typing import Any

import pytest

import haploop
from haploop.base.errors import ConfigurationError, DataError
from haploop.calibration import DigitalButton, Drift, Loudness, Multisine
from haploop.console.data_folder import DataFolder
from haploop.console.server.data_routes import _json
from haploop.console.server.shown_routes import button_shown
from haploop.console.worker import button_jobs
from haploop.console.worker.worker import Worker
from haploop.instruments import load_rig_file
from tests.calibration.conftest import make_press
from tests.console.test_worker import DEADLINE, begin, ended, pages, until

pytestmark = pytest.mark.long

OWN = [f"calibrations-made/{patch}-button.h5" for patch in "AB"]
PUSH, TOGGLE = "recordings/push.h5", "recordings/toggle.h5"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> DataFolder:
    """Two presses, calibrations of two patches, and a map with a point that was not calibrated."""
    folder = tmp_path_factory.mktemp("buttons")
    for name in ("recordings", "calibrations-made", "maps"):
        (folder / name).mkdir()
    make_press().save(folder / PUSH)
    make_press(((150, 8, 0.012),)).save(folder / TOGGLE)
    with haploop.open_rig("four-channel", simulate="twin") as rig:
        for patch, name in zip("AB", OWN, strict=True):
            haploop.calibrate(rig, patch, excitation=Multisine()).save(folder / name)
        plan = haploop.map_plan(rig, points=(0, 13, 57, 75, 83), patches=["A", "B"])
        haploop.measure_map(rig, folder / "maps" / "map", plan)
    return DataFolder(folder, folder / "history")


def work(data: DataFolder, **wanted: object) -> dict[str, Any]:
    """The board's job, after a button was asked for and everything that the rig asks was done."""
    worker = Worker(load_rig_file("four-channel"), None, data, real_time=False)

    def over() -> bool:
        request = worker.board["request"]
        if request and request.get("asks"):
            worker.command("answer", {"number": request["number"], "yes": True})
        return ended(worker)

    def operator() -> None:
        asked = {"recordings": [PUSH], "calibrations": OWN, "name": "made", "iterations": 0}
        begin(worker, "make", **{**asked, **wanted})
        until(over, 4 * DEADLINE)

    with pages(worker, operator):
        found: dict[str, Any] = worker.board["job"]
    return found


@pytest.mark.parametrize(
    ("wanted", "sentence"),
    [
        ({"recordings": []}, "Choose at least one recording."),
        ({"recordings": PUSH}, "Choose at least one recording."),
        ({"calibrations": None}, "Choose at least one calibration."),
        ({"error": "loud"}, "The error must be a number of %, such as 5, not 'loud'."),
        ({"error": "30"}, "An error of 30% is no choice"),
        ({"error": 0}, "An error of 0% is no choice"),
        ({"level": "nan"}, "The level must be a number of dB"),
        ({"drift": "200"}, "A drift cannot be common = 2"),
        ({"also": [TOGGLE]}, "Name the one point at which the second button is to play"),
        ({"also": [TOGGLE], "also_at": "57, 75"}, "Name the one point at which the second button is to play"),
        ({"also_at": "57"}, "Choose recordings of the second button"),
        ({"size": "0.5"}, "Choose recordings of the second button, or leave its size empty."),
        (
            {"also": [TOGGLE], "also_at": "57", "size": "half"},
            "The size of the second button must be a number",
        ),
        ({"also": ["../push.h5"], "also_at": "57"}, "is no file of the console's data folder"),
        ({"map": "maps/map"}, "The map is for other points"),
        ({"map": "../map"}, "is no file of the console's data folder"),
        ({"name": ""}, "The name must have"),
    ],
)
def test_what_cannot_be_is_refused_at_once_in_one_sentence(data, wanted, sentence):
    with pytest.raises(ConfigurationError, match=r"^[^\n]+$") as refused:
        work(data, **wanted)
    assert sentence in str(refused.value)


@pytest.mark.parametrize(
    ("wanted", "sentence"),
    [
        ({"also": [TOGGLE], "also_at": "57", "quiet_at": "57"}, "Point 57 cannot be silent and play a press"),
        ({"also": [TOGGLE], "also_at": "57"}, "No patch was calibrated at the 57 point"),
        ({"quiet_at": "58", "map": "maps/map"}, "The map has no point 58"),
        ({"quiet_at": "57 75", "map": "maps/map"}, "3 points cannot be moved or kept silent at once by 2"),
        ({"quiet_at": "button"}, "none is left for the button"),
        ({"map": "recordings", "quiet_at": "57"}, "holds no map"),
        ({"also": ["recordings/none.h5"], "also_at": "57"}, "none.h5"),
        ({"also": [TOGGLE], "also_at": "57", "size": "0", "map": "maps/map"}, "cannot be 0 times the size"),
    ],
)
def test_what_the_files_do_not_allow_is_said_and_nothing_is_played(data, wanted, sentence):
    job = work(data, **wanted)
    assert job["state"] == "failed" and sentence in job["sentence"]
    assert not data.found("buttons/*")


def test_how_loud_is_what_the_command_would_be_told(data, monkeypatch):
    told: list[Loudness] = []

    def traded(_press, _calibrations, _rig, loudness, **_more):
        told.append(loudness)
        raise ConfigurationError("That is enough.")

    monkeypatch.setattr(button_jobs, "trade_for", traded)
    for wanted in ({}, {"error": " 5", "level": "", "drift": None}, {"level": 10.0, "drift": "0.1"}):
        assert work(data, **wanted)["sentence"] == "That is enough."
    assert told == [Loudness(), Loudness(error=0.05), Loudness(level=10.0, drift=Drift.usual(0.001))]


def test_two_buttons_at_once_from_a_map_and_what_came_of_both(data):
    job = work(data, also=[TOGGLE], also_at="57", size="0.5", map="maps/map", name="both")
    assert job["state"] == "done", job["sentence"]
    button = DigitalButton.load(data.path("buttons/both.h5"))
    (there,) = button.drive.elsewhere
    assert (there.point, there.known_from[:3]) == ("57", "map") and len(button.others) == 1
    assert there.scale == pytest.approx(0.5 * button.drive.scale)
    assert job["result"]["verdict"] == button.check.verdict

    own, other = (shown(data, point) for point in ("", "57"))
    assert own["points"] == other["points"] == ["button", "57"]
    assert (own["point"], other["point"]) == ("button", "57")
    assert own["check"]["whole"] == button.check.whole.summary()
    assert other["check"]["whole"] == button.check.others[0].whole.summary()
    assert own["target"] != other["target"] and own["drives"].keys() == {"A", "B"}
    rows = own["each_point"]
    assert rows == other["each_point"] and len(rows) == 4
    for row, check, felt in zip(
        rows, (button.check, *button.check.others), (own["felt"], other["felt"]), strict=False
    ):
        assert row["verdict"] == check.verdict
        assert f"error {100 * check.error:.1f} %" in row["said"] and row["said"].endswith(felt)
    assert [r["label"] for r in rows[2:]] == ["Crosstalk at the button point", "Crosstalk at the 57 point"]
    with pytest.raises(DataError, match="plays no button at the '58' point"):
        shown(data, "58")


@pytest.mark.night
def test_a_silent_point_is_shown_with_its_contrast(data):
    job = work(data, quiet_at="57", map="maps/map", name="quiet")
    assert job["state"] == "done", job["sentence"]
    check = DigitalButton.load(data.path("buttons/quiet.h5")).check
    rows = shown(data, "", "quiet")["each_point"]
    assert [row["label"] for row in rows] == ["push at the button point", "Silence at point 57"]
    assert rows[1]["said"].startswith(f"{check.silent[0].contrast_db:.0f} dB below the target; ")


def shown(data: DataFolder, point: str, name: str = "both") -> dict[str, Any]:
    """What the page is sent."""
    return json.loads(_json(button_shown(data, {"file": f"buttons/{name}.h5", "point": point})))
