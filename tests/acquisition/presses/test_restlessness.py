"""A force that is not at rest is not always a hand: hum and creep are told as what they are."""

import numpy as np
import pytest

from haploop.acquisition import record
from haploop.acquisition.presses.sensor_faults import crept, restlessness
from haploop.base.errors import DataError
from haploop.instruments.mains import mains_hum

GAUGES = [f"gauge{k}" for k in range(6)]
RATE_HZ = 5000.0


def noise(seconds: float, seed: int) -> np.ndarray:
    return 0.03 * np.random.default_rng([seed, 0x4E01]).standard_normal(round(seconds * RATE_HZ))


@pytest.mark.parametrize(("seed", "mains_hz"), [(4077, 50), (91823, 60)])
def test_hum_is_found_and_noise_and_a_slow_hand_are_none(seed, mains_hz):
    force = noise(0.5, seed)
    t = np.arange(len(force)) / RATE_HZ
    hum = 0.3 * np.sin(2 * np.pi * 1.001 * mains_hz * t + seed)
    found = mains_hum(force + 5 * t + hum, RATE_HZ)
    assert found and found.mains_hz == mains_hz
    assert found.rms == pytest.approx(0.3 / np.sqrt(2), rel=0.05)
    assert f"hum, 0.21 N rms at {mains_hz} Hz" in restlessness(force + hum, RATE_HZ)
    assert mains_hum(force, RATE_HZ) is None
    assert "drifts by +0." in restlessness(force + 0.5 * t, RATE_HZ)
    hand = 0.5 * np.sin(2 * np.pi * 2.3 * t) + 0.2 * np.sin(2 * np.pi * 5.1 * t + 1)
    assert restlessness(force + hand, RATE_HZ) == ""


@pytest.mark.parametrize("seed", [5, 88172])
def test_creep_fades_and_a_finger_leaves(seed):
    force = noise(0.6, seed)
    t = np.arange(len(force)) / RATE_HZ
    faded = 0.35 * np.exp(-t / 0.5)
    assert crept(force + faded, 6.0, RATE_HZ)
    assert not crept(force + 0.35 * (t < 0.4), 6.0, RATE_HZ)
    assert not crept(force + 2 * faded, 4.0, RATE_HZ), "too much for creep"
    assert not crept(force + 0.35 * (t > 0.3), 6.0, RATE_HZ)


@pytest.mark.requires("simulation")
def test_hum_of_the_gauges_is_not_a_hand(open, tmp_path):
    """At 0.04 V it would begin a press that never ends, at 0.004 V it is harmless."""
    rig = open(seed=77123, faults=[{"kind": "mains-hum", "channel": GAUGES, "volts": 0.04}])
    with pytest.raises(DataError, match=r"has mains hum, .* N rms at 50 Hz; check the grounding") as error:
        record(rig, "push", "P01", 1, tmp_path / "hum")
    assert "hands" not in str(error.value)
    rig = open(seed=77123, faults=[{"kind": "mains-hum", "channel": GAUGES, "volts": 0.004}])
    assert len(record(rig, "push", "P01", 2, tmp_path / "little").accepted) == 2


@pytest.mark.requires("simulation")
def test_creep_of_the_gauges_is_not_a_finger_that_rests(open, tmp_path):
    rig = open(
        seed=77123, faults=[{"kind": "sensor-creep", "channel": GAUGES, "share": 0.15, "longest": 0.5}]
    )
    recording = record(rig, "latch", "P01", 3, tmp_path)
    assert [press.reason for press in recording.verdicts] == ["", "", ""]
    assert rig.simulation.faults[0].fired
