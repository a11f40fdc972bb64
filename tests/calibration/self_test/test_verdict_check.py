"""What doctor says beforehand of a check's error, beside the interval of the check."""

import re

import numpy as np
import pytest

from haploop.calibration import check
from haploop.calibration.self_test.verdict_test import check_verdicts

pytestmark = [pytest.mark.requires("simulation"), pytest.mark.many_plays]


@pytest.mark.long
def test_doctor_says_beforehand_what_a_check_will_tell(open, drive):
    rig = open()
    _, of_it = check_verdicts(rig, {"push": drive})
    (told,) = re.findall(r"8 plays tell ([\d.]+)% of error", of_it.sentence)
    ends = [check(rig, drive, most=8).whole.interval[1] for _ in range(2)]
    assert of_it.status == "green" and float(told) / 100 == pytest.approx(np.mean(ends), rel=0.4)


def test_a_laser_that_cannot_tell_is_said_before_anything_is_played(open, drive):
    rig = open(vibrometer_noise_scale=200.0)
    general, of_it = check_verdicts(rig, {"push": drive})
    assert general.sentence.startswith("Up to 5000 Hz, 8 plays tell 20% of error of a target of")
    assert of_it.status == "red" and "choose a smaller range or filter" in of_it.sentence
    found = check(rig, drive, most=8)
    assert found.verdict == "not shown"
