"""Boards as labs have them: what their twins show is recorded, and what is refused is named."""

import numpy as np
import pytest

import haploop
from haploop.acquisition import find_presses
from haploop.base.clock import VirtualClock
from haploop.calibration.self_test.sensor_test import check_noise
from haploop.instruments import load_rig_file
from haploop.instruments.daq.serial_codec import Column, Framing, SerialSettings
from haploop.instruments.live.tap import levels
from haploop.mocks.daq.serial_adc import Board
from tests.acquisition.presses.pressworld import world_rig
from tests.rows import thinned

File = haploop.instruments.RigFile


def contact_of_five_volts(file: File) -> File:
    """A 5 V contact on an input of +-5 V."""
    return _channel(file, "switch", 5.0)


def dc_accelerometer(file: File) -> File:
    """Nothing is stated of what it passes."""
    raw = file.model_dump(mode="json")
    raw["sensors"]["acceleration"]["transfer"] = {}
    return File.model_validate(raw)


def _channel(file: File, name: str, range_: float) -> File:
    raw = file.model_dump(mode="json")
    raw["daq"]["channels"][name]["range"] = range_
    return File.model_validate(raw)


@pytest.mark.parametrize("button", thinned(["latch", "toggle", "push"], 3))
@pytest.mark.parametrize("board", [contact_of_five_volts, dc_accelerometer])
def test_an_ordinary_board_is_accepted(board, button, tmp_path):
    with haploop.open_rig(board(load_rig_file("simulated"))) as rig:
        with rig.tap() as tap:
            found = haploop.record(rig, button, "P01", 5, out=tmp_path)
            blocks = [tap.take(1.0) for _ in range(20)]
        assert len(found.accepted) == len(found.verdicts) == 5
        assert not any(press.saturated for press in find_presses(found))
        assert not found.saturated_in(slice(None))
        assert not any(level.overload for block in blocks if block for level in levels(block))
        noise = {finding.name: finding for finding in check_noise(rig)}
        assert noise["Noise floor of switch"].status == "green"


def test_a_sensor_at_the_end_of_its_range_is_named(tmp_path):
    """Of the latch's 8 N, a gauge shows more than its channel takes."""
    file = _channel(load_rig_file("simulated"), "gauge2", 0.05)
    beyond = pytest.raises(haploop.HaploopError, match="force sensor left its range")
    with haploop.open_rig(file) as rig, beyond:
        haploop.record(rig, "latch", "P01", 1, out=tmp_path)


@pytest.mark.parametrize(("frame", "column", "digit"), [
    ({"separator": ",", "columns": 2}, {"scale": 1.0, "range": 5.0}, 1e-4),
    ({"separator": ",", "columns": 2, "decimals": 2}, {"scale": 1.0, "range": 5.0}, 0.01),
    ({"separator": ",", "columns": 2, "decimals": 1}, {"scale": 1e-3, "range": 5.0}, 0.1),
    ({"separator": ",", "columns": 2}, {"scale": 20e-3 / 2**23, "range": 0.02}, 1.0),
    ({"separator": ",", "columns": 2}, {"scale": 5 / 1023, "range": 5.0}, 1.0),
    ({"struct": "<hh", "sync": "AA55"}, {"scale": 1.0, "range": 5.0}, 1.0),
    ({"struct": "<ff", "sync": "AA55"}, {"scale": 1.0, "range": 5.0}, 1e-4),
])  # fmt: skip
def test_a_board_prints_its_digits(frame, column, digit):
    """The twin's values, as volts, are off by a digit and its noise; no more."""

    class Wire:
        clock = VirtualClock()

        def rng(self, name: str) -> np.random.Generator:
            return np.random.default_rng(1)

        def sample_by(self, name: str, by: str) -> None: ...

        def read(self, names: list[str], times: np.ndarray) -> np.ndarray:
            return np.asarray(0.3 * column["range"] * np.sin(20 * times))

    settings = SerialSettings(
        port="x", rate_hz=500, frame=Framing(**frame), channels={"cell": Column(column=1, **column)}
    )
    assert settings.digit(settings.channels["cell"]) == pytest.approx(digit)
    board = Board(settings, Wire())
    numbers = np.arange(400.0)
    times = numbers / 500
    printed = board._columns(numbers, times)[0]
    true = 0.3 * column["range"] * np.sin(20 * times) / column["scale"]
    assert np.abs(printed - true).max() < 3 * digit
    assert np.abs(printed / digit - np.rint(printed / digit)).max() < 1e-6


def test_what_was_accepted_as_it_was_recorded_is_not_judged_again(tmp_path):
    """A fan that stopped behind the session's rest spoils no press: the rest before each one is quiet."""
    rig = world_rig(seed=3)
    volts, began, rng = rig.daq.world.volts, rig.clock.now(), np.random.default_rng(4)

    def blown(channel: str, t: np.ndarray) -> np.ndarray:
        fan = 0.2 * rng.standard_normal(len(t)) * (t < began + 0.5)
        return np.asarray(volts(channel, t) + (fan if channel.endswith("z") else 0))

    rig.daq.world.volts = blown
    found = haploop.record(rig, "push", "P01", 4, out=tmp_path)
    assert len(found.accepted) == 4
    pressed = haploop.representative([found], method="mean")
    assert pressed.members == 4
    assert len(pressed.left_out) == len(found.verdicts) - 4  # what the session refused, and said
