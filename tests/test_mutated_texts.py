"""Text files that haploop reads, with any byte changed: refused in one sentence, at no cost of memory.

Those that haploop writes for itself have a content hash, and are never taken as whole with other content.
"""

import json
from collections.abc import Callable
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haploop.acquisition import load_study, verify
from haploop.acquisition.recording import Rejection, add_rejections
from haploop.acquisition.recording.recording import _rejections
from haploop.base.json_files import append_json, read_json, write_json
from haploop.calibration.map.folder import MapFolder, MapPlan
from haploop.calibration.recalibration.history import History
from haploop.calibration.response import Response
from haploop.calibration.response.uff import read_uff, write_uff
from haploop.console.worker.link import Address
from haploop.experiments.analysis.power import load_power_plan
from haploop.experiments.protocol import load_experiment
from haploop.instruments import load_rig_file
from haploop.instruments.config.ati_cal import read_ati_cal
from haploop.instruments.live import watching
from haploop.instruments.safety.duty import count_plays, plays_of
from haploop.instruments.safety.lockout import Lockout, lockout_of, set_lockout
from tests.calibration.recalibration.test_history import publish
from tests.instruments.config.test_ati_cal import cal
from tests.mutating import mutations, refused
from tests.raising import raises

PLAN = MapPlan("rig", "{}", True, 2, 2, ("0", "1"), ("A",), False, 1.5, 5000.0, 15.0, 600.0, 2.0, ("0",), 5)


def rejections(folder: Path) -> tuple[Path, Callable[[], Any]]:
    add_rejections(folder, [Rejection("P01-push.h5", "0" * 64, n, 1, "why", "now") for n in range(3)])
    return folder / "rejections.json", lambda: _rejections(folder)


def map_plan(folder: Path) -> tuple[Path, Callable[[], Any]]:
    MapFolder.create(folder / "map", PLAN)
    return folder / "map" / "map.json", lambda: MapFolder.open(folder / "map").plan


def history_file(name: str) -> Callable[[Path], tuple[Path, Callable[[], Any]]]:
    def make(folder: Path) -> tuple[Path, Callable[[], Any]]:
        history = History(folder / "history")
        generation = publish(history)
        history.activate(generation, when=datetime(2026, 1, 1, tzinfo=UTC), actor="a", reason="b")
        history.note({"outcome": "unchanged", "shift": 1e-3, "places": [1, 2]})
        path = generation.folder / name if name == "generation.json" else history.folder / name
        return path, lambda: (history.active(), history.activations, history.looks)

    return make


OURS = {
    "rejections": rejections, "map": map_plan, "activations": history_file("activations.json"),
    "looks": history_file("looks.json"), "generation": history_file("generation.json"),
}  # fmt: skip


@pytest.mark.parametrize("kind", OURS)
@pytest.mark.timeout(3600)
def test_a_changed_file_of_haploops_own_is_refused_or_says_the_same(kind, tmp_path, full):
    path, read = OURS[kind](tmp_path)
    raw, whole = path.read_bytes(), read()
    assert verify(path) == ()
    for changed in mutations(raw, 500 if full else 100, seed=len(kind)):
        path.write_bytes(changed)
        found: list[Any] = []
        if not refused(lambda found=found: found.append(read())):
            assert found == [whole]
            assert verify(path) == ()


def study(folder: Path) -> tuple[Path, Callable[[], Any]]:
    path = folder / "study.toml"
    path.write_text(
        'name = "trial"\nrig = "simulated"\nbuttons = ["latch", "push"]\nparticipants = ["P01", "P02"]\n'
        'presses = 3\n[prompts]\nready = "{participant}, {button}?"\n[button.latch]\nforce = [1.0, 9.5]\n'
        "[button.latch.segmentation]\nquiet = 0.3\n",
        encoding="utf-8",
    )
    return path, lambda: load_study(folder).progress()


def rig(folder: Path) -> tuple[Path, Callable[[], Any]]:
    path = folder / "rig.toml"
    path.write_bytes((resources.files("haploop.rigs") / "simulated.toml").read_bytes())
    return path, lambda: load_rig_file(path)


def ati(folder: Path) -> tuple[Path, Callable[[], Any]]:
    path = folder / "FT12345.cal"
    path.write_text(cal(), encoding="utf-8")
    return path, lambda: read_ati_cal(path)


def uff(folder: Path) -> tuple[Path, Callable[[], Any]]:
    path = folder / "a.uff"
    f = np.arange(20.0, 60.0)
    H = np.exp(1j * f) * 1e-3
    empty = np.zeros(0)
    response = Response(
        patch="A", point="3", frequencies=f, velocity=H, deviation=np.abs(H), coherence=np.full(len(f), 0.9),
        path=np.ones(len(f), complex), noise=empty, distortion=np.zeros((0, 0)), repeats=1, level=1.0,
        levels=empty, level_gain=empty.astype(complex), pickup_range=1.0, excitation="made", source="test",
        rig="rig", rig_file="", simulated=True, created="now",
    )  # fmt: skip
    write_uff(path, [response])
    return path, lambda: read_uff(path)


def experiment(folder: Path) -> tuple[Path, Callable[[], Any]]:
    path = folder / "experiment.toml"
    path.write_bytes(load_experiment("matching").path.read_bytes())
    return path, lambda: load_experiment(path)


def power(folder: Path) -> tuple[Path, Callable[[], Any]]:
    path = folder / "power.toml"
    classes = "latch = 0.75\ntoggle = 0.75\npush = 0.75\n"
    text = "".join(f"[correct.{s}.{c}]\n{classes}" for s in ("I", "II") for c in ("none", "given"))
    path.write_text(f"people = [12]\ntrials = 10\n{text}", encoding="utf-8")
    return path, lambda: load_power_plan(path)


@pytest.mark.parametrize("make", [study, rig, ati, uff, experiment, power], ids=lambda make: make.__name__)
@pytest.mark.timeout(3600)
def test_a_changed_file_of_others_is_refused_in_one_sentence_or_read(make, tmp_path, full):
    path, read = make(tmp_path)
    raw = path.read_bytes()
    read()
    number = 0
    for changed in mutations(raw, 500 if full else 60, seed=3):
        path.write_bytes(changed)
        number += refused(read)
    assert number > 10


@pytest.mark.parametrize("make", [study, rig, ati, uff, experiment, power, *OURS.values()])
@pytest.mark.parametrize(
    "content",
    [b"[" * 100_000, b"a = " + b"[" * 100_000, b"a = " + b"9" * 5000, b"9" * 5000, b'{"format": ' * 20_000,
     b"<a>" * 100_000, b"\xef\xbb\xbf", b"\0" * 1000, b"\xff\xfe" * 10, b"    -1\n   151\n" * 100],
    ids=["[", "TOML [", "long number", "JSON number", "objects", "elements", "BOM", "0", "UTF-16", "sets"],
)  # fmt: skip
def test_what_exhausts_a_parser_is_one_sentence(make, content, tmp_path):
    path, read = make(tmp_path)
    path.write_bytes(content)
    assert refused(read)


def test_a_list_and_a_value_come_back_and_another_kind_is_said(tmp_path):
    path = tmp_path / "a.json"
    for number in range(3):
        append_json(path, "numbers", [{"n": number}])
    assert read_json(path, "numbers", list) == [{"n": 0}, {"n": 1}, {"n": 2}]
    assert len(path.read_text(encoding="utf-8").splitlines()) == 6  # one entry a line
    assert json.loads(path.read_bytes())["content"] == [{"n": 0}, {"n": 1}, {"n": 2}]
    raises(Exception, "is not a haploop map", read_json, path, "map", dict)
    raises(Exception, "already exists and is not overwritten", write_json, path, "numbers", [])


def test_a_changed_lockout_locks_and_a_changed_count_of_plays_is_a_full_minute(tmp_path, full):
    spans, now = [(1000.0, 1001.5), (1010.0, 1012.0)], 1020.0
    lockout = Lockout("now", "why", "me", "samples.npz")
    set_lockout(tmp_path, {"card"}, lockout)
    count_plays(tmp_path, {"card"}, spans)
    changes = {path: mutations(path.read_bytes(), 500 if full else 60, seed=3) for path in tmp_path.iterdir()}
    assert len(changes) == 2 and plays_of(tmp_path, {"card"}, now) == spans
    for path, changed in ((path, one) for path, some in changes.items() for one in some):
        path.write_bytes(changed)
        assert lockout_of(tmp_path, {"card"}) is not None
        assert plays_of(tmp_path, {"card"}, now) in (spans, [(now - 60, now)])


@pytest.mark.parametrize("read", [watching._read, Address.read])
@pytest.mark.parametrize(
    "content", [b"", b"[" * 100_000, b'{"rig": "a", "port": 1e999, "token": "b"}', b"[1]", b'"a"', b"\xff"]
)
def test_an_address_of_a_running_program_that_cannot_be_one_is_none(read, content, tmp_path):
    path = tmp_path / "live-1.json"
    path.write_bytes(content)
    assert read(path) is None
