"""Drives of several patches at once, on a rig whose amplifier has a channel for each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from haploop.calibration import (
    Calibration,
    DigitalButton,
    Drift,
    Loudness,
    Multisine,
    Trade,
    build_button,
    calibrate,
    calibration_of,
    drift_change,
    drive_for,
    load_calibrations,
    plan_button,
    trade_for,
)
from haploop.calibration.drive import check
from haploop.calibration.drive.actuation import Actuation
from haploop.instruments import ConfigurationError, DataError, Rig, open_rig
from haploop.mocks.plant.hysteresis import Hysteresis
from haploop.mocks.plant.table import TouchTable
from tests.calibration.conftest import Calibrated, make_press

WIDTHS = {"A": 0.12, "B": 0.09, "C": 0.15, "D": 0.11}
SEED = 3


class Unlike(TouchTable):
    """A table whose patches differ in their hysteresis."""

    def law(self, patch: str, file: object) -> Hysteresis:
        return Hysteresis(WIDTHS[patch])


def opened(**plant: float) -> Rig:
    return open_rig("four-channel", simulate="twin", simulation={"seed": SEED}, plant=Unlike(**plant))


@dataclass(frozen=True)
class Four:
    rig: Rig
    calibrations: tuple[Calibration, ...]


@pytest.fixture(scope="module")
def four() -> Iterator[Four]:
    with opened() as rig:
        yield Four(rig, tuple(calibrate(rig, patch) for patch in "ABCD"))


@pytest.fixture(scope="module")
def button(four: Four) -> DigitalButton:
    alone = drive_for(make_press(), four.calibrations[0], four.rig.limits)
    trade = Trade(scale=2 * alone.scale)
    return build_button(four.rig, make_press(), four.calibrations, trade=trade, iterations=1, plays=4)


def test_twice_as_loud_and_steady_where_one_patch_is_lost(four: Four, button: DigitalButton) -> None:
    """The table drifts by 1 %: with hysteresis that differs from patch to patch, noise and quantisation."""
    alone = drive_for(make_press(), four.calibrations[0], four.rig.limits)
    assert button.passed and button.check.error < 0.05
    assert button.drive.scale > 1.9 * alone.scale
    assert button.drive.patches == tuple("ABCD") and button.drive.volts.shape[0] == 4
    with opened(mode_drift=0.01) as rig:
        drifted, lost = check(rig, button.drive, plays=3), check(rig, alone, plays=3)
    assert drifted.error < 0.06 and drifted.passed
    assert lost.error > 0.2 and not lost.passed
    # It was said beforehand, and is about right for a drift of one standard deviation.
    assert 0.5 * drifted.error < button.drive.drifted_error < 0.1


def test_no_patch_gets_more_than_its_limits_and_every_one_is_measured(
    four: Four, button: DigitalButton
) -> None:
    limits, rig = four.rig.limits, four.rig
    for volts in button.drive.volts:
        limits.check(volts, button.drive.rate_hz)
    assert button.check.drive_measured_peak == pytest.approx(button.drive.peak, rel=0.03)
    # The largest volts of all patches are what is measured, whichever has them.
    weak = replace(button.drive, volts=button.drive.volts * np.array([[0.1], [0.1], [1.0], [0.1]]))
    measured = check(rig, weak, plays=3).drive_measured_peak
    assert measured == pytest.approx(np.abs(weak.volts[2]).max(), rel=0.08)
    assert rig.simulation is not None and rig.simulation.truth.closed == frozenset()


def test_a_button_of_several_patches_is_kept_whole(button: DigitalButton, tmp_path: Path) -> None:
    button.save(tmp_path / "button.h5")
    back = DigitalButton.load(tmp_path / "button.h5")
    assert back.digest == button.digest
    assert [one.response.patch for one in back.calibrations] == list("ABCD")
    assert np.array_equal(back.drive.volts, button.drive.volts) and back.drive.trade == button.drive.trade
    assert back.drive.calibration == Actuation.of(back.calibrations).digest


def test_one_patch_is_not_planned_against_a_drift(four: Four) -> None:
    alone = drive_for(make_press(), four.calibrations[0], four.rig.limits)
    assert alone.drift == Drift(0, 0, 0, 0, 0) and alone.expected_error == alone.predicted_error
    assert alone.drifted_error > 0.2
    assert 0.2 < drift_change(four.calibrations[:1], Drift()) < 1


def test_the_order_of_the_patches_is_that_of_the_calibrations(four: Four) -> None:
    turned = drive_for(make_press(), four.calibrations[1::-1], four.rig.limits)
    assert turned.patches == ("B", "A") and list(turned.by_patch) == ["B", "A"]


def test_what_cannot_be_is_said_before_anything_is_played(four: Four, button: DigitalButton) -> None:
    a, b, *_ = four.calibrations
    press, limits = make_press(), four.rig.limits
    with pytest.raises(ConfigurationError, match="2 calibrations of patch A at the button point were"):
        drive_for(press, [a, a], limits)
    elsewhere = replace(b, response=replace(b.response, point="31"))
    with pytest.raises(ConfigurationError, match="no calibration of patch A at the 31 point"):
        drive_for(press, [a, elsewhere], limits)
    with pytest.raises(ConfigurationError, match="are of 2 rigs"):
        drive_for(press, [a, replace(b, response=replace(b.response, rig="another"))], limits)
    with pytest.raises(ConfigurationError, match="for an error or for a scale"):
        Trade(error=0.1, scale=0.1)
    with pytest.raises(ConfigurationError, match="scale = -1"):
        Trade(scale=-1)
    with pytest.raises(DataError, match="a signal for each patch"):
        replace(button.drive, patches=("A", "B"))


@pytest.fixture(scope="module")
def beside(four: Four) -> tuple[Calibration, ...]:
    """Calibrations of all patches at another point."""
    return tuple(calibrate(four.rig, patch, "57", excitation=Multisine()) for patch in "ABCD")


def test_a_point_is_kept_silent_and_the_laser_visits_it(four: Four, beside: tuple[Calibration, ...]) -> None:
    rig, press = four.rig, make_press()
    alone = drive_for(press, four.calibrations[0], rig.limits)
    trade, every = Trade(scale=alone.scale), [*four.calibrations, *beside]
    loud = drive_for(press, four.calibrations, rig.limits, trade=trade)
    quiet = drive_for(press, every, rig.limits, trade=trade, quiet_at=["57"])
    assert quiet.quiet_at == ("57",) and loud.quiet_at == ()
    ((still, drifted),) = quiet.quiet_motion
    assert still < 0.1 and still < drifted < 0.25
    result = check(rig, quiet, plays=3)
    assert result.passed
    (silence,) = result.silent
    assert silence.point == "57" and silence.contrast_db > 20
    assert result.summary()["silent"] == {"57": silence.contrast_db}
    still_trade = replace(trade, drift=Drift(0, 0, 0, 0, 0))
    quietest = drive_for(press, every, rig.limits, trade=still_trade, quiet_at=["57"])
    assert quietest.quiet_motion[0][0] < 0.1 * still
    # Planned against no drift, it is quieter; and it moves when nobody asks for silence there.
    (moved,) = check(rig, replace(loud, quiet_at=("57",)), plays=3).silent
    assert moved.contrast_db < 15


def test_silence_that_cannot_be_is_refused_in_a_sentence(four: Four, beside: tuple[Calibration, ...]) -> None:
    press, limits, ours = make_press(), four.rig.limits, [four.calibrations[0], beside[0]]
    with pytest.raises(ConfigurationError, match=r"1 points cannot be silent.* 1 patches leave 0"):
        drive_for(press, ours, limits, quiet_at=["57"])
    with pytest.raises(ConfigurationError, match="One point is to move, and 2 of the calibrated"):
        drive_for(press, ours, limits)
    with pytest.raises(ConfigurationError, match="No patch was calibrated at the 58 point"):
        drive_for(press, four.calibrations, limits, quiet_at=["58"])


def test_one_amplifier_for_all_patches_is_told_before_anything_is_played(
    calibrated: Calibrated, button: DigitalButton
) -> None:
    rig = calibrated.rig
    drive = replace(button.drive, rig=rig.name, rate_hz=rig.table.rate_hz)
    with rig.captures() as captures, pytest.raises(ConfigurationError, match="no channel of its own"):
        check(rig, drive, plays=3)
    assert not captures


def test_calibrations_of_several_patches_are_found_by_one_name(four: Four, tmp_path: Path) -> None:
    path = tmp_path / "table.h5"
    for one in four.calibrations[:3]:
        one.save(calibration_of(path, one.response.patch))
    found = load_calibrations([path], ("C", "A"))
    assert [one.response.patch for one in found] == ["C", "A"]
    files = [calibration_of(path, patch) for patch in "AB"]
    assert [one.response.patch for one in load_calibrations(files)] == ["A", "B"]
    with pytest.raises(ConfigurationError, match="no calibration of patch C among those given"):
        load_calibrations(files, ("A", "C"))
    with pytest.raises(DataError, match="table-D"):
        load_calibrations([path], ("D",))
    (tmp_path / "table-A-waveforms.h5").touch()
    with pytest.raises(ConfigurationError, match=r"of patches A, B, C: .* \(--patches A,B,C\)"):
        load_calibrations([path])


def test_calibrations_that_do_not_belong_together_are_refused_in_a_sentence(four: Four) -> None:
    """Of another table, or of another day; their order does not matter."""
    a, b, c, d = four.calibrations
    press, limits = make_press(), four.rig.limits
    moved = replace(c, model=replace(c.model, poles=1.01 * c.model.poles))
    says = r"patch A at the button point \(.*\) and of patch C at .* differ by 1.0%: they are of two tables"
    with pytest.raises(ConfigurationError, match=says):
        drive_for(press, (a, b, moved, d), limits)
    with open_rig("four-channel", simulate="twin", simulation={"seed": SEED + 1}) as rig:
        stranger = calibrate(rig, "C")
    with pytest.raises(ConfigurationError, match=r"patch C .* differ by .* of two tables"):
        drive_for(press, (a, b, stranger, d), limits)
    straight, turned = (drive_for(press, four.calibrations[::step], limits) for step in (1, -1))
    assert turned.patches == tuple("DCBA") and turned.scale == pytest.approx(straight.scale, rel=0.02)
    assert turned.drifted_error == pytest.approx(straight.drifted_error, rel=0.05)


def test_a_plan_compares_one_patch_and_four_as_calibrated_and_after_a_drift(four: Four) -> None:
    plan = plan_button(make_press(), four.calibrations, four.rig, methods=("modulated",))
    alone, every = plan.curves
    assert (alone.patch, every.patch) == ("A", "A, B, C, D")
    # Each is what the check of that drive finds, on the table as it was calibrated and on one that drifted.
    for curve, some in ((alone, four.calibrations[:1]), (every, four.calibrations)):
        offer = curve.offers[1]
        drive = drive_for(make_press(), some, four.rig.limits, trade=Trade(scale=offer.scale))
        with opened(mode_drift=0.01) as rig:
            drifted = check(rig, drive, plays=3).error
        assert offer.error < 0.06 and 0.5 * drifted < offer.drifted < 2 * drifted
    assert alone.offers[1].drifted > 4 * every.offers[1].drifted
    assert every.offers[0].error < every.offers[0].drifted


def test_a_smaller_drift_that_is_planned_against_is_louder(four: Four) -> None:
    press, drives = make_press(), []
    for drift in (Drift(), Drift().times(0.1)):
        wanted = Loudness(error=0.08, drift=drift)
        trade = trade_for(press, four.calibrations, four.rig, wanted)
        assert trade.drift == drift
        drives.append(drive_for(press, four.calibrations, four.rig.limits, trade=trade))
    steady, loud = drives
    assert all(0.06 < drive.expected_error <= 0.08 for drive in drives)
    assert loud.scale > 1.2 * steady.scale
    assert (Drift().times(0.1).common, Drift().times(0.1).damping) == pytest.approx((0.001, 0.01))
