"""`calibrate-finger` and `check --finger`."""

import json

import pytest

pytestmark = pytest.mark.long


def test_a_table_is_calibrated_and_a_press_checked_under_a_finger(demo, run, tmp_path):
    table, press = demo.folder / "calibration.h5", demo.folder / "presses" / "push.h5"
    out = tmp_path / "P01.h5"
    made = run("calibrate-finger -p P01 --force 2", table, "-o", out, "--json")
    values = json.loads(made.stdout)
    assert made.exit_code == 0
    assert values["finger"] == "P01" and values["finger_force"] == 2.0
    assert 0.03 < values["finger_changed"] < 0.3
    assert "P01, 2 N" in run("show", out).output

    run("check", press, "-c", out, "-o", tmp_path / "no", says="check with --finger P01")
    checked = run("check", press, "-c", out, "--finger", "P01", "-o", tmp_path / "checked", "--json")
    notes = json.loads(checked.stdout)["notes"]
    assert checked.exit_code in (0, 1, 4)
    assert notes[0] == "Measured under P01's fingertip, which was asked to rest with 2 N."
    run("calibrate-finger -p P01", out, "-o", tmp_path / "twice.h5", says="a finger's already")


def test_options_of_a_finger_need_one(demo, run, tmp_path):
    table, out = demo.folder / "calibration.h5", tmp_path / "x.h5"
    for asked in (("calibrate-finger", table, "-o", out), ("calibrate-finger", "-p", "P01", "-o", out),
        ("calibrate-finger", table, "-p", "P01", "--force", 0, "-o", out),
        ("check", demo.folder / "presses" / "push.h5", "-c", table, "--force", 1)):  # fmt: skip
        result = run(*asked)
        assert result.exit_code == 2 and not out.exists(), result.stderr
        assert any(name in result.stderr for name in ("--participant", "BARE.h5", "--force"))


def test_what_is_odd_about_a_finger_is_one_sentence(demo, made, run, tmp_path):
    table, button, out = demo.folder / "calibration.h5", made / "latch.h5", tmp_path / "x.h5"
    asked = ("calibrate-finger", table, "-p", "P01", "-o", out)
    for more, told in ((("--map", tmp_path), "holds no map"), (("--beside", "999"), "999"),
        (("--beside", "20"), "is the one under the finger"),
        (("--force", "nan"), "a number from 0.1 to 20 (found 'nan')")):  # fmt: skip
        result = run(*asked, *more)
        assert result.exit_code == 2 and told in result.stderr and not out.exists(), result.stderr
    for command, told in (
        (("button", "check", button, "--finger", "P01"), "was made for the bare table"),
        (("button", "check", button, "--force", 1), "--force belongs to --finger"),
        (("button", "under", button, "-c", table, "-o", out), "under one person's finger"),
        (("button", "under", table, "-c", table, "-o", out), "is not a haploop button"),
    ):
        run(*command, says=told)
        assert not out.exists()
