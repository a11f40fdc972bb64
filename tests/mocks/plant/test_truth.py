"""What the simulator knows is compared with what a perfect laser shows of it."""

import numpy as np
import pytest

pytestmark = pytest.mark.rig


def test_the_true_velocity_is_the_lasers_before_pole_and_delay(open, unproved):
    rig = open(vibrometer_noise_scale=0)
    if rig.simulation is None:
        pytest.skip("only a simulation knows the truth")
    truth = rig.simulation.truth
    played = truth.record()
    rate_hz = rig.table.rate_hz
    t = np.arange(25_000) / rate_hz
    drive = 20 * np.sin(2 * np.pi * (50 + 2000 * t) * t) * np.hanning(len(t))
    capture = rig.excite(drive, ["A"], ["laser"])
    seen = rig.vibrometer.to_si(capture.volts[0])
    # A part begins with the stream, whose first sample lies a delay of the card later.
    start = next(part.start for part in played if part.volts.any())
    surface = truth.velocity("button", start + np.arange(len(seen)) / rate_hz + capture.delays[0])
    f = np.fft.rfftfreq(len(seen), 1 / rate_hz)
    band = (f > 20) & (f < 2500)
    lasers, own = np.fft.rfft(seen)[band], np.fft.rfft(surface)[band]
    through = own * rig.vibrometer.response(f[band])
    assert np.linalg.norm(through - lasers) < 0.01 * np.linalg.norm(lasers)
    assert np.linalg.norm(own - lasers) > 0.1 * np.linalg.norm(lasers)


def test_the_future_is_not_told(open):
    rig = open()
    if rig.simulation is None:
        pytest.skip("only a simulation knows the truth")
    with pytest.raises(ValueError, match="future"):
        rig.simulation.truth.velocity("button", np.array([rig.clock.now() + 1]))
