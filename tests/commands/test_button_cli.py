import json
from pathlib import Path

import pytest

import haploop
from haploop.reports.contents import file_contents
from haploop.reports.show import print_made
from tests.command_line import Demo


@pytest.fixture(scope="module")
def made(demo: Demo, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("made") / "latch.h5"


@pytest.mark.long
def test_a_button_is_made_shown_and_verified(demo, made, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    recording = next((demo.folder / "recordings").glob("*latch*.h5"))
    table = demo.folder / "calibration.h5"
    result = run("button make", recording, "-c", table, "-o", made, "--iterations", 0, "--json")
    values = json.loads(result.stdout)
    assert result.exit_code == (0 if values["passed"] else 1)
    assert values["kind"] == "button" and values["simulated"] and values["button"] == "latch"
    assert values["sources"][0]["file"] == recording.name
    assert len(values["iterations"]) == 1 and values["unreached"]

    shown = run("show", made, "--plot", tmp_path / "latch.png")
    assert shown.exit_code == 0 and (tmp_path / "latch.png").stat().st_size > 10_000
    assert "Digital latch button, pass" in shown.output and "Simulated" in shown.output
    again = run("button check", made, "--json")
    values = json.loads(again.stdout)
    assert again.exit_code == 0 and values["passed"]
    kept = haploop.calibration.Check.load(tmp_path / values["file"])
    assert len(kept.accelerations) == 8 and kept.error == values["whole"]["error"]
    run("button check", made, "--plays", 2, ends=2)
    assert "exists" in run("button check", made, "-o", values["file"]).output

    taken = run("button make", recording, "-c", table, "-o", made)
    assert taken.exit_code == 2 and "exists" in taken.output


def test_points_that_cannot_be_are_refused_before_anything_is_played(demo, run, tmp_path):
    recording = next((demo.folder / "recordings").glob("*latch*.h5"))
    asked = ("button", "make", recording, "-c", demo.folder / "calibration.h5", "-o", tmp_path / "no.h5")
    for more, told in (
        (("--quiet-at", "57"), "2 points cannot be moved or kept silent at once by 1 patches"),
        (("--quiet-at", "57", "--also", "57", recording), "Point 57 cannot be silent and play a press"),
        (("--times", "57", "0.5"), "A size is given for point 57, and no press to play there"),
        (("--also", "57", tmp_path / "none.h5"), "none.h5"),
        (("--quiet-at", "57", "--map", tmp_path), "holds no map"),
    ):
        result = run(*asked, *more)
        assert result.exit_code in (2, 3) and told in " ".join(result.output.split())
        assert "Play" not in result.output and not (tmp_path / "no.h5").exists()
        planned = run("button plan", *asked[2:5], *more)
        assert planned.exit_code in (2, 3) and told in " ".join(planned.output.split())


@pytest.mark.long
def test_a_press_is_represented_by_the_method_that_is_asked_for(demo, run, tmp_path):
    recordings = sorted((demo.folder / "recordings").glob("*latch*.h5"))
    result = run("represent", *recordings, "-o", tmp_path / "both.h5", ends=0)
    assert "its error on held-out presses is smaller" in " ".join(result.output.split())
    values = run.json("show", tmp_path / "both.h5")
    assert set(values["scores"]) == {"two-level registration", "two-level barycentre, centred in time"}
    assert values["method"] == min(values["scores"], key=values["scores"].get)
    values = run.json("represent", *recordings, "-o", tmp_path / "paper.h5", "--average", "barycentre")
    assert (values["method"], values["scores"]) == ("two-level barycentre", {})
    assert "exists" in run("represent", *recordings, "-o", tmp_path / "paper.h5").output


@pytest.mark.long
def test_button_and_check_ask_for_the_paper_s_press_too(demo, run, tmp_path):
    recording = next((demo.folder / "recordings").glob("*latch*.h5"))
    table = demo.folder / "calibration.h5"
    result = run("check", recording, "-c", table, "-o", tmp_path, "--average", "barycentre")
    assert result.exit_code in (0, 1, 4)
    values = run.json("show", tmp_path / "latch-press.h5")
    assert values["method"] == "two-level barycentre"
    made = tmp_path / "mean.h5"
    run("button make", recording, "-c", table, "-o", made, "--iterations", 0, "--average", "mean")
    assert haploop.DigitalButton.load(made).press.method == "two-level mean"


def test_what_was_made_is_a_screen_and_show_has_the_rest(demo, capsys):
    file = demo.folder / "checks" / "latch.h5"
    whole = file_contents(file)
    brief = whole.brief()
    assert brief.values == whole.values
    assert len(brief.rows) < 0.6 * len(whole.rows)
    print_made(whole, file, as_json=False)
    said = capsys.readouterr().out
    assert "Error up to 5000 Hz" in said and "Can be felt" in said and "Third octaves" not in said
    assert said.splitlines()[-1] == f"More of it: haploop show {file}"


@pytest.mark.long
def test_a_plan_is_shown_and_its_choice_is_made(demo, run, tmp_path):
    press, table = demo.folder / "presses" / "push.h5", demo.folder / "calibration.h5"
    planned = run("button plan", press, "-c", table, "-o", tmp_path / "plan.h5", "--json")
    offers = json.loads(planned.stdout)["offers"]
    assert planned.exit_code == 0 and {one["method"] for one in offers} == {"modulated", "broadband"}
    assert "Plan of the push button" in run("show", tmp_path / "plan.h5").output
    made = run(
        "button make", press, "-c", table, "-o", tmp_path / "loud.h5", "--iterations", 0, "--error", "12%",
        "--json",
    )  # fmt: skip
    loud, quiet = (json.loads(made.stdout), run.json("show", demo.folder / "checks" / "push.h5"))
    assert made.exit_code == 0 and 0.09 < loud["predicted_error"] <= 0.12
    levels = [one["feeling"]["acts"]["pressing"]["above_threshold_db"] for one in (loud, quiet)]
    assert levels[0] > levels[1] + 3
