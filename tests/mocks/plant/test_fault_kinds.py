"""A package from outside adds a kind of fault; a broken one stops nobody who does not ask for it."""

import re
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError
from haploop.instruments import load_rig_file, open_rig
from haploop.instruments.rig.json_schema import rig_schema
from haploop.mocks.plant import KINDS, fault_class

GUIDE = (Path(__file__).parents[3] / "docs" / "reference" / "faults.md").read_text(encoding="utf-8")
BLOCKS = dict(re.findall(r"^```\w+\n# (\S+)\n(.*?)^```$", GUIDE, re.MULTILINE | re.DOTALL))
HUM = {"kind": "acme-hum", "channel": "gauge0", "after": 0.5, "duration": 1.0}

Install = Callable[..., None]


@pytest.fixture
def install(install_package: Install) -> Install:
    """Install a package of one module that gives one kind of fault."""
    return partial(install_package, "faults", package="acme-faults")


@pytest.fixture
def hum(install: Install) -> None:
    """The package that docs/reference/faults.md shows."""
    assert 'acme-hum = "acme_faults:MainsHum"' in BLOCKS["pyproject.toml"]
    install("acme-hum", "acme_faults", BLOCKS["acme_faults.py"], "MainsHum")


@pytest.mark.usefixtures("hum")
def test_the_guides_kind_acts_on_schedule_and_says_so(open):
    def listened(faults, begin):
        rig = open("haptable", faults=faults)
        rig.clock.sleep(begin - rig.clock.now())
        with rig.daq.stream(("gauge0", "gauge1"), 5000, 500, 1000) as stream:
            volts = stream.capture().volts
        told.append([(fault.kind, fault.fired, fault.at) for fault in rig.simulation.faults])
        return volts

    told: list[object] = []
    humming, still = listened([HUM], 1.0), listened([], 1.0)
    t = 1.0 + np.arange(1000) / 5000
    added = humming[0] - still[0]
    assert np.abs(added - 0.1 * np.sin(2 * np.pi * 50 * t)).max() < 2e-3, "half a code of either converter"
    assert np.array_equal(humming[1], still[1])
    assert np.array_equal(listened([HUM], 0.1), listened([], 0.1))
    assert told == [[("acme-hum", 1, [0.5])], [], [("acme-hum", 0, [])], []]


@pytest.mark.usefixtures("hum")
@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"volt": 1}, "unknown key 'volt'; did you mean 'volts'"),
        ({"volts": -1}, "above 0"),
        ({"channel": "gauge9"}, "kind 'acme-hum' names the channel 'gauge9'"),
    ],
)
def test_its_settings_are_checked_like_any_others(change, says):
    with pytest.raises(ConfigurationError, match=says):
        open_rig("haptable", simulate="twin", simulation={"faults": [HUM | change]})


@pytest.mark.usefixtures("hum")
def test_it_is_known_by_name_and_in_the_editor():
    assert "acme-hum" in KINDS
    with pytest.raises(ConfigurationError, match="did you mean 'acme-hum'"):
        open_rig("haptable", simulate="twin", simulation={"faults": [HUM | {"kind": "acme-hun"}]})
    faults = rig_schema()["$defs"]["SimulationSettings"]["properties"]["faults"]
    assert "acme-hum" in faults["items"]["properties"]["kind"]["enum"]


NO_FAULT = "The fault 'acme-bad' of the package acme-faults is not a fault"
NO_CLASS = "The fault 'acme-bad' of the package acme-faults must be a class"
BROKEN = [
    ("1 / 0", "Bad", r"acme-faults cannot be loaded \(ZeroDivisionError"),
    ("class Bad: ...", "Bad", NO_FAULT),
    ("from haploop.mocks.plant import Fault\nBad = Fault.__new__(Fault)", "Bad", NO_CLASS),
    ("from haploop.mocks.plant import Fault\nclass Bad(Fault):\n  Settings = dict", "Bad", NO_FAULT),
    ("from haploop.mocks.plant import OnLaser\nclass Bad(OnLaser):\n  def channel(self, *a): ...", "Bad",
     r"acme-faults has the hook 'channel', and nobody calls it: derive Bad from .*\.OnCards too"),
]  # fmt: skip


@pytest.mark.parametrize(("source", "value", "says"), BROKEN)
def test_a_broken_kind_is_one_sentence_that_names_its_package(run, install, source, value, says, tmp_path):
    install("acme-bad", "acme_bad", source, value)
    path = tmp_path / "rig.toml"
    path.write_text('base = "haptable"\n[[simulation.faults]]\nkind = "acme-bad"\n')
    with pytest.raises(ConfigurationError, match=says):
        load_rig_file(path)
    if source == "1 / 0":
        run("doctor --rig", path, "--simulate", "twin", says="acme-faults")


@pytest.mark.parametrize("source", ["1 / 0", "Bad = 3"])
def test_a_broken_kind_is_in_the_way_of_nobody_else(install, source, tmp_path):
    install("acme-bad", "acme_bad", source, "Bad")
    path = tmp_path / "rig.toml"
    path.write_text('base = "haptable"\n[[simulation.faults]]\nkind = "patch-dead"\n')
    with open_rig(path, simulate="twin") as rig:
        assert [fault.kind for fault in rig.simulation.faults] == ["patch-dead"]
    assert "acme_bad" not in sys.modules
    with pytest.raises(ConfigurationError, match="did you mean 'patch-dead'"):
        open_rig("haptable", simulate="twin", simulation={"faults": [{"kind": "patch-ded"}]})
    faults = rig_schema()["$defs"]["SimulationSettings"]["properties"]["faults"]
    assert "patch-dead" in faults["items"]["properties"]["kind"]["enum"]


def test_a_name_of_haploops_own_is_refused(install):
    install("mains-hum", "acme_faults", BLOCKS["acme_faults.py"], "MainsHum")
    with pytest.raises(
        ConfigurationError, match="'mains-hum' of the package acme-faults has the name of one"
    ):
        open_rig("haptable", simulate="twin", simulation={"faults": [HUM | {"kind": "mains-hum"}]})


def test_every_kind_of_haploops_own_is_a_fault():
    assert len(KINDS) >= 37
    assert [kind for kind in KINDS if not (fault_class(kind).__doc__ or "").strip()] == []


IDLE = """
from haploop.mocks.plant import Fault, FaultSettings

class Idle(Fault):
    class Settings(FaultSettings):
        device: int = 3
"""


def test_a_fault_without_hooks_changes_nothing(install, open):
    # Its setting `device` is no name of a card, and is none of haploop's business.
    install("acme-none", "acme_none", IDLE, "Idle")

    def listened(faults):
        with open("haptable", faults=faults).daq.stream(("gauge0", "laser"), 5000, 500, 1000) as stream:
            return stream.capture().volts

    assert np.array_equal(listened([{"kind": "acme-none"}]), listened([]))
