"""Nights with nobody there, by the command line, on tables that nothing in this repository was tuned to."""

import re
from pathlib import Path
from typing import Any

import pytest

from haploop.acquisition import Representative
from haploop.calibration import calibrate
from haploop.calibration.drive.button import build_button
from haploop.calibration.recalibration.history import History
from haploop.instruments import load_rig_file, open_rig
from tests.command_line import Demo

BROKEN = {
    'kind = "patch-dead"': "patch is dead or its wires are off",
    'kind = "laser-blocked"': "laser does not see the surface",
    'kind = "sensor-disconnected"\nchannel = "acceleration_z"': "accelerometer is loose",
}


def rig_file(place: Path, seed: int, drift: float = 0.0, fault: str = "") -> Path:
    path = place / "table.toml"
    world = f"[simulation]\nseed = {seed}\nmode_drift = {drift}\n"
    path.write_text(world + (f"[[simulation.faults]]\n{fault}\n" if fault else ""), encoding="utf-8")
    return path


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("seed", range(160, 165))
def test_a_drift_is_brought_back_and_nothing_else_changes_anything(seed, full, run, tmp_path, request):
    if not full:
        pytest.skip("a table takes minutes: with --full only")
    demo: Demo = request.getfixturevalue("demo")
    folder = tmp_path / "calibrations"
    paths = []
    with open_rig(load_rig_file(rig_file(tmp_path, seed)), simulate="twin") as rig:
        calibration = calibrate(rig)
        for name in ("latch", "push", "toggle"):
            press = Representative.load(demo.folder / "presses" / f"{name}.h5")
            paths.append(tmp_path / f"{name}.h5")
            build_button(rig, press, calibration, iterations=3).save(paths[-1])
    run("calibrations adopt", *paths, "--reason", "it begins", "--calibrations", folder, ends=0)

    def night(expected, drift=0.0, fault=""):
        rig = rig_file(tmp_path, seed, drift, fault)
        said: dict[str, Any] = run.json("recalibrate --rig", rig, "--calibrations", folder, ends=expected)
        return said

    first = History(folder).active()
    assert night(0)["outcome"] == "unchanged"
    for drift in (0.001, -0.001):
        assert night(0, drift)["outcome"] == "unchanged"
    for fault, says in BROKEN.items():
        for drift in (0.0, 0.03):
            said = night(3, drift, fault)
            assert said["outcome"] == "broken" and says in " ".join(said["sentences"])
    assert History(folder).active() == first and len(History(folder).generations) == 1

    said = night(0, 0.03)
    assert said["outcome"] == "restored" and "changed by +3.0" in said["sentences"][0]
    assert set(said["buttons"]) == {"latch-A-button", "push-A-button", "toggle-A-button"}
    html = Path(said["report"]).read_text(encoding="utf-8")
    for name, checks in said["buttons"].items():
        before, after = checks["before"], checks["after"]
        wrong, right = before["within"], after["within"]
        print(f"{seed} {name} {wrong['error']:.4f} {right['error']:.4f} {right['floor']:.4f}")
        assert not before["passed"] and wrong["error"] > 0.5
        assert after["passed"] and after["whole"]["error"] <= after["tolerance"]
        shown = re.search(rf"{name}</th><td>([\d.]+) %</td><td>([\d.]+) %", html)
        assert [float(error) for error in shown.groups()] == pytest.approx(
            [100 * before["whole"]["error"], 100 * after["whole"]["error"]], abs=0.051
        )
    assert History(folder).active().parent == first.name
    assert night(0, 0.03)["outcome"] == "unchanged"
