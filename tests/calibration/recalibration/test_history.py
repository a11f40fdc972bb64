import os
import random
import time
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from haploop.acquisition import verify
from haploop.base import json_files
from haploop.base.errors import DataError, InstrumentError
from haploop.base.json_files import write_json
from haploop.calibration.recalibration.history import Activation, Generation, History
from tests.calibration.map.killing import Victims
from tests.raising import raises

WHEN = datetime(2026, 7, 31, 2, 15, tzinfo=UTC)


@dataclass(frozen=True)
class Part:
    content: bytes = b"measured"

    def save(self, path: str | Path) -> None:
        Path(path).write_bytes(self.content)


class Unwritable(Part):
    def save(self, path: str | Path) -> None:
        raise DataError("there is no room.")


def publish(history: History, content: bytes = b"measured", when: datetime = WHEN, **more: Any) -> Generation:
    parts = {"calibrations/A-button.h5": Part(content), "buttons/latch-A-button.h5": Part()}
    return history.add(parts, when=when, reason="because", details={"n": 1}, **more)


@pytest.fixture
def history(tmp_path: Path) -> History:
    return History(tmp_path / "calibrations")


def test_nothing_is_made_before_anything_is_kept(history):
    assert history.generations == history.activations == history.looks == ()
    assert not history.folder.exists()
    raises(DataError, r"no active calibration.*adopt", history.active)
    raises(DataError, "no calibration '3'; it has none", history.find, "3")


def test_a_generation_is_published_whole_and_then_activated(history):
    first = publish(history)
    assert first.name == "0001-20260731T021500Z"
    assert [p.name for p in first.paths("buttons")] == ["latch-A-button.h5"]
    assert (first.reason, first.details, first.parent) == ("because", {"n": 1}, "")
    raises(DataError, "no active calibration", history.active)
    line = history.activate(first, when=WHEN, actor="somebody", reason="it begins")
    assert history.active() == first
    second = publish(history, b"other", parent=first.name)
    assert second.name.startswith("0002-") and history.active() == first
    history.activate(second, when=WHEN + timedelta(hours=1), actor="cron", reason="drifted")
    assert history.active() == second == history.find("active")
    assert second == history.find("2") == history.find(second.name)
    history.activate(first, when=WHEN + timedelta(hours=2), actor="somebody", reason="was better")
    assert history.active() == first
    assert [a.reason for a in history.activations] == ["it begins", "drifted", "was better"]
    begun = Activation(first.name, first.digest, "2026-07-31T02:15:00+00:00", "somebody", "it begins")
    assert history.activations[0] == line == begun
    assert history.generations == (first, second)


def test_numbers_go_on_past_four_digits(history):
    publish(history).folder.rename(history.folder / "9999-20260731T021500Z")
    assert [publish(history).name[:5] for _ in range(2)] == ["10000", "10001"]
    assert [g.name.partition("-")[0] for g in history.generations] == ["9999", "10000", "10001"]


@pytest.mark.parametrize("name", ["calibrations/A-button.h5", "buttons/latch-A-button.h5", "generation.json"])
@pytest.mark.parametrize("how", ["changed", "gone"])
def test_what_is_not_whole_is_never_active(history, name, how):
    generation = publish(history)
    history.activate(generation, when=WHEN, actor="", reason="")
    path = generation.folder / name
    content = path.read_bytes()
    path.unlink()
    if how == "changed":
        path.write_bytes(content.replace(b"e", b"f", 1))
    raises(DataError, "activate another with `haploop calibrations activate`", history.active)
    if name != "generation.json":
        raises(DataError, name, history.activate, generation, when=WHEN, actor="", reason="")
        assert len(history.activations) == 1


def test_a_list_that_was_cut_or_changed_is_said_and_not_added_to(history):
    generation = publish(history)
    for _ in range(2):
        history.activate(generation, when=WHEN, actor="a", reason="b")
    path = history.folder / "activations.json"
    whole = path.read_bytes()
    for changed in (*(whole[:cut] for cut in range(len(whole) - 1)), whole.replace(b'"b"', b'"c"', 1)):
        path.write_bytes(changed)
        raises(DataError, r"activations\.json is damaged", history.active)
    with pytest.raises(DataError, match=r"activations\.json is damaged"):
        history.activate(generation, when=WHEN, actor="a", reason="b")
    path.write_bytes(whole)
    assert history.active() == generation
    assert verify(path) == verify(generation.folder / "generation.json") == ()


@pytest.mark.parametrize("content", [{"a": 1}, [1], [{"generation": "0001"}], "no list"])
def test_another_content_is_said(history, content):
    history.folder.mkdir(parents=True)
    write_json(history.folder / "activations.json", "activations", content)
    raises(DataError, r"activations\.json holds", history.active)


def test_a_manifest_of_a_later_version_is_said(history, monkeypatch):
    with monkeypatch.context() as later:
        later.setattr(json_files, "VERSION", 2)
        folder = publish(history).folder
    raises(DataError, "format 2 and this version reads 1", Generation.open, folder)


def test_what_cannot_be_written_leaves_nothing(history):
    kept = publish(history)
    with pytest.raises(DataError, match="no room"):
        history.add(
            {"a/b.h5": Part(), "a/c.h5": Unwritable()}, when=WHEN, reason="", details={}, parent=kept.name
        )
    assert [p.name for p in history.folder.iterdir()] == [kept.name]


def test_looks_are_kept(history):
    history.note({"outcome": "unchanged"})
    history.note({"outcome": "drifted", "places": [1]})
    assert history.looks == ({"outcome": "unchanged"}, {"outcome": "drifted", "places": [1]})


def test_one_writer_at_a_time_and_what_a_dead_one_left_goes(history):
    publish(history)
    left = history.folder / ".0002-20260731T021500Z.part"
    left.mkdir()
    (left / "a.h5").write_bytes(b"half")
    publish(history)
    assert not left.exists()
    with (
        history.hold(),
        pytest.raises(InstrumentError, match="The history of calibrations is open in this program"),
        history.hold(),
    ):
        pass
    with history.hold():
        pass


WRITER = """
from datetime import UTC, datetime
from haploop.base import json_files
from haploop.acquisition import verify
from haploop.base.json_files import write_json
from haploop.base import json_files
from haploop.calibration.recalibration.history import History
from tests.calibration.map.killing import serve
from tests.calibration.recalibration.test_history import Part

def write(folder):
    history = History(folder)
    while True:
        with history.hold():
            parts = {f"{kind}/{n}.h5": Part(bytes(200_000)) for kind in ("a", "b") for n in range(3)}
            now, parent = datetime.now(UTC), history.active().name
            g = history.add(parts, when=now, reason="r", details={}, parent=parent)
            history.activate(g, when=now, actor="w", reason="r")
            history.note({"active": g.name})

serve(write)
"""


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.skipif(os.name == "nt", reason="Windows has no fork, which makes many kills cheap")
def test_a_kill_leaves_exactly_one_active_and_it_is_whole(history, full):
    """The writer does nothing but publish and activate, so that every kill falls into the middle of it."""
    rng = random.Random(7)
    history.activate(publish(history), when=WHEN, actor="", reason="")
    left = 0
    with Victims(WRITER) as victims:
        for _ in range(400 if full else 20):
            victim = victims.begin(str(history.folder))
            time.sleep(rng.uniform(0.001, 0.4))
            assert victims.kill(victim) == -9
            # Whole, or this raises; and it is the newest that anybody was told of.
            active = history.active()
            assert all(look["active"] <= active.name for look in history.looks)
            for generation in history.generations[-9:]:
                generation.verify()
            left += any(history.folder.glob(".*"))
    for generation in history.generations:
        generation.verify()
    print(f"{left} parts left, {len(history.generations)} generations")
    assert left > 2
    assert len(history.activations) > 2
    # The next run removes what the killed ones left.
    history.activate(publish(history), when=WHEN, actor="", reason="")
    history.note({})
    assert not any(history.folder.glob(".*"))
