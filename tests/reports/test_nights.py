"""The nights of a history: each mode's drift is followed through renewals."""

import csv
import io
from pathlib import Path
from typing import Any

import pytest

from haploop.base.errors import DataError
from haploop.calibration import History
from haploop.reports.contents.history import night
from haploop.reports.figures import encode
from haploop.reports.figures.history import nights_figure


def look(day: int, outcome: str, compared_with: str, modes: dict[float, float]) -> dict[str, Any]:
    """A night on which the calibrated modes (Hz) were found shifted."""
    found = [{"hz": hz, "shift": shift} for hz, shift in modes.items()]
    return {
        "when": f"2026-11-{day:02d}T02:15:00+00:00", "outcome": outcome, "compared_with": compared_with,
        "active": compared_with, "places": [{"patch": "A", "point": "button", "modes": found}],
        "sentences": [outcome], "buttons": {},
    }  # fmt: skip


NIGHTS = [
    look(1, "unchanged", "0001", {200.0: 0.0, 260.0: 0.001}),
    look(2, "broken", "0001", {}),
    look(3, "restored", "0001", {200.0: 0.02, 260.0: -0.01}),
    look(4, "unchanged", "0002", {204.0: 0.0, 257.4: 0.0}),
]


def drawn(looks: list[dict[str, Any]]) -> dict[str, list[float]]:
    """By panel, the drift (%) that its curve shows."""
    rows = csv.DictReader(io.StringIO(encode(nights_figure(looks), "csv").decode()))
    found: dict[str, list[float]] = {}
    for row in rows:
        if row["curve"] == "drift":
            found.setdefault(row["panel"][2:], []).append(float(row["y"]))
    return found


def test_each_mode_is_followed_through_a_renewal_and_nights_without_one_have_no_figure():
    assert drawn(NIGHTS) == {
        "200 Hz": pytest.approx([0, 2, 2], abs=1e-6),
        "260 Hz": pytest.approx([0.1, -1, -1], abs=1e-6),
    }
    with pytest.raises(DataError, match="No night has measured a mode"):
        nights_figure([NIGHTS[1]])


@pytest.mark.parametrize(
    ("number", "drift", "done"),
    [
        (0, 0.001, "nothing played"),
        (1, None, "nothing played; nothing changed"),
        (2, 0.02, "0 buttons made anew; 0001 is active"),
    ],
)
def test_a_line_of_a_night(number, drift, done, tmp_path):
    line = night(History(tmp_path), NIGHTS[number])
    assert (line["drift"], line["done"], line["report"]) == (drift, done, None)


@pytest.mark.parametrize(
    ("rig", "folder"), [("lab.toml", "lab-calibrations"), ("simulated", "data/simulated-calibrations")]
)
def test_a_rig_has_one_history(rig, folder, tmp_path, monkeypatch):
    (tmp_path / "lab.toml").write_text('base = "simulated"\n', encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert History.of_rig(rig, "data").folder == Path(folder)
