"""The noise floor of each channel, and tones in it, by the test that doctor runs."""

import pytest

from haploop.calibration.self_test.sensor_test import check_noise

pytestmark = pytest.mark.requires("simulation")

HUM = {"kind": "mains-hum", "channel": "acceleration_z", "volts": 0.02, "frequency": 60.0}
FAN = {"kind": "rotating-machine", "channel": "laser", "volts": 0.01, "frequency": 87.3}


@pytest.mark.parametrize("faults", [[], [HUM], [HUM, FAN]], ids=["quiet", "hum", "hum and a fan"])
def test_tones_are_named_where_they_are_and_nowhere_else(open, faults):
    found = {finding.name: finding for finding in check_noise(open(faults=faults))}
    told = {name: finding for name, finding in found.items() if "steady tones" in finding.sentence}
    assert set(told) == {f"Noise floor of {fault['channel']}" for fault in faults}
    for fault in faults:
        finding = told[f"Noise floor of {fault['channel']}"]
        assert finding.status == "yellow" and f"steady tones at {fault['frequency']:.1f}" in finding.sentence
        assert "look for mains hum (ground the cable), a fan or a motor" in finding.sentence
