from __future__ import annotations

import numpy as np
import pytest

from calibration import calibrate, check, drive_for, paper_drive
from tests.calibration.conftest import Calibrated, make_press
from tests.conftest import OpenRig


def test_where_patch_and_point_differ_no_order_inverts(calibrated: Calibrated) -> None:
    """The stable inverse of a response with zeros in the right half plane does not exist."""
    limits = calibrated.rig.limits
    drives = [paper_drive(make_press(), calibrated.calibration, limits, order) for order in (8, 16, 24)]
    for drive in drives:
        limits.check(drive.volts, drive.rate_hz)
        # Nothing moves before the press: it is causal.
        assert np.abs(drive.volts[:5000]).max() < 0.05 * drive.peak
    best = min(drives, key=lambda drive: drive.predicted_error)
    assert best.predicted_error > 0.3
    result = check(calibrated.rig, best, plays=2)
    assert not result.passed
    ours = drive_for(make_press(), calibrated.calibration, limits)
    assert check(calibrated.rig, ours, plays=2).nrmse < 0.3 * result.nrmse


@pytest.mark.requires("simulation")
def test_where_they_coincide_it_can(open: OpenRig, full: bool) -> None:
    if not full:
        pytest.skip("calibrates another table: runs with --full")
    rig = open(collocated=True, hysteresis=0.0)
    calibration = calibrate(rig)
    errors = [paper_drive(make_press(), calibration, rig.limits, n).predicted_error for n in range(4, 34, 2)]
    assert min(errors) < 0.15
