"""What a rig file says is what was opened: nobody changes it in the program."""

from __future__ import annotations

import copy
import pickle
from types import SimpleNamespace
from typing import Any

from pydantic import BaseModel, ConfigDict

from haploop.base.errors import ConfigurationError
from haploop.instruments import AnalogChannel, RigFile, load_rig_file, open_rig
from haploop.instruments.config import Device
from haploop.instruments.driver import settings_of
from haploop.instruments.frozen import FrozenDict, frozen
from tests.raising import raises


def test_the_dictionaries_of_an_open_rig_are_frozen():
    with open_rig("simulated", simulate="twin") as rig:
        digest = rig.file.digest
        daq, table = rig.file.daq, rig.file.table
        channels = daq.settings["channels"]
        for change in (
            lambda: channels.update(x=1),
            channels[next(iter(channels))].clear,
            lambda: daq.model_extra.pop("channels"),
            lambda: rig.sensors.extra.setdefault("x", AnalogChannel(channel="x")),
            lambda: table.patch_places.__setitem__("A", (0.0, 0.0)),
        ):
            raises(ConfigurationError, "cannot be changed in the program", change)
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


class Inner(BaseModel):
    outputs: list[str]


class Settings(BaseModel):
    """Of a driver of another package."""

    model_config = ConfigDict(frozen=True)

    outputs: list[str]
    named: dict[str, list[Inner]]
    used: set[str]


def test_every_collection_in_the_settings_of_any_driver_is_frozen():
    table = {"outputs": ["a", "b"], "named": {"x": [{"outputs": ["a"]}]}, "used": ["a"]}
    driver: Any = SimpleNamespace(Settings=Settings)
    found = settings_of(driver, Device(driver="other", **table), "daq", "lab")
    for outputs in (found.outputs, found.named["x"], found.named["x"][0].outputs):
        before = list(outputs)
        for change in (
            lambda one: one.clear(), lambda one: one.append("c"), lambda one: one.pop(),
            lambda one: one.remove(one[0]), lambda one: one.extend("c"), lambda one: one.insert(0, "c"),
            lambda one: one.sort(), lambda one: one.reverse(), lambda one: one.__setitem__(0, "c"),
            lambda one: one.__delitem__(0), lambda one: one.__iadd__(["c"]), lambda one: one.__imul__(0),
        ):  # fmt: skip
            raises(ConfigurationError, "cannot be changed in the program", change, outputs)
        assert outputs == before and type(copy.deepcopy(outputs)) is list
    for change in (
        lambda one: one.clear(), lambda one: one.add("b"), lambda one: one.discard("a"),
        lambda one: one.update("b"), lambda one: one.__ior__({"b"}), lambda one: one.__isub__({"a"}),
    ):  # fmt: skip
        raises(ConfigurationError, "cannot be changed in the program", change, found.used)
    assert found.used == {"a"} and type(copy.copy(found.used)) is set
    assert found.model_dump(mode="json") == table
