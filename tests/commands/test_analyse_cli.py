"""`haploop analyse`: tables, JSON, figures, and one sentence for a wrong file."""

import csv
import json

import pytest

from tests.experiments.analysis.test_confusion import OVERALL, paper_csv, written
from tests.experiments.analysis.test_power import plan
from tests.experiments.analysis.test_ratings import ratings


def test_confusion_as_json(run, tmp_path):
    result = run("analyse confusion", paper_csv(tmp_path), "--json")
    values = json.loads(result.stdout)
    assert result.exit_code == 0
    assert values["classes"]["latch"].keys() == {"accuracy", "precision", "sensitivity"}
    assert values["overall"] == pytest.approx(1000 / 1200)
    found = {(one["group"], one["day"]): round(100 * one["overall"], 2) for one in values["matrices"]}
    assert found == OVERALL


def test_what_is_not_defined(run, tmp_path):
    path = written(tmp_path, "presented,answered,count\nlatch,latch,3\npush,latch,1\n")
    values = run.json("analyse confusion", path)
    assert values["classes"]["push"] == {"accuracy": 0.75, "precision": None, "sensitivity": 0.0}
    assert "not defined" in run("analyse confusion", path).stdout


def test_figures_are_new_files(run, tmp_path):
    path = paper_csv(tmp_path)
    for _ in range(2):
        result = run("analyse confusion", path, "--plot", tmp_path / "13.png")
    assert result.exit_code == 2 and "already exists" in result.stderr
    assert (tmp_path / "13.png").read_bytes().startswith(b"\x89PNG")
    ratings(tmp_path)
    result = run("analyse ratings", tmp_path / "ratings.csv", "--plot", tmp_path / "14.png", "--json")
    assert result.exit_code == 0 and (tmp_path / "14.png").is_file()
    values = json.loads(result.stdout)
    assert [e["effect"] for e in values["manova"]["by_person"]] == ["category", "button", "category x button"]


def test_power(run, tmp_path):
    values = run.json("analyse power", plan(tmp_path), "--runs", 20)
    assert values["simulated"] and len(values["power"]) == 7
    assert "Power" in run("analyse power", plan(tmp_path), "--runs", 20).stdout


def test_thresholds_of_simulated_participants(run, tmp_path):
    """The model's: Weibull with 0.2 and slope 2, so that half of the way is at 0.2 ln(2)^(1/2) = 0.167."""
    pytest.importorskip("psignifit")
    data, table = tmp_path / "answers", tmp_path / "out.csv"
    run("experiment simulate two-interval -n 1 -d", data, ends=0)
    run("experiment export two-interval", table, "-d", data, ends=0)
    one = run.json("analyse thresholds", table)["thresholds"][0]
    assert one["participant"] == "P01" and one["trials"] == 120
    assert one["interval"][0] < 0.667 < one["interval"][1] and 0.55 < one["threshold"] < 0.8
    assert one["standard"] == 0.5 and one["difference"] == pytest.approx(one["threshold"] - 0.5)
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    for row in rows:
        row.update({n: str(1 - float(row[n])) for n in ("first_value", "second_value", "comparison")})
    below = table.with_name("below.csv")
    with below.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    mirrored = run.json("analyse thresholds", below)["thresholds"][0]
    assert mirrored["threshold"] == pytest.approx(1 - one["threshold"], abs=0.02)
    assert mirrored["difference"] == pytest.approx(one["difference"], abs=0.02)
    _, *lines = below.read_text(encoding="utf-8").splitlines()
    both = table.with_name("both.csv")
    both.write_text("\n".join([*table.read_text(encoding="utf-8").splitlines(), *lines]), encoding="utf-8")
    assert "on both sides of the standard, 0.5" in run("analyse thresholds", both).stderr
    short = table.with_name("short.csv")
    short.write_text("\n".join(table.read_text(encoding="utf-8").splitlines()[:15]), encoding="utf-8")
    assert "a threshold needs 20 trials" in run("analyse thresholds", short).stderr


@pytest.mark.night
def test_thresholds_of_a_button_become_what_people_of_the_lab_feel(demo, run, tmp_path):
    pytest.importorskip("psignifit")
    button, data, table = tmp_path / "push.h5", tmp_path / "answers", tmp_path / "out.csv"
    press, calibration = demo.folder / "presses" / "push.h5", demo.folder / "calibration.h5"
    run("button make", press, "-c", calibration, "-o", button, "--iterations", 0, ends=0)
    run("experiment simulate staircase -n 3 -d", data, ends=0)
    run("experiment export staircase", table, "-d", data, ends=0)
    found = run.json("analyse thresholds", table, "--of", button)
    lines = found["people_toml"]
    rig = tmp_path / "lab.toml"
    rig.write_text(f'base = "simulated"\nname = "simulated"\n{lines}', encoding="utf-8")
    felt = run.json("button check", button, "-o", tmp_path / "check.h5", "--rig", rig)["feeling"]
    # The model's participants tell 0.167 of the drive from nothing: the whole of it is 15.6 dB above.
    assert felt["acts"]["pressing"]["above_threshold_db"] == pytest.approx(15.6, abs=3)
    assert felt["felt"] == "yes" and "3 simulated participants of this lab" in felt["notes"][0]
    run("analyse thresholds", table, "--of", button, "--only", "participant", "P01", says="at least 3 people")


def test_without_psignifit_the_extra_is_named(run, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "psignifit", None)
    path = written(tmp_path, "comparison,correct\n0.1,true\n")
    run("analyse thresholds", path, says='pip install "haploop[psychometrics]"')
