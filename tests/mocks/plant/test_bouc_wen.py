import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haploop.mocks.plant.hysteresis import _AWAY, _TOWARDS, BoucWen, Hysteresis


@pytest.mark.parametrize("law", [BoucWen, Hysteresis])
def test_the_loop_has_the_width_that_was_asked_for(law):
    t = np.linspace(0, 3, 6001)
    linear_volts = law(0.12).follow(50 * np.sin(2 * np.pi * t))[2000:]
    crossing = linear_volts[np.isclose(np.sin(2 * np.pi * t[2000:]), 0, atol=1e-9)]
    assert np.ptp(linear_volts) == pytest.approx(100, rel=1e-5)
    assert np.ptp(crossing) / np.ptp(linear_volts) == pytest.approx(0.12, rel=1e-5)
    # The other law of the same width is off by more than a law that is identified would be.
    other = {BoucWen: Hysteresis, Hysteresis: BoucWen}[law](0.12).follow(50 * np.sin(2 * np.pi * t))[2000:]
    assert np.abs(other - linear_volts).max() > 1


@settings(max_examples=25)
@given(st.lists(st.floats(-60, 60), min_size=1, max_size=12), st.integers(0, 12))
def test_it_solves_its_differential_equation(path, cut):
    volts = np.array(path)
    patch = BoucWen(0.12)
    linear_volts = np.concatenate([patch.follow(v) for v in (volts[:cut], volts[cut:]) if len(v)])
    slow, fast = (_AWAY + _TOWARDS) / 2, (_AWAY - _TOWARDS) / 2
    h, last, expected = 0.0, 0.0, []
    for v in volts:
        step = (v - last) / 2000
        for _ in range(2000):
            h += step * (1 - (slow * np.sign(step) + fast * np.sign(h)) * h)
        last = v
        expected.append(patch._linear * v - patch._share * h)
    np.testing.assert_allclose(linear_volts, expected, atol=0.02)
