"""Several drives at once, on a rig whose amplifier has a channel for each patch."""

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError, LimitError
from haploop.instruments import open_rig

RATE_HZ = 50_000


def burst(hz: float, peak: float = 20.0) -> np.ndarray:
    t = np.arange(round(0.1 * RATE_HZ)) / RATE_HZ
    return np.asarray(peak * np.sin(np.pi * t / t[-1]) ** 2 * np.sin(2 * np.pi * hz * t))


def test_each_patch_gets_its_own_drive(open):
    rig = open("four-channel")
    drives = {"A": burst(100), "C": burst(250, 10.0)}
    channels = [rig.monitor(patch) for patch in "ABCD"]
    capture = rig.excite_each(drives, channels)
    volts = np.abs(rig.sensors.drive.to_si(capture.volts)).max(axis=1)
    assert volts == pytest.approx([20, 0, 10, 0], abs=0.5)
    if rig.simulation:
        assert rig.simulation.truth.closed == frozenset()


def test_one_drive_reaches_all_patches_that_are_named(open):
    rig = open("four-channel")
    capture = rig.excite(burst(100), ("A", "B"), [rig.monitor(patch) for patch in "ABCD"])
    volts = np.abs(rig.sensors.drive.to_si(capture.volts)).max(axis=1)
    assert volts == pytest.approx([20, 20, 0, 0], abs=0.5)


@pytest.mark.usefixtures("unproved")
def test_every_drive_is_held_to_the_limits(open):
    rig = open("four-channel")
    with pytest.raises(LimitError, match="of the relay"):
        rig.excite_each({"A": burst(100), "B": burst(100, 60.0)}, [rig.monitor("A")])
    with pytest.raises(LimitError, match="one length"):
        rig.excite_each({"A": burst(100), "B": burst(100)[:-10]}, [rig.monitor("A")])
    if rig.simulation:
        assert rig.simulation.truth.peak == 0


def test_one_channel_for_all_patches_plays_one_drive(open):
    rig = open()
    with pytest.raises(ConfigurationError, match="no channel of its own for patch A, B"):
        rig.excite_each({"A": burst(100), "B": burst(100)}, ["drive"])
    if rig.simulation:
        assert rig.simulation.truth.peak == 0
    assert rig.monitor("B") == "drive"
    capture = rig.excite_each({"B": burst(100)}, ["drive"])
    volts = np.abs(rig.sensors.drive.to_si(capture.volts)).max()
    assert volts == pytest.approx(20, abs=0.5)


SHARED = """base = "four-channel"
name = "shared"
[amplifier.input]
A = "amplifier"
B = "amplifier"
C = "amplifier"
D = "amplifier_d"
"""


@pytest.mark.usefixtures("unproved")
def test_patches_that_share_a_channel_are_one_load_and_get_one_drive(tmp_path):
    """What three patches draw together counts, although the play has several drives."""
    path = tmp_path / "shared.toml"
    path.write_text(SHARED)
    with open_rig(path, simulate="twin") as rig:
        with pytest.raises(ConfigurationError, match="shares its amplifier channel"):
            rig.excite_each({"A": burst(100), "B": burst(250)}, [rig.monitor("A")])
        steep = burst(1800, 40.0)
        for patches, fits in ((1, True), (3, False)):
            assert (rig.limits_for(patches).headroom(steep, RATE_HZ)[0] > 1) is fits
        with pytest.raises(LimitError, match="A at sample"):
            rig.excite_each(dict.fromkeys("ABCD", steep), [rig.monitor("A")])
        assert rig.simulation is not None and rig.simulation.truth.peak == 0
        rig.excite_each({"A": steep, "D": steep}, [rig.monitor("A")])
