"""Several drives at once, on a rig whose amplifier has a channel for each patch."""

from __future__ import annotations

import numpy as np
import pytest

from haploop.instruments import ConfigurationError, LimitError
from tests.conftest import OpenRig

RATE_HZ = 50_000


def burst(hz: float, peak: float = 20.0) -> np.ndarray:
    t = np.arange(round(0.1 * RATE_HZ)) / RATE_HZ
    return np.asarray(peak * np.sin(np.pi * t / t[-1]) ** 2 * np.sin(2 * np.pi * hz * t))


def test_each_patch_gets_its_own_drive(open: OpenRig) -> None:
    rig = open("four-channel")
    drives = {"A": burst(100), "C": burst(250, 10.0)}
    channels = [rig.monitor(patch) for patch in "ABCD"]
    capture = rig.excite_each(drives, channels)
    volts = np.abs(rig.sensors.drive.to_si(capture.volts)).max(axis=1)  # type: ignore[union-attr]
    assert volts == pytest.approx([20, 0, 10, 0], abs=0.5)
    if rig.simulation:
        assert rig.simulation.truth.closed == frozenset()


def test_one_drive_reaches_all_patches_that_are_named(open: OpenRig) -> None:
    rig = open("four-channel")
    capture = rig.excite(burst(100), ("A", "B"), [rig.monitor(patch) for patch in "ABCD"])
    volts = np.abs(rig.sensors.drive.to_si(capture.volts)).max(axis=1)  # type: ignore[union-attr]
    assert volts == pytest.approx([20, 20, 0, 0], abs=0.5)


@pytest.mark.usefixtures("unproved")
def test_every_drive_is_held_to_the_limits(open: OpenRig) -> None:
    rig = open("four-channel")
    with pytest.raises(LimitError, match="of the relay"):
        rig.excite_each({"A": burst(100), "B": burst(100, 60.0)}, [rig.monitor("A")])
    with pytest.raises(LimitError, match="one length"):
        rig.excite_each({"A": burst(100), "B": burst(100)[:-10]}, [rig.monitor("A")])
    if rig.simulation:
        assert rig.simulation.truth.peak == 0


def test_one_channel_for_all_patches_plays_one_drive(open: OpenRig) -> None:
    rig = open()
    with pytest.raises(ConfigurationError, match="no channel of its own for patch B"):
        rig.excite_each({"B": burst(100)}, ["drive"])
    assert rig.monitor("B") == "drive"
