import os
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from haploop.base.errors import InstrumentError
from haploop.calibration.recalibration.history import History
from haploop.commands.options import ChosenRig
from haploop.instruments.operator.role import Aim, ConfirmSettings, Place, Press, Rest
from haploop.instruments.operator.unattended import Unattended
from haploop.instruments.safety.machine import hold
from haploop.reports.figures.history import trend
from tests.command_line import Run
from tests.reports.figure_checks import overlaps

pytestmark = pytest.mark.long

REASON = ("--reason", "for a test")


@pytest.fixture(scope="session")
def button(made: Path) -> Path:
    return made / "latch.h5"


@pytest.fixture(scope="session")
def folder(button: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A history of two nights: one without a drift, one with."""
    place = tmp_path_factory.mktemp("history")
    folder = place / "calibrations"
    drifted = _drifted(place)
    commands = [
        ["calibrations", "adopt", button, "--reason", "it begins"],
        ["recalibrate"],
        ["recalibrate", "--rig", drifted],
    ]
    for command in commands:
        Run()(*command, "--calibrations", folder, ends=0)
    return folder


@pytest.fixture
def history(folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(folder, tmp_path / "calibrations"))


def _drifted(place: Path, extra: str = "") -> Path:
    path = place / "drifted.toml"
    path.write_text(f"[simulation]\nmode_drift = 0.03\n{extra}", encoding="utf-8")
    return path


def asked(run: Run, *args: Any) -> dict[str, Any]:
    values: dict[str, Any] = run.json(*args)
    return values


def test_a_drift_is_reported_with_before_and_after(folder):
    history = History(folder)
    assert [look["outcome"] for look in history.looks] == ["unchanged", "restored"]
    (report,) = (folder / "reports").glob("*-restored.html")
    html = report.read_text(encoding="utf-8")
    assert "The table had drifted; every button is within tolerance again" in html
    assert "Everything here is simulated." in html
    cell = r"<td>(?:at most )?([\d.]+)\s%</td>"
    before, after = re.findall(f"latch-A-button</th>{cell}{cell}", html)[0]
    assert float(before) > 50 and float(after) < 20
    assert html.count("data:image/svg+xml;base64,") == 3
    assert not re.search("https?:", html)
    linked = re.findall(r'href="([^"]+)"', html)
    assert len(linked) == 9 and all((report.parent / one).is_file() for one in linked)


def test_the_active_one_is_told(history, run):
    at = ("--calibrations", history)
    found = asked(run, "calibrations", "list", *at)
    first, second = found["generations"]
    assert found["active"] == second["name"] and second["parent"] == first["name"]
    assert first["reason"] == "it begins" and "changed by +3.0" in second["reason"]
    assert asked(run, "calibrations", "show", *at)["name"] == second["name"]
    shown = asked(run, "calibrations", "show", "1", *at)
    assert shown["simulated"] and shown["buttons"]["latch-A-button"]["passed"]
    change = asked(run, "calibrations", "diff", "1", *at)["places"]["A-button"]
    assert change["to"]["resonance_hz"] / change["from"]["resonance_hz"] == pytest.approx(1.03, abs=1e-3)
    for command in (["list"], ["show", "2"], ["diff", "1", "2"]):
        assert first["name"][:8] in run("calibrations", *command, *at).stdout
    assert "Simulated: no real instrument measured this." in run("calibrations show 1", *at).stdout


def test_an_earlier_one_can_be_activated_and_nothing_is_lost(history, run):
    at = ("--calibrations", history)
    assert asked(run, "calibrations", "activate", "1", *REASON, *at)["name"].startswith("0001-")
    last = History(history).activations[-1]
    assert last.generation.startswith("0001-") and last.reason == "for a test"
    assert "calibrations activate" in last.actor
    assert len(History(history).generations) == 2
    damaged = next((history / History(history).find("2").name / "buttons").glob("*.h5"))
    damaged.write_bytes(damaged.read_bytes()[:-1])
    run("calibrations activate 2", *REASON, *at, says="damaged")
    run("calibrations activate 7", *REASON, *at, says="no calibration '7'")
    run("calibrations activate 1", *REASON, *at, "--rig", "bench", says="not on 'bench'")
    assert len(History(history).activations) == 3


def test_what_is_broken_ends_with_three(history, run, tmp_path):
    rig = _drifted(tmp_path, '[[simulation.faults]]\nkind = "laser-blocked"\n')
    active = History(history).active()
    said = run.json("recalibrate --rig", rig, "--calibrations", history, ends=3)
    assert said["outcome"] == "broken" and "laser does not see" in Path(said["report"]).read_text("utf-8")
    assert "laser does not see the surface" in said["sentences"][0]
    assert "Aim the laser at the button point." in said["assumed"]
    assert History(history).active() == active
    result = run("recalibrate --rig", rig, "--calibrations", history, ends=3)
    assert "Something is broken; nothing was changed" in result.stdout
    *_, night, _ = asked(run, "calibrations", "list", "--calibrations", history)["nights"]
    assert night["outcome"] == "broken" and "laser does not see" in night["why"]
    assert night["done"] == "nothing played; nothing changed" and night["report"].endswith("-broken.html")


def test_a_rig_that_does_not_open_is_a_broken_night(history, run, monkeypatch):
    def opened(*_):
        raise InstrumentError("The card Dev1 does not answer.")

    monkeypatch.setattr(ChosenRig, "opened", opened)
    result = run("recalibrate --calibrations", history)
    assert result.exit_code == 3 and "The card Dev1 does not answer." in result.stdout
    assert History(history).looks[-1]["sentences"] == ["The card Dev1 does not answer."]
    listed = run("calibrations list --calibrations", history).stdout
    assert "broken" in listed and "The card Dev1 does not answer." in listed
    before = len(History(history).looks)
    run("recalibrate --calibrations", history, "--rig", "bench", says="the folder of its own history")
    assert len(History(history).looks) == before


def test_what_cannot_begin_plays_nothing(history, run, tmp_path):
    result = run("recalibrate --calibrations", tmp_path / "none", says="no active calibration")
    assert "simulated (" not in result.stderr
    with hold({os.path.normcase(history.resolve())}, "This test"):
        result = run("recalibrate --calibrations", history)
    assert result.exit_code == 3 and "open in this program" in result.stderr
    run("recalibrate --calibrations", history, "--laser-at", "84", says="The table has no point")


def test_a_laser_left_elsewhere_is_broken(history, run):
    result = run("recalibrate --calibrations", history, "--laser-at", "37", ends=3)
    assert "was not measured: the laser would need to be aimed." in result.stdout


def test_the_history_stands_beside_the_rig_file(button, run, tmp_path):
    (tmp_path / "own.toml").write_text('base = "simulated"\n', encoding="utf-8")
    asked(run, "calibrations", "adopt", button, *REASON, "--rig", tmp_path / "own.toml")
    assert History(tmp_path / "own-calibrations").active().reason == "for a test"


def test_the_trend_shows_every_look_and_what_was_active(folder, run, tmp_path):
    out = tmp_path / "trend.png"
    assert asked(run, "calibrations", "plot", out, "--calibrations", folder)["looks"] == 2
    assert out.read_bytes().startswith(b"\x89PNG")
    run("calibrations plot", out, "--calibrations", folder, ends=2)
    figure = trend(History(folder))
    assert overlaps(figure) == overlaps(trend(History(folder), 1)) == []
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["Resonance (Hz)", "Damping ratio (%)", "Gain (m/s² per V)", "Coherence"]
    drawn = [y for line in figure.axes[0].lines for y in line.get_ydata()]
    assert min(drawn) == pytest.approx(263.2, abs=1) and max(drawn) == pytest.approx(271.1, abs=1)


def test_nobody_is_there():
    nobody = Unattended("37")
    assert all(map(nobody.confirm, (Aim("37"), ConfirmSettings("20 mm/s?"), Rest(1))))
    assert not nobody.confirm(Aim("button"))
    assert not nobody.confirm(Place(0.5)) and not nobody.confirm(Press("latch", "P01", 1, 1))
    assert list(nobody.assumed) == [
        "Aim the laser at point 37.",
        "20 mm/s?",
        "Hands off for 1 s: the sensors' rest is being measured.",
    ]
