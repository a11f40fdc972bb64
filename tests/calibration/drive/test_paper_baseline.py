import numpy as np
import pytest

from benchmarks.paper_drive import ORDERS, paper_drive
from haploop.calibration import calibrate
from haploop.calibration.drive import check
from tests.calibration.conftest import make_press

pytestmark = pytest.mark.many_plays


@pytest.mark.long
def test_where_patch_and_point_differ_no_order_inverts(calibrated, drive):
    """The stable inverse of a response with zeros in the right half plane does not exist."""
    limits = calibrated.rig.limits
    drives = [paper_drive(make_press(), calibrated.calibration, limits, order) for order in (8, 16, 24)]
    for paper in drives:
        limits.check(paper.volts[0], paper.rate_hz)
        # Nothing moves before the press: it is causal.
        assert np.abs(paper.volts[:, :5000]).max() < 0.05 * paper.peak
    best = min(drives, key=lambda paper: paper.predicted_error)
    assert best.predicted_error > 0.3
    result = check(calibrated.rig, best, plays=3)
    assert not result.passed
    assert check(calibrated.rig, drive, plays=3).within.root < 0.3 * result.within.root


@pytest.mark.requires("simulation")
def test_where_they_coincide_it_can(open, full):
    if not full:
        pytest.skip("calibrates another table: runs with --full")
    rig = open(collocated=True, hysteresis=0.0)
    calibration = calibrate(rig)
    drives = [paper_drive(make_press(), calibration, rig.limits, order) for order in ORDERS]
    best = min(drives, key=lambda drive: drive.predicted_error)
    assert best.predicted_error < 0.01
    assert check(rig, best).within.root < 0.03
