"""What a calibration was computed from is kept: anybody can compute it again."""

import h5py
import numpy as np
import pytest

from haploop.acquisition import verify
from haploop.calibration import LinearSweep, Waveforms, measure_response
from haploop.reports.contents import file_contents

pytestmark = pytest.mark.rig
SHORT = LinearSweep(repeats=2, seconds=1.5, tail=1.0, shares=())


def test_the_response_is_computed_again_from_the_file(open, tmp_path):
    """With nothing but numpy and h5py; docs/explanation/check.md shows the same script."""
    path = tmp_path / "c-waveforms.h5"
    rig = open(hysteresis=0)
    with rig.captures() as captures:
        response = measure_response(rig, excitation=SHORT)
    rig.excite(np.zeros(10), ("A",), ("laser",))
    Waveforms.of(rig, captures, "hash", "A", "button").save(path)
    assert verify(path) == ()
    shown = file_contents(path).values
    assert (shown["plays"], shown["channels"]) == (len(captures), ["drive", "laser"])
    assert shown["seconds"] == pytest.approx(Waveforms.load(path).seconds)

    with h5py.File(path) as file:
        last = max(file["captures"])
        volts, rate_hz = file[f"captures/{last}/volts"][:], file[f"captures/{last}"].attrs["rate_hz"]
    drive, laser = np.fft.rfft(volts)
    f = np.fft.rfftfreq(volts.shape[1], 1 / rate_hz)
    inside = (f > 60) & (f < 580)
    again = np.abs(laser * rig.vibrometer.scale / (drive * 100))[inside]
    said = np.abs(np.interp(f[inside], response.frequencies, response.velocity))
    assert np.linalg.norm(again - said) < 0.03 * np.linalg.norm(said)
