import numpy as np
import pytest

from haploop.calibration import VibrationMap, read_uff


@pytest.mark.long
def test_a_small_map_is_measured_shown_and_drawn(run, tmp_path, rigs):
    if rigs.mode != "twin":
        pytest.skip("the command opens a rig of its own")
    out = tmp_path / "map"
    values = run.json("map --out", out, "--points", "3,17", "--patches", "A")
    assert values["simulated"] is True and values["points_measured"] == 2
    assert values["best"]["patch"] == "A"
    assert run.json("map --out", out, "--points", "3,17", "--patches", "A") == values
    shown = run("show", out, "--plot", tmp_path / "map.png")
    assert shown.exit_code == 0 and "one patch at a time" in shown.stdout and "Simulated" in shown.stdout
    assert (tmp_path / "map.png").stat().st_size > 10_000
    (entry,) = run.json("list kind=map --in", tmp_path)["files"]
    assert (entry["file"], entry["patch"], entry["simulated"]) == (str(out), "A", "yes")
    run("export", out, "--to", "csv", "--out", tmp_path / "map.csv", ends=0)
    rows = np.genfromtxt(tmp_path / "map.csv", delimiter=",", skip_header=1)
    found = VibrationMap.load(out).velocity("A", rows[:, 0])
    np.testing.assert_allclose(rows[:, 1::2] + 1j * rows[:, 2::2], found.T, rtol=1e-6)
    universal = tmp_path / "map.uff"
    run("export", out, "--to", "uff", "--out", universal, ends=0)
    assert [(r.point, r.patch) for r in read_uff(universal)] == [("3", "A"), ("17", "A")]
    run("map --out", out, "--points", "3,18", "--patches", "A", says="points")
