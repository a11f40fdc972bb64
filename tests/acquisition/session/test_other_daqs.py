"""Presses are recorded on DAQs that are not NI's, and along with one that has its own clock."""

from pathlib import Path

import numpy as np
import pytest

import haploop
from haploop.base.arrays import FloatArray
from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.instruments import load_rig_file

pytestmark = pytest.mark.requires("simulation")

CARD = Path(__file__).parents[2] / "calibration" / "self_test" / "card.toml"
"""The paper's rig on a sound card with twelve inputs."""
SERIAL = """
base = "minimal"
name = "no-ni"
rate_hz = 2000

[daq]
driver = "serial-adc"
port = "COM7"
baud = 1000000
rate_hz = 2000
frame = { struct = "<H10h", sync = "AA55", checksum = "crc16" }
counter = 1

[daq.channels]
gauge0 = { column = 2, scale = 3.0518e-4, range = 10 }
gauge1 = { column = 3, scale = 3.0518e-4, range = 10 }
gauge2 = { column = 4, scale = 3.0518e-4, range = 10 }
gauge3 = { column = 5, scale = 3.0518e-4, range = 10 }
gauge4 = { column = 6, scale = 3.0518e-4, range = 10 }
gauge5 = { column = 7, scale = 3.0518e-4, range = 10 }
acceleration_x = { column = 8, scale = 1.5259e-4, range = 5 }
acceleration_y = { column = 9, scale = 1.5259e-4, range = 5 }
acceleration_z = { column = 10, scale = 1.5259e-4, range = 5 }
switch = { column = 11, scale = 3.0518e-4, range = 10 }
"""
"""A microcontroller with a converter of ten channels, and nothing else."""
ALONG = """
base = "minimal"
name = "along"

[adc]
driver = "serial-adc"
port = "COM5"
rate_hz = 80
frame = { separator = ",", columns = 2 }
latency = 0.005
edge = { channel = "switch", column = 1 }
channels = { load = { column = 2, scale = 2.384e-9, range = 0.02 } }

[sensors.extra.load]
channel = "load"
scale = 10000
unit = "N"
"""
"""An HX711 under the button, beside NI's card, with the button's contact wired to both."""


def rig_file(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(text)
    return path


@pytest.mark.long
@pytest.mark.parametrize("mode", ["twin", "wire"])
def test_a_board_on_a_serial_port_is_a_rigs_only_daq(tmp_path, mode):
    with haploop.open_rig(rig_file(tmp_path, SERIAL), simulate=mode) as rig:
        recording = haploop.record(rig, "latch", "P01", 2, tmp_path)
        assert rig.daq.identity.startswith("Serial ADC at ")
    assert recording.rate_hz == 2000 and [verdict.accepted for verdict in recording.verdicts] == [True] * 2
    with haploop.open_rig("minimal", simulate="twin") as rig:
        by_ni = haploop.record(rig, "latch", "P01", 2, tmp_path, name="by-ni")
    peaks = [float(np.abs(haploop.representative([one]).acceleration).max()) for one in (recording, by_ni)]
    assert peaks[0] == pytest.approx(peaks[1], rel=0.1)


@pytest.mark.long
@pytest.mark.parametrize("mode", ["twin", "wire"])
def test_a_load_cell_is_recorded_along_on_its_own_clock(tmp_path, mode):
    with haploop.open_rig(rig_file(tmp_path, ALONG), simulate=mode) as rig:
        plant = rig.simulation.plant
        plant.connect("load", lambda times: plant.force(times) / 10_000)
        names = ("first", "second")
        recordings = [haploop.record(rig, "latch", "P01", 2, tmp_path, name=name) for name in names]
    for recording in recordings:
        assert recording.channels[-1] == "load"
        told = {reading.name: reading.value for reading in recording.readings}
        assert told["frames lost"] == 0 and 0 < told["time uncertainty"] <= 0.01
        # On the wire time stands still while the socket is read: arrivals are as coarse as blocks.
        late = behind(recording.extra["load"], recording.force, recording.rate_hz)
        assert abs(late) < (told["time uncertainty"] if mode == "twin" else 0.06)
    # The contact was seen by both: the second recording is placed by it.
    assert told["time uncertainty"] == pytest.approx(0.5 / 80, rel=0.05)


def behind(load: FloatArray, force: FloatArray, rate_hz: float) -> float:
    """By how much one measurement of the force of the presses is later than another (s)."""
    lags = np.arange(-500, 501)
    inside = slice(1000, len(load) - 1000)
    alike = [np.corrcoef(np.roll(load, -lag)[inside], force[inside])[0, 1] for lag in lags]
    assert max(alike) > 0.98
    return float(lags[int(np.argmax(alike))] / rate_hz)


def test_what_a_file_says_twice_is_one_sentence(tmp_path):
    for text, says in (
        (SERIAL.replace("rate_hz = 2000", "rate_hz = 1000", 1), "write rate_hz = 2000 at the top"),
        (ALONG.replace("load = {", "switch = {"), "'switch' is also a channel of \\[daq\\]"),
        (ALONG.replace('channel = "switch"', 'channel = "swich"'), "'swich' is no channel of \\[daq\\]"),
        (ALONG.replace('driver = "serial-adc"', 'driver = "ni-daqmx"'), "is not for the role 'adc'"),
    ):
        with pytest.raises(ConfigurationError, match=says):
            load_rig_file(rig_file(tmp_path, text))


@pytest.mark.long
@pytest.mark.parametrize("file", ["card", "board"])
def test_what_is_lost_while_recording_ends_it_and_stands_in_the_file(tmp_path, file):
    path = CARD if file == "card" else rig_file(tmp_path, SERIAL)
    faults = [{"kind": "daq-overrun", "after": 6.0}]
    lost = pytest.raises(InstrumentError, match=r"an overrun|lost or damaged")
    with haploop.open_rig(path, simulate="twin", simulation={"faults": faults}) as rig, lost:
        haploop.record(rig, "latch", "P01", 5, tmp_path)
    recording = haploop.Recording.open(tmp_path / "P01-latch.h5")
    assert not recording.complete
    (event,) = [event for event in recording.events if event.kind == "error"]
    assert "an overrun" in event.text or "lost or damaged" in event.text
    assert recording.volts.shape[1] > 5 * recording.rate_hz


@pytest.mark.long
@pytest.mark.usefixtures("few_callbacks")
def test_the_papers_rig_on_a_sound_card_is_green_and_records(tmp_path):
    """As on NI's cards. All the way to a recalibration goes the rig no-ni, in test_shipped_rigs.py."""
    with haploop.open_rig(CARD, simulate="twin") as rig:
        assert {finding.status for finding in haploop.examine(rig)} == {"green"}
        recording = haploop.record(rig, "latch", "P01", 2, tmp_path)
    assert recording.rate_hz == 48_000 and recording.header.daq == "Sound card (twin)"
    assert len(recording.accepted) == 2
