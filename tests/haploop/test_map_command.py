from __future__ import annotations

import json
from pathlib import Path

import pytest

from haploop.pytest_plugin import Rigs
from tests.haploop.conftest import Run


def test_a_small_map_is_measured_shown_and_drawn(run: Run, tmp_path: Path, rigs: Rigs) -> None:
    if rigs.mode != "twin":
        pytest.skip("the command opens a rig of its own")
    out = tmp_path / "map"
    done = run("map", "--out", out, "--points", "3,17", "--patches", "A", "--json")
    assert done.exit_code == 0, done.output
    values = json.loads(done.stdout)
    assert values["simulated"] is True and values["points_measured"] == 2
    assert values["best"]["patch"] == "A"
    gif = tmp_path / "map.gif"
    again = run("map", "--out", out, "--points", "3,17", "--patches", "A", "--json", "--gif", gif)
    assert json.loads(again.stdout) == values
    assert gif.read_bytes().startswith(b"GIF89a")
    assert sorted(p.name for p in tmp_path.iterdir() if "gif" in p.name) == ["map.gif"]
    shown = run("show", out, "--plot", tmp_path / "map.png")
    assert shown.exit_code == 0 and "one patch at a time" in shown.stdout and "Simulated" in shown.stdout
    assert (tmp_path / "map.png").stat().st_size > 10_000
    other = run("map", "--out", out, "--points", "3,18", "--patches", "A")
    assert other.exit_code == 2 and "points" in other.stderr


def test_requests_that_make_no_map(run: Run, tmp_path: Path) -> None:
    for wrong in (("--points", "x"), ("--points", "84"), ("--patches", "Q"), ("--gif", "map.png")):
        assert run("map", "--out", tmp_path / "map", *wrong).exit_code == 2
    assert not (tmp_path / "map").exists()
