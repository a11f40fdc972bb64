"""`haploop log` and `haploop reset`."""

import os
from pathlib import Path

import numpy as np
import pytest

from haploop.base.errors import InstrumentError
from haploop.base.json_files import as_line
from haploop.instruments import open_rig

pytestmark = pytest.mark.usefixtures("unproved")

RIG = """
base = "simulated"
name = "bench"
[[simulation.faults]]
kind = "amplifier-gain"
gain = 100.0
"""


@pytest.fixture
def tripped(tmp_path: Path) -> Path:
    path = tmp_path / "bench.toml"
    path.write_text(RIG, encoding="utf-8")
    t = np.arange(10_000) / 50_000
    with open_rig(path) as rig, pytest.raises(InstrumentError, match="The play was stopped"):
        rig.excite(40 * np.sin(2 * np.pi * 250 * t) * np.hanning(len(t)), ["A"], ["drive"])
    return path


def test_a_rig_that_was_stopped_plays_again_when_a_person_says_so(run, tripped):
    run(
        "calibrate --rig", tripped, "--out", tripped.with_name("c.h5"),
        says=("The rig is locked out", "haploop reset"),
    )  # fmt: skip
    run("reset --rig", tripped, ends=2)
    assert "needs a reason" in run("reset --rig", tripped, "--reason", "  ").stderr
    shown = run.json("log --rig", tripped)
    assert "The rig is locked out" in shown["lockout"]
    done = run("reset --rig", tripped, "--reason", "The gain was set back.")
    assert (done.exit_code, done.stdout) == (0, "") and "plays again" in done.stderr
    shown = run.json("log --rig", tripped, "--last", 1)
    assert shown["lockout"] is None
    (entry,) = shown["entries"]
    assert entry["kind"] == "reset" and entry["reason"] == "The gain was set back."
    assert "not locked out" in run("reset --rig", tripped, "--reason", "again").stderr


def test_the_log_is_a_table_for_people(run, tripped):
    result = run("log --rig", tripped, ends=0)
    for word in ("opened", "connected", "played", "tripped", "closed", "bench"):
        assert word in result.stdout
    assert "simulated" not in run("log --rig haptable").stdout


def test_the_doctor_says_what_the_limits_are_and_that_a_rig_is_locked_out(run, tripped):
    found = run.json("doctor --rig", tripped, ends=1)["findings"]
    named = {finding["name"]: finding for finding in found}
    assert named["Lockout"]["status"] == "red" and "haploop reset" in named["Lockout"]["sentence"]
    assert "opens by itself after 2 s" in named["Dead-man time"]["sentence"]
    assert "48 V" in named["Limits"]["sentence"] and "52.8 V" in named["Limits"]["sentence"]


def test_a_trip_under_a_seed_is_reset_without_it(run, tmp_path):
    path = tmp_path / "seeded.toml"
    path.write_text('base = "simulated"\nname = "seeded"\n', encoding="utf-8")
    t = np.arange(10_000) / 50_000
    wrong = {"seed": 40077, "faults": [{"kind": "amplifier-gain", "gain": 100.0}]}
    with (
        open_rig(path, simulation=wrong) as rig,
        pytest.raises(InstrumentError, match="The play was stopped"),
    ):
        rig.excite(40 * np.sin(2 * np.pi * 250 * t) * np.hanning(len(t)), ["A"], ["drive"])
    assert "The rig is locked out" in run.json("log --rig", path)["lockout"]
    with open_rig(path, simulation={"seed": 7}) as rig:
        assert rig.lockout is not None
    run("reset --rig", path, "--reason", "The gain was set back.", ends=0)
    with open_rig(path, simulation=wrong) as rig:
        assert rig.lockout is None


def test_whatever_a_script_notes_is_shown(run, tripped):
    with open_rig(tripped) as rig:
        rig.audit.note("played", patches=3, peak="x", seconds=None)
        rig.audit.note("replaced", patch="A", why={"a": [1, None, True]})
    folder = rig.audit.folder
    (folder / "log-2020-01.jsonl").write_text(as_line({"kind": "of no rig"}) + "torn\n", encoding="utf-8")
    result = run("log --rig", tripped, "--last", 1000)
    assert result.exit_code == 0 and "V peak for" in result.stdout
    for shown in ("patches: 3", "a 1, -, yes", "Line 1 of", "Line 2 of"):
        assert shown in " ".join(result.stdout.split()), shown
    run("verify", folder / "log-2020-01.jsonl", ends=1)
    assert len(run.json("log --rig", tripped, "--last", 1000)["entries"]) > 4
    (folder / "log-2020-01.jsonl").unlink()
    (folder / "log-2020-01.jsonl").mkdir()
    assert "cannot be read: Is a directory" in run("log --rig", tripped).stderr or os.name == "nt"
