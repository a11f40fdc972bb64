"""Tuned on the tables of seeds 0, 3 and 5; the others here were not looked at while tuning."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibration import Calibration, Drive, Learning, calibrate, check, drive_for, learn
from calibration.drive import Method
from calibration.learning import _without_noise
from instruments import ConfigurationError, Rig
from tests.calibration.conftest import Calibrated, make_press, tamper
from tests.conftest import OpenRig

QUIET = 0.25
"""Of the vibrometer's noise: four plays then have a floor of about 1 %."""
WORLDS: tuple[dict[str, Any], ...] = (
    {},
    {"mode_drift": 0.03},
    {"hysteresis": 0.2},
    {"vibrometer_noise_scale": 12.0},
)
"""What the table is like after it was calibrated: as it was, drifted, with more hysteresis than was
measured, and with a floor above what is asked for. All of them play at the voltage limit."""


def true_error(open: OpenRig, drive: Drive, world: dict[str, Any]) -> float:
    """What a vibrometer without noise sees of a drive."""
    return check(open(**{**world, "vibrometer_noise_scale": 0.0}), drive, plays=2).nrmse


@pytest.mark.requires("simulation")
@pytest.mark.parametrize(
    ("method", "one_shot", "learnt"), [("modulated", 0.10, 0.04), ("broadband", 0.07, 0.02)]
)
def test_five_iterations_bring_a_fresh_drive_near_the_floor(
    calibrated: Calibrated, open: OpenRig, method: Method, one_shot: float, learnt: float, full: bool
) -> None:
    for seed in (101, 102, 103) if full else (0,):
        world = {"seed": seed, "vibrometer_noise_scale": QUIET}
        rig = open(**world)
        calibration = calibrate(rig) if full else calibrated.calibration
        drive = drive_for(make_press(), calibration, rig.limits, method=method)
        learning = learn(rig, drive, calibration, iterations=5 if full else 3, plays=4)
        first, best = learning.iterations[0], learning.iterations[learning.best]
        print(f"seed {seed} {method}: {first.nrmse:.4f} -> {best.nrmse:.4f}, floor {best.floor:.4f}")
        assert first.nrmse <= one_shot
        assert best.floor < 0.012
        assert best.nrmse <= learnt
        assert learning.best_again == pytest.approx(best.nrmse, abs=0.004)


@pytest.mark.requires("simulation")
def test_learning_is_never_worse_than_its_first_play(
    calibrated: Calibrated, open: OpenRig, full: bool
) -> None:
    for number in range(50) if full else (1, 3):
        world = dict(WORLDS[number % len(WORLDS)])
        method: Method = "broadband" if number % 8 >= 4 else "modulated"
        calibration = calibrated.calibration
        if full:
            world["seed"] = 200 + number
            calibration = calibrate(open(seed=world["seed"]))
        rig = open(**world)
        drive = drive_for(make_press(), calibration, rig.limits, method=method)
        learning = learn(rig, drive, calibration, iterations=5 if full else 2, plays=8 if full else 3)
        before, after = true_error(open, drive, world), true_error(open, learning.drive, world)
        print(f"{world} {method}: {before:.4f} -> {after:.4f}; {learning.stopped}")
        # The patch remembers a little of what was played before: that is no error of the drive's.
        assert after <= before + 2e-3
        if "mode_drift" in world:
            assert after < 0.7 * before


@pytest.mark.requires("simulation")
def test_a_noisy_vibrometer_does_not_write_its_noise_into_the_drive(
    calibrated: Calibrated, open: OpenRig, full: bool
) -> None:
    for seed in (111, 112) if full else (0,):
        rig = open(seed=seed, vibrometer_noise_scale=8.0)
        calibration = calibrate(rig) if full else calibrated.calibration
        drive = drive_for(make_press(), calibration, rig.limits)
        learning = learn(rig, drive, calibration, iterations=5 if full else 2, plays=8 if full else 4)
        best = learning.iterations[learning.best]
        print(f"seed {seed}: {best.nrmse:.4f}, floor {best.floor:.4f}: {learning.stopped}")
        assert best.nrmse <= 1.6 * best.floor


def test_every_iteration_is_kept_on_disk(calibrated: Calibrated, tmp_path: Path) -> None:
    learning = short(calibrated)
    learning.save(tmp_path / "learning.h5")
    back = Learning.load(tmp_path / "learning.h5")
    assert len(back.iterations) == len(learning.iterations) >= 1
    for mine, theirs in zip(learning.iterations, back.iterations, strict=True):
        assert np.array_equal(mine.volts, theirs.volts) and np.array_equal(mine.measured, theirs.measured)
        assert (mine.kept, mine.why, mine.nrmse) == (theirs.kept, theirs.why, theirs.nrmse)
    assert back.stopped == learning.stopped
    assert np.array_equal(back.drive.volts, learning.iterations[learning.best].volts)


def test_no_iterations_is_one_measurement(calibrated: Calibrated) -> None:
    drive = drive_for(make_press(), calibrated.calibration, calibrated.rig.limits)
    learning = learn(calibrated.rig, drive, calibrated.calibration, iterations=0, plays=3)
    assert len(learning.iterations) == 1 and learning.drive is drive


def test_a_clipped_measurement_teaches_nothing(
    calibrated: Calibrated, monkeypatch: pytest.MonkeyPatch
) -> None:
    tamper(calibrated.rig, monkeypatch, laser=lambda v: 1000 * v)
    learning = short(calibrated)
    assert len(learning.iterations) == 1 and "left its range" in learning.stopped


def test_a_blocked_laser_teaches_nothing(calibrated: Calibrated, monkeypatch: pytest.MonkeyPatch) -> None:
    noise = np.random.default_rng(4)
    tamper(calibrated.rig, monkeypatch, laser=lambda v: 1e-3 * noise.standard_normal(len(v)))
    learning = short(calibrated)
    assert learning.best == 0


def test_what_does_not_belong_together_is_refused(calibrated: Calibrated) -> None:
    drive = drive_for(make_press(), calibrated.calibration, calibrated.rig.limits)
    rig, calibration = calibrated.rig, calibrated.calibration
    with pytest.raises(ConfigurationError, match="another calibration"):
        learn(rig, replace(drive, calibration="0" * 64), calibration)
    with pytest.raises(ConfigurationError, match="3 plays"):
        learn(rig, drive, calibration, plays=2)
    with pytest.raises(ConfigurationError, match="rig 'haptable'"):
        learn(rig, replace(drive, rig="haptable"), calibration)


def test_the_error_without_noise_is_neither_above_nor_below_the_truth() -> None:
    rng = np.random.default_rng(1)
    truth = 0.05 * np.sin(np.arange(2000) / 7)
    found = [_without_noise(truth + 0.2 * rng.standard_normal((6, 2000))) for _ in range(200)]
    squared, deviation = np.array(found).T
    assert np.mean(squared) == pytest.approx(np.mean(truth**2), rel=0.05)
    assert np.mean(deviation) == pytest.approx(np.std(squared), rel=0.2)


def short(calibrated: Calibrated) -> Learning:
    rig: Rig = calibrated.rig
    calibration: Calibration = calibrated.calibration
    drive = drive_for(make_press(), calibration, rig.limits)
    return learn(rig, drive, calibration, iterations=1, plays=3)
