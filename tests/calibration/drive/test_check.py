from dataclasses import replace
from itertools import cycle
from typing import Any

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.calibration import (
    Check,
    Multisine,
    calibrate,
    learn,
    measure_map,
    measure_response,
    quick_response,
)
from haploop.calibration.background import rests
from haploop.calibration.drive import check, playing
from haploop.calibration.spectra import third_octaves
from haploop.instruments import load_rig_file, open_rig
from tests.calibration.conftest import make_press, tamper
from tests.raising import raises
from tests.rig_files import changed


def test_a_fresh_drive_passes_by_what_was_expected(calibrated, drive):
    seen: list[tuple[object, ...]] = []
    result = check(calibrated.rig, drive, progress=lambda *told: seen.append(told))
    assert result.passed and result.reasons == ()
    # What comes on top of the expected is the hysteresis, which is known to some percent.
    assert drive.predicted_error / 2 < result.interval[1]
    assert result.within.root < 2 * drive.predicted_error < 0.22
    assert str(result).endswith(": pass")
    assert result.correlation > 0.99 and result.envelope_correlation > 0.99
    assert 0 < result.within.floor < 0.02 and result.tolerance == 0.20
    assert result.octaves.error_db < 2
    assert not result.overload and result.drift == 0
    assert result.drive_measured_peak == pytest.approx(drive.peak, rel=0.05)
    assert result.measured.shape == result.target.shape and result.plays == 8
    assert result.judged_hz == 5000  # the corner of the laser's filter
    assert result.simulated == calibrated.rig.simulated
    told = [name for name, *_ in seen]
    assert told == [f"Check the {drive.button} button"] * 8
    for value, (low, high) in (
        (result.error, result.interval),
        (result.within.root, result.within.interval),
        (result.outside.root, result.outside.interval),
    ):
        assert low <= value <= high


def test_all_figures_follow_from_the_plays(calibrated, drive, tmp_path):
    """With nothing but numpy and the file; docs/explanation/check.md shows the same script."""
    check(calibrated.rig, drive).save(tmp_path / "check.h5")
    stored = Check.load(tmp_path / "check.h5")
    plays, target = stored.accelerations, stored.target
    count, size = len(plays), np.sum(target**2)
    missed = plays - target
    products = missed @ missed.T / size
    squared = (products.sum() - np.trace(products)) / (count * (count - 1))
    floor = np.sqrt(np.var(plays, axis=0, ddof=1).sum() / count / size)
    assert stored.error == pytest.approx(np.sqrt(max(squared, 0)), abs=1e-9)
    assert stored.whole.floor == pytest.approx(floor, rel=1e-6)
    assert stored.passed == (stored.interval[1] <= stored.tolerance)
    # Powers add; a root does not show a power that noise makes negative.
    parts = stored.within.value + stored.outside.value
    assert parts == pytest.approx(stored.whole.value, abs=0.02**2 + stored.whole.deviation)


def test_third_octaves_are_levels():
    """A tone of 1 m/s^2 rms stands at 0 dB in its own band, and nowhere else."""
    t = np.arange(50000) / 50000
    centres, levels = third_octaves(np.sqrt(2) * np.sin(2 * np.pi * 260 * t), 50e3, 100, 600)
    assert centres == pytest.approx([100, 125.9, 158.5, 199.5, 251.2, 316.2, 398.1, 501.2], abs=0.1)
    assert levels[4] == pytest.approx(0, abs=1e-6)
    assert np.all(np.delete(levels, 4) < -60)


@pytest.mark.parametrize(("how", "says"), [
    (lambda v: 0 * v, "does not see the surface"),
    (lambda v: 1e-3 * np.random.default_rng(0).standard_normal(len(v)), "does not see the surface"),
    (lambda v: 0.7 * v, "differs from the target"),
    (lambda v: np.roll(v, 50), "differs from the target"),
    (lambda v: -v, "differs from the target by"),
    (lambda v: np.clip(v, -0.3 * np.abs(v).max(), 0.3 * np.abs(v).max()), "differs from the target"),
    (lambda v: 1000 * v, "range of 20 mm/s"),
    (lambda v: np.full(len(v), np.nan), "differs from the target"),
])  # fmt: skip
def test_what_did_not_follow_never_passes(checked, how, says):
    """A blocked laser, noise, 3 dB too little, 1 ms late, upside down, clipped, overloaded, NaN."""
    result = checked(laser=how)
    assert not result.passed
    assert says in " ".join(result.reasons)


def test_noise_that_hides_the_motion_is_no_verdict(checked):
    """The tolerance does not grow with the noise: neither pass nor fail, and it says what would show it."""
    noise = np.random.default_rng(0)
    result = checked(laser=lambda v: v + 0.3 * noise.standard_normal(len(v)))
    assert result.tolerance == 0.20 and result.whole.floor > 0.3
    assert result.verdict == "not shown" and not result.passed
    assert "More plays would not" in result.reasons[0]
    assert any("single tones there would not be seen" in note for note in result.notes)


def test_a_few_plays_are_told_how_many_would_show_it(open, drive, monkeypatch):
    """On a rig of its own: whether more plays would do hangs on the noise of the few."""
    rig, factors = open(), cycle((0.99, 0.81, 0.9))
    tamper(rig, monkeypatch, laser=lambda v: next(factors) * v)
    # As much as noise hides is bounded by so much that no number of plays would do.
    unbounded = replace(drive, above=np.zeros((2, 0)), hidden=(0.0, 0.0, 0.0))
    result = check(rig, unbounded, plays=3, most=3)
    assert result.verdict == "not shown"
    assert "plays would probably show it" in result.reasons[0]


@pytest.mark.long
def test_few_plays_are_not_told_that_more_are_of_no_use(calibrated, drive):
    """Three plays are judged to less than the corner of the laser's filter, eight to the corner."""
    above = np.where(drive.above[:1] < 5000, 0.61, 0.0)
    ringing = replace(drive, above=np.concatenate([drive.above[:1], above]))
    few = check(calibrated.rig, ringing, plays=3, most=3)
    assert few.judged_hz < 5000 and few.verdict == "not shown"
    assert "More plays would be judged to a higher frequency." in few.reasons[0]
    assert check(calibrated.rig, ringing, plays=8, most=8).judged_hz > few.judged_hz


@pytest.mark.long
@pytest.mark.parametrize(("hidden", "says"), [
    ((0.0, 0.3, 5040.0), ""),
    ((0.25, 0.0, 6350.0), "More plays would not: measure with a vibrometer"),
], ids=["hidden by noise", "shown"])  # fmt: skip
def test_what_the_calibration_left_open_above_the_laser_more_plays_tell(calibrated, drive, hidden, says):
    found = check(calibrated.rig, replace(drive, hidden=hidden), plays=4 if not says else 8)
    if not says:
        assert found.passed and found.plays > 4 and found.hidden < 0.2
        unseen = replace(found, above=replace(found.above, near=None))
        assert (unseen.hidden, unseen.allowed) == (0.3, 0.0) and found.allowed > found.interval[1]
        return
    assert found.verdict == "not shown" and found.plays < 64 and says in found.reasons[0]


@pytest.mark.long
def test_what_was_played_before_does_not_change_the_verdict(open, drive):
    """A patch remembers: right after an excitation a play was 42 to 60 % wrong."""
    rig = open()
    measure_response(rig, excitation=Multisine())
    first = check(rig, drive, plays=3)
    again = check(rig, drive, plays=3)
    assert first.verdict != "fail" and first.drift == 0
    assert first.within.root == pytest.approx(again.within.root, abs=0.015)


def test_a_patch_without_volts(calibrated, drive, monkeypatch):
    tamper(calibrated.rig, monkeypatch, drive=lambda v: 0 * v, laser=lambda v: 0 * v)
    raises(InstrumentError, "the relay", check, calibrated.rig, drive, plays=3)
    monkeypatch.setattr(playing, "settle", lambda *_: 0.0)  # the contact fails after settling
    result = check(calibrated.rig, drive, plays=3)
    assert not result.passed
    assert "relay" in " ".join(result.reasons)


def test_too_much_voltage_at_the_patch_fails(checked):
    assert "the rig's limit" in checked(drive=lambda v: 1.1 * v).reasons[0]


def test_yesterdays_drive_fails_on_a_table_that_drifted(open, drive):
    result = check(open(mode_drift=0.03), drive, plays=3)
    assert not result.passed
    assert result.within.root > 0.5


def test_a_check_needs_plays_and_its_own_sample_rate(calibrated, drive):
    another = replace(make_press(), sources=(("P02-push.h5", "1" * 64),))
    for says, drive_, press, plays in (
        ("3 plays", drive, None, 2),
        ("samples/s", replace(drive, rate_hz=1.0), None, 8),
        ("of the rig 'haptable', and this is 'simulated'", replace(drive, rig="haptable"), None, 8),
        ("another press", drive, another, 8),
    ):
        raises(ConfigurationError, says, check, calibrated.rig, drive_, press, plays=plays)


@pytest.mark.parametrize("play", [
    lambda rig, drive, *_: check(rig, drive),
    lambda rig, drive, calibration, _: learn(rig, drive, calibration),
    lambda rig, *_: calibrate(rig),
    lambda rig, *_: quick_response(rig, "A", "button"),
    lambda rig, _, __, folder: measure_map(rig, folder / "map"),
], ids=["check", "learn", "calibrate", "quick response", "map"])  # fmt: skip
def test_without_a_drive_monitor(calibrated, drive, tmp_path, play):
    """Nothing would show there that the amplifier's gain is five times what the rig file says."""
    faults = {"faults": ({"kind": "amplifier-gain", "gain": 250.0},)}
    file = changed(load_rig_file("simulated"), name=drive.rig, sensors={"drive": None}, simulation=faults)
    with open_rig(file, simulate="twin") as rig:
        with pytest.raises(ConfigurationError, match=r"no \[sensors.drive\]; a drive is always measured"):
            play(rig, drive, calibrated.calibration, tmp_path)
        assert rig.simulation.truth.peak == 0 and rig.lockout is None


def test_last_bits_are_nothing(calibrated, drive, monkeypatch):
    """What is drawn at random comes from names, not from computed volts, which no two machines share."""
    drawn: list[list[int]] = []

    def kept(*told: Any) -> list[int]:
        drawn.append(rests(*told))
        raise StopIteration

    monkeypatch.setattr(playing, "rests", kept)
    monkeypatch.setattr(playing, "settle", lambda *_: None)
    for shift in (0.0, 1e-12):
        raises(StopIteration, "", playing.play, calibrated.rig, replace(drive, volts=drive.volts + shift), 4)
    assert drawn[0] == drawn[1]
