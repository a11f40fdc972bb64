"""Slow force-travel curves, as key-switch testers write them; the truth of each is known in closed form."""

import hashlib
import json

import numpy as np
import pytest

import haploop
from haploop.base import hdf5
from tests.mutating import mutations

G = 9.80665e-3
"""N for a gram-force."""


def force_at(x: np.ndarray, tactile: bool) -> np.ndarray:
    """gf on the way down: a spring of 45 to 65 gf over 4 mm, a bump of 20 gf at 1.2 mm, a stop at 3.8 mm."""
    spring = np.clip(x / 0.05, 0, 1) * (45 + 5 * x)
    bump = 20 * np.exp(-(((x - 1.2) / 0.3) ** 2)) if tactile else 0.0
    return np.asarray(spring + bump + 2000 * np.clip(x - 3.8, 0, None))


def rows(tactile: bool = True, up: bool = True, noise: float = 0.15, seed: int = 1) -> np.ndarray:
    """(rows, 4): travel in mm, force in gf, contact, ms."""
    down = np.linspace(0, 3.9, 400)
    x = np.concatenate([down, down[::-1][1:]]) if up else down
    lost = np.where(np.arange(len(x)) < 400, 0.0, 6.0) * np.clip(x / 0.05, 0, 1) * (x < 3.75)
    force = force_at(x, tactile) - lost + np.random.default_rng(seed).normal(0, noise, len(x))
    closed = np.where(np.arange(len(x)) < 400, x > 2.0, x > 1.8)
    return np.stack([x, force, closed, 33.3 * np.arange(len(x))], axis=1)


def millis(table: np.ndarray) -> str:
    return "Millis,Travel (mm),Force (gf)\n" + "".join(f"{t:.0f},{x:.4f},{f:.3f}\n" for x, f, _, t in table)


def without_time(table: np.ndarray) -> str:
    return "Displacement [mm];Force [N]\n" + "".join(f"{x:.4f};{G * f:.6f}\n" for x, f, _, _ in table)


def with_contact(table: np.ndarray) -> str:
    head = "Travel (mm),Force (gf),switch\n"
    return head + "".join(f"{x:.4f},{f:.3f},{c:.0f}\n" for x, f, c, _ in table)


def of_tester(table: np.ndarray) -> str:
    """As a common tester writes it: a column of units beside each value, both strokes, a clock in whole s."""
    head = "Maximum,191.1,@,No.1002,,,,,,\nMinimum,-0.2,@,No.3,,,,,,\nAverage,47.80,,,,,,,,\n"
    head += "Data Quantity,799,,,,,,,,\nNumber of NG,0,,,,,,,,\n"
    head += "No.,Force,Unit,Displacement,Unit,Judge,Position,Time,Date,\n"
    return head + "".join(
        f"{n},{f:.1f},gf,{x:.3f},mm,OK,--,8:16:{t // 1000:02.0f} PM,4/6/2026,\n"
        for n, (x, f, _, t) in enumerate(table, 1)
    )


def of_logger(table: np.ndarray) -> str:
    """As the same tester's logger writes it: no headings, and a row of units."""
    head = "MAX FORCE = 191.5,3.880\nUNIT = gf,mm\nDATA COUNT = 799,\nRECORDING RATE = 0.0005,\n"
    return head + "2ND PEAK FORCE = ---,---\n" + "".join(f"{f:.1f},{x:.3f}\n" for x, f, _, _ in table)


@pytest.mark.parametrize("write", [millis, without_time, with_contact, of_tester, of_logger])
@pytest.mark.parametrize("tactile", [True, False], ids=["tactile", "linear"])
@pytest.mark.parametrize("up", [True, False], ids=["both ways", "down"])
def test_a_curve_is_shown_as_what_it_is(write, tactile, up, run, tmp_path):
    """What a file does not show is absent: no bump, no contact, no way up."""
    path = tmp_path / "switch.csv"
    path.write_text(write(rows(tactile, up)), encoding="utf-8")
    args = ["import", path, "--as", "curve"]
    said = run.json(*args)
    shown = run(*args, "--plot", tmp_path / "curve.png")
    assert shown.exit_code == 0 and (tmp_path / "curve.png").is_file(), shown.stderr
    assert ("Tactile peak" in shown.stdout) is tactile
    fine = np.linspace(0.5, 3.5, 30_001)
    truth = force_at(fine, tactile)
    if tactile:
        peak = int(np.argmax(truth[fine < 2]))
        trough = peak + int(np.argmin(truth[peak:]))
        assert said["peak_travel_m"] == pytest.approx(1e-3 * fine[peak], abs=4e-5)
        assert said["peak_force_n"] == pytest.approx(G * truth[peak], rel=0.01)
        assert said["trough_force_n"] == pytest.approx(G * truth[trough], rel=0.01)
        assert said["snap_ratio"] == pytest.approx(1 - truth[trough] / truth[peak], abs=0.015)
    assert said["bottom_travel_m"] == pytest.approx(3.8e-3, abs=8e-5)
    assert said["end_travel_m"] == pytest.approx(3.9e-3, abs=1e-6)
    assert ("Work lost" in shown.stdout) is up
    if up:
        assert said["lost_j"] == pytest.approx(6 * G * 3.75e-3, rel=0.05)
    assert ("Operating point" in shown.stdout) is (write is with_contact)
    if write is with_contact:
        assert said["operates_travel_m"] == pytest.approx(2e-3, abs=2e-5)
        if up:
            assert said["hysteresis_m"] == pytest.approx(0.2e-3, abs=3e-5)


@pytest.mark.parametrize("seed", range(20))
def test_noise_makes_no_tactile_peak(seed, run, tmp_path):
    path = tmp_path / "switch.csv"
    path.write_text(millis(rows(tactile=False, noise=0.6, seed=seed)), encoding="utf-8")
    said = run.json("import", path, "--as", "curve")
    assert "peak_travel_m" not in said and said["snap_ratio"] is None


@pytest.mark.parametrize(
    ("cell", "said"), [("", "is missing, at most 1 in a row"), ("9e4", "(in row 101) stands alone")]
)
def test_rows_of_a_curve_have_no_time(cell, said, run, tmp_path):
    path = tmp_path / "switch.csv"
    lines = without_time(rows()).splitlines()
    lines[101] = lines[101].partition(";")[0] + f";{cell}"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert said in " ".join(run.json("import", path, "--as", "curve")["notes"])


def test_what_is_no_curve_is_one_sentence(run, tmp_path):
    path = tmp_path / "switch.csv"
    path.write_text(millis(rows()), encoding="utf-8")
    run("import", path, says="--as curve")
    path.write_text(without_time(np.concatenate([rows()] * 3)), encoding="utf-8")
    run("import", path, "--as", "curve", says="goes down 3 times, and a curve is one press")
    path.write_text("Force (N)\n" + "1\n2\n3\n1\n" * 20, encoding="utf-8")
    run("import", path, "--as", "curve", says="--displacement COLUMN")


@pytest.mark.parametrize("write", [of_tester, with_contact])
def test_a_kept_curve_is_read_like_any_other_file(write, run, tmp_path):
    folder = tmp_path / "kept"
    for seed, name in enumerate(("blue", "brown")):
        (tmp_path / f"{name}.csv").write_text(write(rows(seed=seed)), encoding="utf-8")
    run("import", tmp_path / "blue.csv", tmp_path / "brown.csv", "--as", "curve", "-o", folder, ends=0)
    blue = folder / "blue.h5"
    shown, said = run("show", blue), run.json("show", blue)
    before = run.json("import", tmp_path / "blue.csv", "--as", "curve")
    assert said == before and "Tactile peak" in shown.stdout
    assert said["source_sha256"] == hashlib.sha256((tmp_path / "blue.csv").read_bytes()).hexdigest()
    assert said["units"] == {"force": "gf", "displacement": "mm"}
    run("verify", folder, ends=0)
    listed = run.json("list kind=curve --in", folder)["files"]
    assert [one["button"] for one in listed] == ["blue", "brown"]
    # Several curves of a report are laid over each other.
    report = run("report", folder, "-o", tmp_path / "report.html", "--no-open", "--json")
    assert sum(name.endswith(".svg") for name in json.loads(report.stdout)["figures"]) == 1, report.output
    curve = haploop.load(blue)
    for key, value in (("turn", 10**6), ("travel", np.zeros(3)), ("force", np.full(799, np.nan))):
        path = tmp_path / f"{key}.h5"
        hdf5.write(path, "curve", {**hdf5.flatten(curve), key: value})
        run("show", path, ends=2)
    for number, changed in enumerate(mutations(blue.read_bytes(), 8, seed=3)):
        path = tmp_path / f"changed-{number}.h5"
        path.write_bytes(changed)
        assert run("verify", path).exit_code in (1, 2)


def test_an_exported_curve_is_read_back(run, tmp_path):
    (tmp_path / "blue.csv").write_text(of_tester(rows(seed=0)), encoding="utf-8")
    said = run.json("import", tmp_path / "blue.csv", "--as", "curve", "-o", tmp_path / "blue.h5")
    again = tmp_path / "again.csv"
    run("export", tmp_path / "blue.h5", "--to", "csv", "-o", again, ends=0)
    back = run.json("import", again, "--as", "curve", "--button", "blue")
    numbers = {key: value for key, value in said.items() if isinstance(value, float)}
    assert len(numbers) >= 10 and {key: back[key] for key in numbers} == pytest.approx(numbers)
