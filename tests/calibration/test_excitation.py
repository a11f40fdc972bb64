from __future__ import annotations

import numpy as np
import pytest

from calibration import linear_sweep
from instruments import ConfigurationError, Limits


def test_a_sweep_may_be_played_and_rises_linearly() -> None:
    sweep = linear_sweep(50e3, 7.0, 625.0, 48.0)
    Limits(low=-48, high=48, mean=0.01, end=0.5, slew=0.5e6).check(sweep, 50e3)
    assert np.abs(sweep).max() == pytest.approx(48)
    for second in (1.0, 3.5, 6.0):
        piece = sweep[round((second - 0.1) * 50e3) : round((second + 0.1) * 50e3)]
        crossings = np.flatnonzero(np.diff(np.signbit(piece)))
        rate = (len(crossings) - 1) / 2 / ((crossings[-1] - crossings[0]) / 50e3)
        assert rate == pytest.approx(625 / 7 * second, rel=0.02)


@pytest.mark.parametrize(("duration", "stop"), [(0.1, 625), (7, 25e3), (7, 0)])
def test_a_sweep_that_cannot_be_sampled_is_refused(duration: float, stop: float) -> None:
    with pytest.raises(ConfigurationError, match="sweep"):
        linear_sweep(50e3, duration, stop, 1.0)
