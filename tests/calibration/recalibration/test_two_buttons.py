"""Recalibration of a history whose button plays another press at a second point at the same time."""

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest

from haploop.calibration import Multisine, TradeOff, build_button, calibrate
from haploop.calibration.drive import STEADY
from haploop.calibration.recalibration.adoption import adopt, buttons_of, calibrations_of
from haploop.calibration.recalibration.history import History
from haploop.calibration.recalibration.recalibration import recalibrate
from haploop.instruments import Rig, open_rig
from haploop.mocks.plant.table import FEWEST_HZ, TouchTable
from tests.calibration.conftest import make_press
from tests.calibration.recalibration.conftest import WHEN

SEED = 16584257
POINTS, PATCHES = ("button", "80"), "AB"


def opened(mode_drift: float = 0.0) -> Rig:
    simulation = {"seed": SEED, "vibrometer_noise_scale": 0.25}
    # Within the band: what the second button moves above it, one correction does not take away.
    plant = TouchTable(mode_drift=mode_drift, highest_hz=FEWEST_HZ)
    return open_rig("four-channel", simulate="twin", simulation=simulation, plant=plant)


@pytest.mark.night
def test_two_buttons_are_made_anew_together_on_a_table_that_has_drifted(tmp_path):
    press = make_press()
    acceleration = 0.6 * np.roll(press.acceleration, round(0.02 * press.rate_hz))
    tick = replace(press, button="tick", acceleration=acceleration)
    with opened() as rig:
        calibrations = [
            calibrate(rig, patch, point, excitation=Multisine()) for point in POINTS for patch in PATCHES
        ]
        trade = TradeOff(error=0.05, drift=STEADY)
        made = build_button(rig, press, calibrations, trade=trade, elsewhere={"80": tick}, iterations=1)
        history = History(tmp_path / "calibrations")
        adopt(history, [made], actor="a test", reason="it begins", when=WHEN)
    with opened(0.02) as rig:
        outcome = recalibrate(rig, history, when=WHEN + timedelta(days=1), iterations=1)
        assert outcome.kind == "restored", outcome.sentences
        (name,) = outcome.after
        old, new = outcome.before[name], outcome.after[name].check
        assert not old.passed and new.passed
        for before, after in zip((old, *old.others), (new, *new.others), strict=True):
            assert after.error < 0.5 * before.error
        active = history.active()
        (kept,) = buttons_of(active).values()
        assert kept.digest == outcome.after[name].digest and list(kept.elsewhere) == ["80"]
        places = {(one.response.patch, one.response.point) for one in calibrations_of(active)}
        assert places == {(patch, point) for point in POINTS for patch in PATCHES}
