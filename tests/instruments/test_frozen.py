"""What a rig file says is what was opened: nobody changes it in the program."""

from __future__ import annotations

import copy
import pickle

import pytest

from haploop.instruments import AnalogChannel, ConfigurationError, RigFile, load_rig_file, open_rig
from haploop.instruments.frozen import FrozenDict, frozen


def test_the_dictionaries_of_an_open_rig_are_frozen():
    with open_rig("simulated", simulate="twin") as rig:
        digest = rig.file.digest
        daq, table = rig.file.daq, rig.file.table
        assert daq.model_extra is not None and table is not None
        channels = daq.settings["channels"]
        for change in (
            lambda: channels.update(x=1),
            channels[next(iter(channels))].clear,
            lambda: daq.model_extra.pop("channels"),
            lambda: rig.sensors.extra.setdefault("x", AnalogChannel(channel="x")),
            lambda: table.patch_places.__setitem__("A", (0.0, 0.0)),
        ):
            with pytest.raises(ConfigurationError, match="cannot be changed in the program"):
                change()
        daq.settings["channels"] = {}  # a copy
        assert rig.file.digest == digest


def test_a_frozen_file_is_written_read_and_copied_as_ever():
    file = load_rig_file("simulated")
    again = RigFile.model_validate_json(file.model_dump_json())
    assert again == file and again.digest == file.digest
    assert file.model_copy(deep=True) == file
    one = frozen({"a": [{"b": 1}]})
    assert type(one) is FrozenDict and type(one["a"][0]) is FrozenDict
    for other in (copy.deepcopy(one), copy.copy(one), pickle.loads(pickle.dumps(one))):
        assert other == one and type(other) is dict
        other["c"] = 1
