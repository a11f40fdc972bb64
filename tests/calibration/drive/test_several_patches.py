"""Drives of several patches at once, on a rig whose amplifier has a channel for each."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from haploop.acquisition import Representative
from haploop.base.errors import ConfigurationError, DataError
from haploop.calibration import (
    Calibration,
    DigitalButton,
    Drift,
    Finger,
    Loudness,
    Multisine,
    TradeOff,
    build_button,
    calibrate,
    calibration_of,
    drift_change,
    drive_for,
    learn,
    load_calibrations,
    plan_button,
    trade_for,
)
from haploop.calibration.drive import check, loudness
from haploop.calibration.drive.actuation import Actuation
from haploop.calibration.perception import levels_of, pressing_act
from haploop.instruments import Rig, open_rig
from haploop.mocks.plant.hysteresis import Hysteresis
from haploop.mocks.plant.table import FEWEST_HZ, HIGHEST_HZ, TouchTable
from haploop.reports.contents.check import button_contents
from haploop.reports.contents.plan import plan_contents
from tests.calibration.conftest import make_press, tamper
from tests.calibration.drive.test_truth import played_and_true
from tests.raising import raises

pytestmark = pytest.mark.long

WIDTHS = {"A": 0.12, "B": 0.09, "C": 0.15, "D": 0.11}
SEED = 3
UNTOLD = np.zeros(0), np.zeros(0, complex), 1.0, 1.0
NOTHING: dict[str, Any] = {"changed": 0.1, "misfit": 0.0, "uncertainty": 0.0, "beside": ()}


class Unlike(TouchTable):
    """A table whose patches differ in their hysteresis."""

    def law(self, patch: str, file: object) -> Hysteresis:
        return Hysteresis(WIDTHS[patch])


def opened(noise: float = 1.0, highest_hz: float = FEWEST_HZ, **plant: float) -> Rig:
    """By default a table of 17 modes: what these drives do is within their band."""
    simulation = {"seed": SEED, "vibrometer_noise_scale": noise}
    table = Unlike(highest_hz=highest_hz, **plant)
    return open_rig("four-channel", simulate="twin", simulation=simulation, plant=table)


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
    trade = TradeOff(scale=2 * alone.scale)
    return build_button(four.rig, make_press(), four.calibrations, trade=trade, iterations=1, plays=4)


@pytest.mark.night
def test_twice_as_loud_and_steady_where_one_patch_is_lost(four, button):
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


def test_no_patch_gets_too_much_and_each_is_measured(four, button):
    limits, rig = four.rig.limits, four.rig
    for volts in button.drive.volts:
        limits.check(volts, button.drive.rate_hz)
    assert button.check.drive_measured_peak == pytest.approx(button.drive.peak, rel=0.03)
    # The largest volts of all patches are what is measured, whichever has them.
    weak = replace(button.drive, volts=button.drive.volts * np.array([[0.1], [0.1], [1.0], [0.1]]))
    measured = check(rig, weak, plays=3).drive_measured_peak
    assert measured == pytest.approx(np.abs(weak.volts[2]).max(), rel=0.08)
    assert rig.simulation is not None and rig.simulation.truth.closed == frozenset()


def test_a_button_of_several_patches_is_kept_whole(button, tmp_path):
    button.save(tmp_path / "button.h5")
    back = DigitalButton.load(tmp_path / "button.h5")
    assert back.digest == button.digest
    assert [one.response.patch for one in back.calibrations] == list("ABCD")
    assert np.array_equal(back.drive.volts, button.drive.volts) and back.drive.trade == button.drive.trade
    assert back.drive.calibration == Actuation.of(back.calibrations).digest


def test_one_patch_is_not_planned_against_a_drift(four):
    alone = drive_for(make_press(), four.calibrations[0], four.rig.limits)
    assert alone.drift == Drift(0, 0, 0, 0, 0) and alone.expected_error == alone.predicted_error
    assert alone.drifted_error > 0.2
    assert 0.2 < drift_change(four.calibrations[:1], Drift()) < 1


def test_the_order_of_the_patches_is_that_of_the_calibrations(four):
    turned = drive_for(make_press(), four.calibrations[1::-1], four.rig.limits)
    assert turned.patches == ("B", "A") and list(turned.by_patch) == ["B", "A"]


def test_what_cannot_be_is_said_before_anything_is_played(four, button):
    a, b, *_ = four.calibrations
    number = str(four.rig.table.button_point)
    elsewhere, foreign = (
        replace(b, response=replace(b.response, **new)) for new in ({"point": "31"}, {"rig": "x"})
    )
    touched = replace(b, finger=Finger("P07", 1.0, *UNTOLD, bare=b.model, **NOTHING))
    same = [replace(one, response=replace(one.response, point=number)) for one in four.calibrations]
    for says, given, points in (
        ("2 calibrations of patch A at the button point were", [a, a], {}),
        ("no calibration of patch A at the 31 point", [a, elsewhere], {}),
        ("are of 2 rigs", [a, foreign], {}),
        ("of the bare table and under P07's finger: give", [a, touched], {}),
        (f"Point {number} is the button point: one place", [*four.calibrations, *same], {number: None}),
    ):
        raises(ConfigurationError, says, drive_for, make_press(), given, four.rig.limits, elsewhere=points)
    for says, make in (
        ("for an error or for a scale", lambda: TradeOff(error=0.1, scale=0.1)),
        (r"A drift cannot be common = -0\.01", lambda: Drift().times(-1)),
        ("scale = -1", lambda: TradeOff(scale=-1)),
    ):
        raises(ConfigurationError, says, make)
    raises(DataError, "a signal for each patch", replace, button.drive, patches=("A", "B"))


@pytest.fixture(scope="module")
def beside(four: Four) -> tuple[Calibration, ...]:
    """Calibrations of all patches at another point."""
    return tuple(calibrate(four.rig, patch, "57", excitation=Multisine()) for patch in "ABCD")


def test_a_point_is_kept_silent_and_the_laser_visits_it(four, beside):
    rig, press = four.rig, make_press()
    alone = drive_for(press, four.calibrations[0], rig.limits)
    trade, every = TradeOff(scale=alone.scale), [*four.calibrations, *beside]
    loud = drive_for(press, four.calibrations, rig.limits, trade=trade)
    quiet = drive_for(press, every, rig.limits, trade=trade, elsewhere={"57": None})
    assert quiet.points == ("button", "57") and loud.points == ("button",)
    still, drifted = quiet.elsewhere[0].expected
    assert still < 0.1 and still < drifted < 0.25
    result = check(rig, quiet, plays=3)
    assert result.passed
    (silence,) = result.silent
    assert silence.point == "57" and silence.contrast_db > 20
    assert result.summary()["silent"] == {"57": silence.contrast_db}
    still_trade = replace(trade, drift=Drift(0, 0, 0, 0, 0))
    quietest = drive_for(press, every, rig.limits, trade=still_trade, elsewhere={"57": None})
    assert quietest.elsewhere[0].expected[0] < 0.7 * still
    # Planned against no drift, it is quieter; and it moves when nobody asks for silence there.
    spoilt = check(rig, replace(loud, elsewhere=quiet.elsewhere), plays=3)
    assert spoilt.silent[0].contrast_db < 15 and spoilt.error < 0.1
    assert spoilt.verdict == "fail" and "The 57 point, which is to be silent, moves" in spoilt.reasons[0]


def test_a_laser_that_sees_nothing_shows_no_silence(four, beside, monkeypatch):
    """Somebody stands in the beam while it is aimed at the silent point."""
    rig, every = four.rig, [*four.calibrations, *beside]
    alone = drive_for(make_press(), four.calibrations[0], rig.limits)
    trade = TradeOff(scale=alone.scale)
    quiet = drive_for(make_press(), every, rig.limits, trade=trade, elsewhere={"57": None})
    aimed, confirm = [], rig.operator.confirm

    def confirmed(request: Any) -> bool:
        aimed.append(getattr(request, "point", ""))
        return confirm(request)

    def blocked(volts: np.ndarray) -> np.ndarray:
        return np.random.default_rng(5).normal(0, 3e-4, len(volts)) if "57" in aimed else volts

    monkeypatch.setattr(rig.operator, "confirm", confirmed)
    tamper(rig, monkeypatch, laser=blocked)
    result = check(rig, quiet, plays=3)
    assert result.verdict == "fail" and result.error < 0.1
    (reason,) = result.reasons
    assert "Nothing is known of the 57 point" in reason and "coherence" in reason


def late(press: Representative, by: float = 0.02) -> Representative:
    """Another button's press: weaker, and `by` s later."""
    shifted = 0.6 * np.roll(press.acceleration, round(by * press.rate_hz))
    return replace(press, button="toggle", acceleration=shifted, sources=(("P01-toggle.h5", "1" * 64),))


def test_two_buttons_are_played_at_once(four, beside, tmp_path):
    press, wanted = make_press(), {"57": (late(make_press()), 0.9)}
    alone = drive_for(press, four.calibrations[0], four.rig.limits)
    trade = TradeOff(scale=alone.scale, drift=Drift(0, 0, 0, 0, 0))
    every = [*four.calibrations, *beside]
    made = build_button(four.rig, press, every, trade=trade, elsewhere=wanted, iterations=0, plays=12)
    (toggle,) = made.check.others
    assert made.passed and toggle.passed and toggle.drive.button == "toggle" and toggle.drive.point == "57"
    # Of the whole motion, up to 5 kHz, noise leaves more than that in so few plays.
    assert made.check.within.root < 0.08 and toggle.within.root < 0.12
    # Each with the carrier of its own point, and begun together.
    assert made.drive.carrier_hz == four.calibrations[0].carrier_hz != toggle.drive.carrier_hz
    ((point, level),) = toggle.crosstalk_db
    assert point == "button" and -50 < level < -15
    # What the laser saw is what the plant did, at both points.
    assert toggle.within.root < 2 * toggle.drive.predicted_error < 0.2
    assert np.linalg.norm(toggle.target) > 0.3 * np.linalg.norm(made.check.target)
    made.save(tmp_path / "both.h5")
    back = DigitalButton.load(tmp_path / "both.h5")
    assert back.digest == made.digest and list(back.elsewhere) == ["57"]
    kept, size = back.elsewhere["57"]
    assert kept.button == "toggle" and size == pytest.approx(0.9)
    assert toggle.drive.scale == pytest.approx(0.9 * made.drive.scale)
    said = button_contents(back)
    assert [one.good for one in said.verdicts] == [True, True]
    assert {one.name for one in said.figures} >= {"check-57"}
    labels = " ".join(str(one.label) for one in said.facts)
    assert "toggle at point 57" in labels and "Crosstalk at the button point" in labels
    by_label = {str(one.label): str(one.lines) for one in said.facts}
    # How much of it is played, how like it is, and how loud, as of the drive's own button.
    assert all(told in by_label["toggle at point 57"] for told in ("person who presses", "than the press"))
    assert "P01-push.h5" in by_label["Recordings"] and "P01-toggle.h5" in by_label["Recordings"]
    # Seen from one and then from the other, a drive is what it was.
    again = made.drive.seen_from("57").seen_from("button")
    assert again.button == "push" and np.array_equal(again.target, made.drive.target)


@pytest.mark.night
def test_what_two_buttons_move_above_their_band_is_not_called_right():
    """With modes to 10 kHz: the weaker one's error is an eighth between 2.5 and 5 kHz, and unknown above."""
    rig = opened(highest_hz=HIGHEST_HZ)
    every = [calibrate(rig, patch) for patch in "ABCD"]
    every += [calibrate(rig, patch, "57", excitation=Multisine()) for patch in "ABCD"]
    alone = drive_for(make_press(), every[0], rig.limits)
    trade = TradeOff(scale=alone.scale, drift=Drift(0, 0, 0, 0, 0))
    wanted = {"57": (late(make_press()), 0.9)}
    made = build_button(rig, make_press(), every, trade=trade, elsewhere=wanted, iterations=0, plays=48)
    (toggle,) = made.check.others
    assert toggle.verdict == "not shown" and toggle.within.root < 0.12 and made.check.error < 0.15
    assert "5 kHz" in toggle.reasons[0]


@pytest.mark.many_plays
@pytest.mark.night
@pytest.mark.parametrize("there", ["toggle", "silence"])
def test_corrections_are_of_every_point(four, beside, monkeypatch, there):
    """On a table that has drifted since, by the surface's own motion before and after."""
    press, every = make_press(), [*four.calibrations, *beside]
    alone = drive_for(press, four.calibrations[0], four.rig.limits)
    trade = TradeOff(scale=0.7 * alone.scale, drift=Drift(0, 0, 0, 0, 0))
    wanted = {"57": late(press) if there == "toggle" else None}
    drive = drive_for(press, every, four.rig.limits, trade=trade, elsewhere=wanted)
    with opened(mode_drift=0.005) as rig:
        learning = learn(rig, drive, every, iterations=2, plays=4)
    first, best = learning.iterations[0], learning.iterations[learning.best]
    assert [len(one.each_within) for one in (first, best)] == [2, 2]
    expected = {"button": learning.drive.predicted_error}
    if there == "toggle":
        expected["57"] = learning.drive.elsewhere[0].expected[0]
    with opened(mode_drift=0.005, noise=0.0) as rig:
        for point, error in expected.items():
            seen = [one if point == one.point else one.seen_from(point) for one in (drive, learning.drive)]
            (_, before, _), (_, after, beyond) = (played_and_true(rig, one, 3, monkeypatch) for one in seen)
            assert after < 0.6 * before
            assert error == pytest.approx(after, abs=0.03)
            # What the laser's noise looks like beyond the band is not played: it was, as 8 % of this target.
            assert beyond < 0.04
        if there == "silence":
            still = [check(rig, one, plays=3).silent[0].contrast_db for one in (drive, learning.drive)]
            assert still[1] > still[0] + 4


@pytest.mark.night
def test_a_button_that_fails_elsewhere_fails_the_check(four, beside):
    """The first is as planned, and the other has volts that are not its own."""
    press = make_press()
    loud = drive_for(press, four.calibrations, four.rig.limits)
    both = drive_for(press, [*four.calibrations, *beside], four.rig.limits, elsewhere={"57": late(press)})
    spoilt = replace(loud, elsewhere=tuple(replace(one, target=one.target / 3) for one in both.elsewhere))
    result = check(four.rig, spoilt, plays=3)
    assert result.verdict == "fail" and result.error < 0.1
    assert any("The toggle button at the 57 point" in reason for reason in result.reasons)


def test_more_points_than_patches_are_refused(four, beside):
    press, ours, every = make_press(), [four.calibrations[0], beside[0]], [*four.calibrations, *beside]
    two, both = [*four.calibrations[:2], *beside[:2]], {"57": late(press), "58": None}
    too_large = r"point 57 cannot be .* times the size"
    for says, given, points in (
        (r"2 points cannot be moved .* by 1 patches", ours, {"57": None}),
        ("One point is to have the press, and 2 of the cal", ours, {}),
        ("No patch was calibrated at the 58 point", four.calibrations, {"58": None}),
        ("3 points cannot be moved or kept silent at once by 2 pat", two, both),
        *((too_large, every, {"57": (late(press), size)}) for size in (0.0, float("nan"), 1000.0)),
    ):
        raises(ConfigurationError, says, drive_for, press, given, four.rig.limits, elsewhere=points)


def test_one_amplifier_for_all_is_told_before_a_play(calibrated, button):
    rig = calibrated.rig
    drive = replace(button.drive, rig=rig.name, rate_hz=rig.table.rate_hz)
    with rig.captures() as captures, pytest.raises(ConfigurationError, match="no channel of its own"):
        check(rig, drive, plays=3)
    assert not captures


def test_calibrations_of_several_patches_are_found_by_one_name(four, tmp_path):
    path = tmp_path / "table.h5"
    for one in four.calibrations[:3]:
        one.save(calibration_of(path, one.response.patch))
    found = load_calibrations([path], ("C", "A"))
    assert [one.response.patch for one in found] == ["C", "A"]
    files = [calibration_of(path, patch) for patch in "AB"]
    assert [one.response.patch for one in load_calibrations(files)] == ["A", "B"]
    with pytest.raises(ConfigurationError, match="no calibration of patch C among those given"):
        load_calibrations(files, ("A", "C"))
    raises(DataError, "table-D", load_calibrations, [path], ("D",))
    (tmp_path / "table-A-waveforms.h5").touch()
    raises(ConfigurationError, r"of patches A, B, C: .* \(--patches A,B,C\)", load_calibrations, [path])


def test_calibrations_that_do_not_belong_together_are_refused_in_a_sentence(four):
    """Of another table, or of another day; their order does not matter."""
    a, b, c, d = four.calibrations
    press, limits = make_press(), four.rig.limits
    moved = replace(c, model=replace(c.model, poles=1.01 * c.model.poles))
    says = r"patch A at the button point \(.*\) and of patch C at .* differ by 1.0%: they are of two tables"
    raises(ConfigurationError, says, drive_for, press, (a, b, moved, d), limits)
    with open_rig("four-channel", simulate="twin", simulation={"seed": SEED + 1}) as rig:
        stranger = calibrate(rig, "C")
    with pytest.raises(ConfigurationError, match=r"patch C .* differ by .* of two tables"):
        drive_for(press, (a, b, stranger, d), limits)
    straight, turned = (drive_for(press, four.calibrations[::step], limits) for step in (1, -1))
    assert turned.patches == tuple("DCBA") and turned.scale == pytest.approx(straight.scale, rel=0.02)
    assert turned.drifted_error == pytest.approx(straight.drifted_error, rel=0.05)


@pytest.mark.night
def test_a_plan_compares_one_patch_and_four_as_calibrated_and_after_a_drift(four):
    plan = plan_button(make_press(), four.calibrations, four.rig, methods=("modulated",))
    alone, every = plan.curves
    assert (alone.patch, every.patch) == ("A", "A, B, C, D")
    # Each is what the check of that drive finds, on the table as it was calibrated and on one that drifted.
    for curve, some in ((alone, four.calibrations[:1]), (every, four.calibrations)):
        offer = curve.offers[1]
        drive = drive_for(make_press(), some, four.rig.limits, trade=TradeOff(scale=offer.scale))
        with opened(mode_drift=0.01) as rig:
            drifted = check(rig, drive, plays=3).error
        assert offer.error < 0.06 and 0.5 * drifted < offer.drifted < 2 * drifted
    assert alone.offers[1].drifted > 4 * every.offers[1].drifted
    assert every.offers[0].error < every.offers[0].drifted


@pytest.mark.night
def test_a_plan_counts_what_other_points_do(four, beside, calibrated, monkeypatch):
    """Errors are those of the worst button, and levels those of the weakest."""
    press, every, rig = make_press(), [*four.calibrations, *beside], four.rig
    monkeypatch.setattr(loudness, "_DRIVES", 1)
    wanted = {"57": late(press)}
    plan = plan_button(press, every, rig, methods=("modulated",), elsewhere=wanted)
    (curve,) = plan.curves
    (offer,) = curve.offers
    drive = drive_for(press, every, rig.limits, trade=TradeOff(loudness.BUDGET), elsewhere=wanted)
    (toggle,) = drive.elsewhere
    assert curve.patch == "A, B, C, D" and offer.scale == drive.scale
    assert offer.error == max(drive.predicted_error, toggle.expected[0])
    assert offer.drifted == max(drive.drifted_error, toggle.expected[1])
    levels = [levels_of(one.target, drive.rate_hz).pressing for one in (drive, toggle)]
    assert offer.level == pytest.approx(min(levels) - pressing_act(plan.lab).shift)
    said = plan_contents(plan).notes[0]
    assert "play the toggle button at point 57" in said and "worst button" in said
    with pytest.raises(ConfigurationError, match=r"no other point \(57\) can be moved or kept silent"):
        plan_button(press, every, calibrated.rig, elsewhere=wanted)


@pytest.mark.night
def test_a_smaller_drift_that_is_planned_against_is_louder(four):
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
