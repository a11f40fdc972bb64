"""`calibrate --since`: how channels scatter."""

from dataclasses import replace

import pytest

from haploop.calibration import Calibration, Waveforms

pytestmark = pytest.mark.long


@pytest.mark.night
def test_earlier_calibrations_tell_how_a_channel_scatters(demo, run, tmp_path, monkeypatch):
    table = demo.folder / "calibration.h5"
    first, earlier = Calibration.load(table), []
    measured = first, Waveforms.load(Waveforms.beside(table))
    monkeypatch.setattr("haploop.calibration.calibrate_keeping", lambda *_: measured)
    for number, gain in enumerate((0.998, 1.0, 1.003)):
        response = replace(first.response, velocity=gain * first.response.velocity)
        earlier += ["--since", tmp_path / f"{number}.h5"]
        replace(first, response=response).save(tmp_path / f"{number}.h5")
    out = tmp_path / "table.h5"
    channel, again = run.json("calibrate", *earlier, "--out", out)["channel"], Calibration.load(out)
    assert channel["changes"] == 3 and again.scatter.gain == channel["gain"]
    assert channel["gain"] == pytest.approx(0.0036, abs=0.0005)
    assert Waveforms.load(Waveforms.beside(out)).calibration == again.digest

    # What was measured is kept when nothing can be said of its channel.
    other = replace(first.response, velocity=first.response.velocity[::-1])
    replace(first, response=other).save(tmp_path / "other.h5")
    run("calibrate", *earlier, "--since", tmp_path / "other.h5", "--out", tmp_path / "kept.h5", ends=1,
        says="no gain, delay or drift")  # fmt: skip
    assert Calibration.load(tmp_path / "kept.h5").digest == first.digest

    run("calibrate --since", table, "--out", tmp_path / "few.h5", says="--since needs 3 earlier calibrations")
    assert not (tmp_path / "few.h5").exists()
