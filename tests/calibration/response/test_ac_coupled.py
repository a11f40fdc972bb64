"""What an AC-coupled input loses of laser and drive is put back: on a sound card a response is what it is."""

from pathlib import Path

import numpy as np
import pytest

import haploop
from haploop.calibration import quick_response
from haploop.instruments import load_rig_file
from haploop.instruments.config import Device

pytestmark = pytest.mark.requires("simulation")

CARD = load_rig_file(Path(__file__).parents[1] / "self_test" / "card.toml")


def measured(laser_hz: float, drive_hz: float) -> haploop.calibration.Response:
    daq = CARD.daq.settings
    channels = {name: dict(table) for name, table in daq["channels"].items()}
    channels["laser"]["high_pass_hz"], channels["drive"]["high_pass_hz"] = laser_hz, drive_hz
    device = Device.model_validate({"driver": "sound-card", **daq, "channels": channels})
    with haploop.open_rig(CARD.model_copy(update={"daq": device}), simulate="twin") as rig:
        return quick_response(rig, "A", "button")


@pytest.mark.long
def test_a_response_does_not_depend_on_the_couplings():
    direct = measured(0.0, 0.0)
    for laser_hz, drive_hz in ((20.0, 0.0), (0.0, 5.0)):
        response = measured(laser_hz, drive_hz)
        off = np.abs(response.velocity / direct.velocity - 1)
        # A monitor of other phases finds another peak, so that another level is played.
        assert np.median(off) < 0.02 and np.median(off[response.frequencies < 60]) < 0.03
