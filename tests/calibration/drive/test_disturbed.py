"""A check under noise that is correlated, beside the surface's own motion."""

from typing import Any

import numpy as np
import pytest

from benchmarks.disturbed import NOISE, PLANTS, Row, checked, table, true_error
from haploop.calibration import Calibration, calibrate, drive_for, learn
from haploop.calibration.drive import playing
from haploop.calibration.drive.agreement import dependence, shared_power
from haploop.calibration.drive.check import check
from tests.calibration.conftest import make_press

pytestmark = [pytest.mark.requires("simulation"), pytest.mark.many_plays]


def hum(volts: float, frequency: float) -> dict[str, Any]:
    return {"faults": [{"kind": "mains-hum", "channel": "laser", "volts": volts, "frequency": frequency}]}


@pytest.mark.long
@pytest.mark.parametrize(("volts", "frequency"), [(0.02, 50.0), (0.02, 60.0), (0.003, 49.9)])
def test_hum_changes_no_verdict(open, drive, volts, frequency):
    """With 20 mV, 50 Hz used to pass with error 0.0000 (0.0000 to 0.0000), and 60 Hz to fail with 59 %."""
    result, _, truth = true_error(open(**hum(volts, frequency)), drive, 8)
    low, high = result.interval
    assert low <= truth <= high < 0.2
    assert result.passed and result.error == pytest.approx(truth, abs=0.1)
    assert result.tones.share > 0.15 and abs(result.tones.hz - frequency).min() < 0.05
    assert any(f"steady tones at {frequency:.1f}," in note for note in result.notes)


@pytest.mark.long
def test_a_wrong_drive_fails_under_hum_as_without(open, drive):
    world = {"mode_drift": 0.01}
    quiet, _, truth = true_error(open(**world), drive, 8)
    assert quiet.verdict == "fail" and truth > 0.2
    for frequency in (50.0, 60.0):
        assert true_error(open(**world, **hum(0.02, frequency)), drive, 8)[0].verdict == "fail"


@pytest.fixture
def in_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plays at equal distances, and a background that is not looked at."""
    monkeypatch.setattr(playing, "rests", lambda plays, *_: [15_000] * plays)
    monkeypatch.setattr(playing, "tones_in", lambda *_: np.zeros(0))


@pytest.mark.usefixtures("in_step")
def test_plays_that_contradict_their_assumption_show_nothing(open, drive):
    result = check(open(**hum(0.02, 50.0)), drive)
    assert result.verdict == "not shown" and not result.passed
    assert "not shown" in str(result) and "in step with the plays" in result.reasons[0]
    said = result.summary()
    assert said["whole"]["error"] is None and said["whole"]["interval"] == [None, None]


@pytest.mark.usefixtures("in_step")
def test_plays_that_contradict_it_teach_nothing(calibrated, open, drive):
    learning = learn(open(**hum(0.02, 50.0)), drive, calibrated.calibration, iterations=2)
    assert learning.best == 0 and learning.drive is drive and len(learning.iterations) == 1
    assert "Nothing can be learnt" in learning.stopped


@pytest.mark.long
@pytest.mark.parametrize("scale", [0.8, 0.9])
def test_a_laser_askew_is_named_by_its_factor(open, drive, scale):
    """It failed tables that were right, and said nothing of the laser."""
    result = check(open(faults=[{"kind": "laser-askew", "scale": scale}]), drive)
    (told,) = [note for note in result.notes if note.startswith("The laser shows")]
    assert float(told.split()[3]) == pytest.approx(scale, abs=0.02)
    assert "its scale is wrong (its aim, range or settings), or the patch moves" in told


@pytest.mark.night
def test_learning_is_as_good_under_hum(calibrated, open, drive):
    """It used to say 0.000 for a drive that was 7 % off."""
    world = {"mode_drift": 0.002}
    _, before, _ = true_error(open(**world), drive, 3)
    quiet = learn(open(**world), drive, calibrated.calibration, iterations=1)
    learning = learn(open(**world, **hum(0.02, 50.0)), drive, calibrated.calibration, iterations=1)
    _, without, _ = true_error(open(**world), quiet.drive, 3)
    result, _, truth = true_error(open(**world), learning.drive, 3)
    assert truth < 0.8 * before and truth == pytest.approx(without, abs=0.01) and learning.best == 1
    assert learning.best_again == pytest.approx(result.within.root, abs=0.02)


@pytest.mark.long
@pytest.mark.parametrize("scale", [0.8, 1.2])
def test_an_askew_laser_is_no_use(calibrated, open, drive, scale):
    """Learning made the drive louder by the laser's factor, and its check passed: it was 20 % wrong."""
    rig = open(faults=[{"kind": "laser-askew", "scale": scale}])
    learning = learn(rig, drive, calibrated.calibration, iterations=2)
    assert learning.best == 0 and learning.drive is drive and len(learning.iterations) == 1
    assert float(learning.stopped.split()[3]) == pytest.approx(scale, abs=0.02)
    assert "Nothing is learnt, because a wrong scale would make the drive wrong" in learning.stopped


@pytest.mark.long
def test_noise_is_no_dead_patch(calibrated, open, drive):
    """It used to say that the patch is not connected, or that the laser does not see the surface."""
    rig = open(faults=[{"kind": "flicker-noise", "channel": "laser", "volts": 0.05}])
    learning = learn(rig, drive, calibrated.calibration, iterations=1)
    assert learning.drive is drive and learning.stopped.startswith("The plays' noise hides whether")
    rig = open(faults=[{"kind": "patch-dead"}])
    learning = learn(rig, drive, calibrated.calibration, iterations=1)
    assert learning.drive is drive and learning.stopped.startswith("The surface did not follow the drive")


def test_evidence_is_a_negative_power_or_an_interval_of_no_width():
    rng = np.random.default_rng(1)
    lines = np.arange(40)
    inside = (lines > 5) & (lines < 20)

    def plays(phases: np.ndarray, size: float) -> np.ndarray:
        quiet = rng.standard_normal((8, 40)) + 1j * rng.standard_normal((8, 40))
        spectra = 1e-3 * quiet + 0.05
        spectra[:, 10] += size * np.exp(1j * phases)
        return np.asarray(spectra)

    even = 2 * np.pi * np.arange(8) / 8
    assert dependence(plays(even, 3.0), inside)
    assert not shared_power(plays(even, 3.0)).possible
    assert np.isnan(shared_power(plays(even, 3.0)).root)
    assert not dependence(plays(even, 1e-3), inside)
    told = [bool(dependence(plays(rng.uniform(0, 2 * np.pi, 8), 3.0), inside)) for _ in range(500)]
    assert np.mean(told) < 0.05
    assert not any(dependence(plays(even, 0.0), inside) for _ in range(200))


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_no_verdict_is_wrong_under_any_disturbance(full):
    """20 plants that nobody chose: four kinds of noise, even orders, long ringing, drifts; three of each."""
    levels = {**NOISE, **{kind: PLANTS[kind] for kind in ("quiet", "even", "ringing")}}
    rows: list[Row] = []
    for number in range(20) if full else (4,):
        rows += checked(number, levels if full else {kind: levels[kind][1:2] for kind in levels})
    print("\n".join(table(rows)))
    shown = [row for row in rows if row.shown]
    assert not any(row.wrong for row in rows if row.verdict == "pass")
    assert sum(row.wrong for row in rows) <= 0.025 * len(rows)
    assert sum(row.holds for row in shown) >= 0.9 * len(shown) - (not full)
    assert all(row.said for row in rows if row.verdict in ("not shown", "refused"))
    assert len(shown) > len(rows) / 2


@pytest.mark.long
@pytest.mark.parametrize("seed", [7, 8, 9])
def test_a_table_that_rings_long_rests_before_it_is_played(open, full, seed):
    """A run-down left 1.3 times the target ringing, and the first play was 75 % off."""
    if seed != 7 and not full:
        pytest.skip("calibrates another table: runs with --full")
    rig = open(seed=seed, damping_scale=0.25)
    calibration: Calibration = calibrate(rig)
    result, _, truth = true_error(rig, drive_for(make_press(), calibration, rig.limits), 8)
    low, high = result.interval
    assert low <= truth <= high and high - low < 0.15
    assert result.drift == 0 and not any(note.startswith("Play ") for note in result.notes)
