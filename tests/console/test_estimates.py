"""An estimate of the time before Start says whether it was measured, and is what was measured."""

import shutil
from pathlib import Path

import pytest

from haploop.acquisition import Recording
from haploop.base.clock import VirtualClock
from haploop.console.data_folder import DataFolder
from haploop.console.server.lab import of_experiment, pace
from haploop.experiments import Store, load_experiment, open_session
from tests.console.test_experiment_pages import EXPERIMENT


@pytest.fixture
def store(tmp_path: Path) -> Store:
    (tmp_path / "small").mkdir()
    (tmp_path / "small" / "experiment.toml").write_text(EXPERIMENT, encoding="utf-8")
    return Store(load_experiment(tmp_path / "small"), tmp_path / "small" / "answers")


def sit(store: Store, who: str, seconds: float, steps: int = 999, simulated: bool = False) -> None:
    """A session in which each step takes so many seconds, with a long pause after its first trial."""
    clock = VirtualClock()
    with open_session(store, who, clock, simulated=simulated, consent=lambda: True) as session:
        for number in range(steps):
            step = session.due
            if step is None:
                return
            session.presented()
            clock.sleep(seconds)
            session.answer(step.choices[0] if step.choices else "done")
            if number == 1:
                session.event("pause")
                clock.sleep(5000.0)
                session.event("continue")


def test_without_a_session_it_is_assumed_and_said_to_be(store):
    found = of_experiment(store)
    assert "assumed" in found["said"] and 0 < found["low_s"] < found["high_s"]
    sit(store, "P01", 1.0, simulated=True)
    assert of_experiment(store) == found  # no person's pace


def test_it_is_the_pace_of_earlier_sessions_without_their_pauses(store):
    sit(store, "P01", 6.0)
    sit(store, "P02", 10.0)
    found = of_experiment(store)
    steps = int(found["said"].split()[0])
    assert "measured pace of 2 earlier sessions" in found["said"] and "assumed" not in found["said"]
    assert 6.0 * steps - 1 <= found["low_s"] < found["high_s"] <= 10.0 * steps + 1


def test_blocks_that_nobody_reached_are_named(store):
    sit(store, "P01", 6.0, steps=4)
    assert "assumed for" in of_experiment(store)["said"]


def test_a_staircase_may_end_early(tmp_path):
    found = of_experiment(Store(load_experiment("staircase"), tmp_path))
    assert found["said"].startswith("up to ")


def test_a_press_takes_what_the_newest_recordings_took(made, tmp_path):
    data = DataFolder(tmp_path / "data", tmp_path / "history")
    assert "assumed" in pace(data, {})["said"]
    for name in ("P01-latch.h5", "P01-push.h5"):
        shutil.copy(made / name, data.root / name)
    each = [
        one.duration / len(one.verdicts)
        for one in map(Recording.open, (made / "P01-latch.h5", made / "P01-push.h5"))
    ]
    found = pace(data, {})
    assert (found["low_s"], found["high_s"]) == (min(each), max(each))
    assert "measured pace of 2 simulated recordings" in found["said"]
