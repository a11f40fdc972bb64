"""The distortion that a law leaves is that of the patch, whatever the noise of the laser."""

import numpy as np
import pytest

from haploop.calibration import quick_response
from haploop.calibration.response import beyond, distortion, measure_above, measure_both_signs
from haploop.calibration.response.response import LINEAR

pytestmark = pytest.mark.requires("simulation")


@pytest.mark.long
@pytest.mark.parametrize("noise", [1.0, 5.0, 20.0])
def test_noise_is_not_taken_for_distortion(open, noise):
    """A patch without hysteresis distorts nothing: what one play leaves on silent lines is noise."""
    rig = open(hysteresis=0.0, vibrometer_noise_scale=noise)
    one = quick_response(rig, hysteresis=LINEAR)
    noisy = np.median(np.linalg.norm(one.distortion, axis=0) / np.abs(one.velocity))
    assert distortion(measure_both_signs(rig, "A", "button"), LINEAR) < 0.2 * noisy


@pytest.mark.parametrize("noise", [1.0, 10.0])
def test_a_distortion_is_found_in_noise(open, noise):
    """Without its law, the loop of 12 % moves the table on lines that were not played."""
    found = [
        distortion(measure_both_signs(open(seed=41, vibrometer_noise_scale=scale), "A", "button"), LINEAR)
        for scale in (0.1, noise)
    ]
    assert 0.02 < found[0] < 0.08
    assert found[1] == pytest.approx(found[0], rel=0.05)


@pytest.mark.long
@pytest.mark.parametrize("noise", [1.0, 10.0])
def test_noise_is_not_taken_for_motion_above_what_was_played(open, noise):
    """A patch without hysteresis moves nothing there, one with it does."""
    for hysteresis in (0.0, 0.12):
        each = []
        for scale in (0.1, noise):
            rig = open(seed=41, hysteresis=hysteresis, vibrometer_noise_scale=scale)
            both = measure_both_signs(rig, "A", "button")
            above = measure_above(rig, "A", "button", LINEAR)
            assert above is not None
            each.append(beyond(both, LINEAR, above))
        (hz, quiet, _), (_, found, deviation) = each
        assert hz[0] > 600 and hz[-1] == pytest.approx(4000, abs=1)
        away = (found - (quiet if hysteresis else 0)) / deviation
        assert np.abs(away).max() < 4 and np.sqrt(np.mean(away**2)) < 2
        assert (quiet > 10 * deviation).any() == bool(hysteresis)
