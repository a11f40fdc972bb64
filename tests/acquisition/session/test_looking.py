"""Sensors are looked at before anything is recorded: every channel is live, and no file is made."""

import pytest

import haploop
from haploop.base.errors import ConfigurationError
from haploop.instruments import levels


def test_every_sensor_and_the_laser_are_live(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with haploop.open_rig("simulated") as rig, rig.tap(100) as tap:
        haploop.acquisition.look(rig, iter([True] * 20 + [False]).__next__)
        blocks = [tap.take(0.0) for _ in range(21)]
        assert tap.take(0.0) is None
    assert [block.first for block in blocks if block] == list(range(0, 21 * 200, 200))
    first = blocks[0]
    assert first is not None and first.run.doing == "look"
    names = {level.name for level in levels(first)}
    assert {"Fz", "acceleration z", "activation", "drive at the patch", "velocity"} <= names
    assert list(tmp_path.iterdir()) == []


def test_a_rig_without_sensors_is_told_to_describe_them(tmp_path):
    bare = tmp_path / "bare.toml"
    bare.write_text(
        'name = "bare"\nsimulate = "twin"\n[daq]\ndriver = "ni-daqmx"\ndevices = { Dev1 = "PCIe-6321" }\n'
        '[daq.channels]\na = { terminal = "Dev1/ai0", range = 5, config = "rse" }\n',
        encoding="utf-8",
    )
    told = pytest.raises(ConfigurationError, match=r"has no sensors: describe them in \[sensors\]")
    with haploop.open_rig(bare) as rig, told:
        haploop.acquisition.look(rig)
