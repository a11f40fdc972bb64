from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.haploop.conftest import Demo, Run


@pytest.fixture(scope="module")
def made(demo: Demo, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("made") / "latch.h5"


def test_a_button_is_made_shown_and_verified(demo: Demo, made: Path, run: Run, tmp_path: Path) -> None:
    recording = next((demo.folder / "recordings").glob("*latch*.h5"))
    table = demo.folder / "calibration.h5"
    result = run("button", "make", recording, "-c", table, "-o", made, "--iterations", 0, "--json")
    values = json.loads(result.stdout)
    assert result.exit_code == (0 if values["passed"] else 1)
    assert values["kind"] == "button" and values["simulated"] and values["button"] == "latch"
    assert values["sources"][0]["file"] == recording.name
    assert len(values["iterations"]) == 1 and values["unreached"]

    shown = run("show", made, "--plot", tmp_path / "latch.png")
    assert shown.exit_code == 0 and (tmp_path / "latch.png").stat().st_size > 10_000
    assert "Digital latch button, pass" in shown.output and "Simulated" in shown.output
    again = run("button", "check", made, "--json")
    assert again.exit_code == 0 and json.loads(again.stdout)["passed"]

    taken = run("button", "make", recording, "-c", table, "-o", made)
    assert taken.exit_code == 2 and "exists" in taken.output


def test_what_is_no_button_is_refused(demo: Demo, run: Run) -> None:
    result = run("button", "check", demo.folder / "calibration.h5")
    assert result.exit_code == 2 and "is not a haploop button" in result.output
