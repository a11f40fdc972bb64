"""The generator's sweep, measured by the DAQ and the laser, is a way to calibrate."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.calibration import calibrate, load_calibrations
from haploop.calibration.response import QUICK, Spot, measure_response, play_sweep
from haploop.calibration.response.excitation import LinearSweep
from haploop.calibration.self_test.patch_test import check_patches
from haploop.instruments import Rig
from tests.instruments.rig.test_rig import assert_safe

GENERATOR = """
base = "simulated"
[amplifier]
input = "generator"
[generator]
driver = "keysight-33500"
resource = "TCPIP::127.0.0.1::5025::SOCKET"
output = "generator"
"""


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "generator.toml"
    path.write_text(GENERATOR)
    return str(path)


def shape_error(rig: Rig, found: Any) -> float:
    """Relative rms, 30 to 600 Hz, but for the patch's own gain at the level of the sweep."""
    f, H = found.frequencies, found.velocity
    inside = (f > 30) & (f < 600)
    true = rig.simulation.truth.velocity_response("A", "button", f)[inside]
    H = H[inside] * np.vdot(H[inside], true) / np.linalg.norm(H[inside]) ** 2
    return float(np.linalg.norm(H - true) / np.linalg.norm(true))


@pytest.mark.long
@pytest.mark.requires("simulation")
@pytest.mark.many_plays
def test_a_calibration_by_generator_is_as_near_the_truth_as_by_daq(open, file):
    rig = open(file, seed=23)
    found = calibrate(rig)
    error = shape_error(rig, found.response)
    assert error < 0.003 and error < 2 * found.response.uncertainty
    assert found.model.resonance_hz == pytest.approx(rig.simulation.truth.resonance_hz, abs=0.05)
    assert "by the" in found.response.excitation and "on its own clock" in found.response.excitation
    # The level is what the patch got, and the law of levels is there as with the DAQ.
    assert found.response.level == pytest.approx(0.98 * rig.limits.peak, rel=0.08)
    assert abs(found.response.level_gain[-1]) == pytest.approx(0.70, abs=0.03)
    assert found.above is None and found.distortion == 0.0  # not measured
    assert not rig.generator.is_on
    assert_safe(rig)


@pytest.mark.requires("simulation")
def test_one_sweep_is_found_in_what_the_monitor_shows(open, file):
    """On twin and wire."""
    rig = open(file)
    swept = play_sweep(Spot(rig, "A", "button"), LinearSweep(seconds=1.0, tail=0.2), 30.0)
    lead = round(0.05 * rig.table.rate_hz)
    assert swept.gain == pytest.approx(1.0, rel=0.05) and not swept.problem
    assert np.abs(swept.volts[: lead - 2]).max() < 0.3
    assert np.abs(swept.volts[lead : 3 * lead]).max() > 10
    assert_safe(rig)


@pytest.mark.requires("simulation")
def test_another_sweep_than_asked_is_refused(open, file, monkeypatch):
    rig = open(file)
    other = LinearSweep(seconds=0.5, tail=0.2)
    monkeypatch.setattr(
        "haploop.calibration.response.from_sweeps.ordered",
        lambda sweep, rate_hz: np.sin(np.linspace(0, 500, round(sweep.seconds * rate_hz)) ** 2 / 200),
    )
    with pytest.raises(InstrumentError, match=r"does not show the sweep of 1 to 625 Hz in 0\.5 s"):
        play_sweep(Spot(rig, "A", "button"), other, 30.0)
    assert_safe(rig)


def test_a_generator_plays_no_multisine_and_no_drive(open, file):
    rig = open(file)
    with pytest.raises(ConfigurationError, match="plays sweeps only"):
        measure_response(rig, excitation=QUICK)
    with pytest.raises(ConfigurationError, match=r"generator feeds the amplifier.*plays no drive"):
        rig.excite(np.zeros(10), ["A"], ["drive"])


def test_an_output_of_the_daq_plays_drives_on_the_generators_wire(open, tmp_path):
    path = tmp_path / "both.toml"
    path.write_text(GENERATOR.replace('"generator"', '"amplifier"'))
    rig = open(str(path))
    drive = 20 * np.hanning(5000) * np.sin(np.arange(5000) / 30)
    capture = rig.excite(drive, ["A"], ["drive"])
    assert np.abs(rig.drive_monitor().to_si(capture.volts)).max() == pytest.approx(20, rel=0.05)
    assert_safe(rig)


@pytest.mark.long
def test_the_command_calibrates_by_the_generator(run, file, tmp_path):
    out = tmp_path / "c.h5"
    assert run("calibrate", "--rig", file, "-o", out).exit_code == 0
    (made,) = load_calibrations([out])
    assert made.carrier_hz > 200


@pytest.mark.long
@pytest.mark.requires("simulation")
@pytest.mark.many_plays
def test_doctor_tests_the_patches_by_the_generator(open, file):
    rig = open(file)
    found = {one.name: one for one in check_patches(rig)}
    assert {found[f"Patch {patch}"].status for patch in "ABCD"} == {"green"}
    assert all(one.status == "green" for one in found.values())
    assert_safe(rig)
