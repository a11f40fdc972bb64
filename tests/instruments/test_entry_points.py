"""Roles and drivers of other packages: found by entry point, and broken ones told in one sentence."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.instruments import Rig, load_rig_file, open_rig
from haploop.instruments.config import roles
from haploop.instruments.interlock import Interlocked
from haploop.instruments.rig import rig_schema
from tests.raising import raises, raising

LAMP = """
from abc import ABC, abstractmethod
from pydantic import BaseModel, ConfigDict

LOG = []

class Lamp(ABC):
    identity = "ACME lamp"
    arithmetic = True
    @abstractmethod
    def light(self, share): ...

class AcmeLamp(Lamp):
    class Settings(BaseModel):
        model_config = ConfigDict(frozen=True, extra="forbid")
        port: str
    @classmethod
    def open(cls, settings, clock):
        LOG.append(f"open {settings.port}")
        return cls()
    def light(self, share):
        LOG.append(f"light {share}")
    def make_safe(self):
        LOG.append("safe")
    def close(self):
        LOG.append("close")

class NoSettings(Lamp):
    @classmethod
    def open(cls, settings, clock): ...

def wrong_twin(settings, plant):
    return "no lamp"

class Other:
    pass

an_instance = AcmeLamp()
raise_when = {}
"""

Package = Callable[..., Any]


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Package:
    """Installs a package: its name, the code of its module, and its entry points by group."""
    site = tmp_path / "site"
    site.mkdir()
    monkeypatch.syspath_prepend(site)
    monkeypatch.setenv("PYTHONPATH", str(site))

    def install(name: str, code: str, **groups: dict[str, str]) -> Any:
        module = name.replace("-", "_")
        (site / f"{module}.py").write_text(code, encoding="utf-8")
        about = site / f"{module}-1.0.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        lines = [
            f"[haploop.{group}]\n" + "".join(f"{key} = {module}:{value}\n" for key, value in points.items())
            for group, points in groups.items()
        ]
        (about / "entry_points.txt").write_text("\n".join(lines))
        monkeypatch.delitem(sys.modules, module, raising=False)
        return module

    return install


def acme(package: Package, code: str = LAMP, **groups: Any) -> Any:
    """The lamp's module, once it is installed; other entry points or code, if they are given."""
    points = {"roles": {"lamp": "Lamp"}, "drivers": {"acme-lamp": "AcmeLamp"}} | groups
    return __import__(package("acme-lamp", code, **points))


@pytest.fixture
def lamp(package: Package) -> Any:
    return acme(package)


LAMPS = '[lamp]\ndriver = "acme-lamp"\nport = "COM9"\n'


def rig_file(folder: Path, text: str = LAMPS) -> Path:
    path = folder / "rig.toml"
    path.write_text(f'base = "simulated"\n{text}', encoding="utf-8")
    return path


@pytest.fixture
def connected(lamp: Any, tmp_path: Path) -> Iterator[Rig]:
    """A rig with the lamp, whose relay is closed."""
    rig = open_rig(rig_file(tmp_path))
    rig.relay.connect(["A"])
    yield rig
    rig.close()


def test_haploops_own_roles_are_entry_points_in_the_order_of_opening():
    own = ("daq", "amplifier", "relay", "vibrometer", "generator", "player", "operator")
    assert [role for role in roles() if role in own] == list(own)


def test_a_role_from_outside_is_validated_opened_made_safe_and_closed(lamp, tmp_path):
    path = rig_file(tmp_path)
    with open_rig(path) as rig:
        assert list(rig.instruments)[-1] == "lamp"
        rig.role(lamp.Lamp).light(0.5)
    assert lamp.LOG == ["open COM9", "light 0.5", "safe", "close"]


@pytest.mark.parametrize("mode", ["twin", "wire"])
@pytest.mark.parametrize("says", ["", "    arithmetic = False", "    arithmetic = 'no'"])
def test_a_simulation_opens_only_twins(package, tmp_path, mode, says):
    """It used to be opened as it is, and its outputs written, while everything was said to be simulated."""
    lamp = acme(package, LAMP.replace("    arithmetic = True", says))
    path = rig_file(tmp_path)
    with pytest.raises(ConfigurationError, match=rf"The lamp .* 'acme-lamp' has no {mode}, and would open"):
        open_rig(path, simulate=mode)
    assert lamp.LOG == []


def test_a_simulation_opens_no_driver_whose_wire_says_no_address(package, tmp_path):
    code = LAMP.replace("    arithmetic = True", "") + (
        "\nfrom contextlib import nullcontext\ndef wire(settings, plant):\n    return nullcontext({})\n"
    )
    lamp, path = acme(package, code, wires={"acme-lamp": "wire"}), rig_file(tmp_path)
    for mode, says in (
        ("twin", r"has no twin, and would open .* or simulate as wire"),
        ("wire", "The wire of 'acme-lamp' replaces no setting"),
    ):
        raises(ConfigurationError, says, open_rig, path, simulate=mode)
    assert lamp.LOG == []


stuck = raising(InstrumentError("The lamp is stuck."))
dead = raising(RuntimeError("The line is dead."))
leaving = raising(SystemExit("The vendor's library ends the program."))


@pytest.mark.parametrize(("broken", "says"), [
    (stuck, "confirmed: The lamp is stuck"), (property(dead), "confirmed"), (leaving, "confirmed"),
])  # fmt: skip
def test_whatever_a_safe_state_from_outside_does_the_relay_opens(connected, lamp, monkeypatch, broken, says):
    monkeypatch.setattr(lamp.AcmeLamp, "make_safe", broken)
    raises(InstrumentError, f"The safe state was not {says}", connected.make_safe)
    assert connected.relay.connected() == frozenset()
    monkeypatch.undo()


@pytest.mark.parametrize("volts", [False, True])
def test_only_what_puts_out_volts_is_made_safe_before_the_relay_opens(lamp, tmp_path, monkeypatch, volts):
    kind = type("Source", (Interlocked, lamp.AcmeLamp), {}) if volts else lamp.AcmeLamp
    monkeypatch.setattr(lamp.AcmeLamp, "open", lambda _settings, _clock: kind())
    rig = open_rig(rig_file(tmp_path))
    rig.relay.connect(["A"])
    connected: list[frozenset[str]] = []
    monkeypatch.setattr(lamp.AcmeLamp, "make_safe", lambda _self: connected.append(rig.relay.connected()))
    rig.make_safe()
    assert connected == [frozenset("A" if volts else "")]
    rig.close()


def test_an_identity_may_hang_later(connected, lamp, monkeypatch):
    monkeypatch.setattr(lamp.AcmeLamp, "identity", property(dead))
    connected.make_safe()
    assert connected.relay.connected() == frozenset()


@pytest.mark.parametrize("error", [ValueError("two\nlines"), SystemExit("bye")])
def test_a_driver_from_outside_that_cannot_be_opened_or_closed_is_named(lamp, tmp_path, monkeypatch, error):
    fail = raising(error)
    path = rig_file(tmp_path)
    monkeypatch.setattr(lamp.AcmeLamp, "close", fail)
    rig = open_rig(path)
    raises(InstrumentError, type(error).__name__, rig.close)
    monkeypatch.setattr(lamp.AcmeLamp, "open", fail)
    raises(InstrumentError, r"'acme-lamp' of the package acme-lamp failed to open", open_rig, path)


def test_a_rig_without_the_role_says_so(lamp):
    with open_rig("simulated") as rig, pytest.raises(ConfigurationError, match=r"has no \[lamp\]"):
        rig.role(lamp.Lamp)


def test_a_role_need_not_be_called_like_its_class(package, tmp_path):
    lamp = acme(package, roles={"beam": "Lamp"})
    with open_rig(rig_file(tmp_path, '[beam]\ndriver = "acme-lamp"\nport = "COM9"\n')) as rig:
        assert rig.role(lamp.Lamp) is rig.instruments["beam"]


def test_roles_with_unfortunate_names_stop_no_other_rig(package):
    roles = dict.fromkeys(("table", "name", "devices", "digest", "model_dump"), "Lamp")
    acme(package, roles=roles)
    with open_rig("simulated") as rig:
        assert not set(roles) & set(rig.instruments)


def test_the_schema_has_its_table(lamp):
    schema = rig_schema()
    assert schema["properties"]["lamp"]["properties"]["driver"]["enum"] == ["acme-lamp"]
    assert schema["additionalProperties"] is False
    assert "$comment" not in schema


BROKEN = {
    "gone": ("import no_such_library\n", "AcmeLamp", "no_such_library"),
    "raises": ("raise RuntimeError('two\\nlines')\n", "AcmeLamp", "RuntimeError: two lines"),
    "exits": ("raise SystemExit('bye')\n", "AcmeLamp", "SystemExit: bye"),
    "syntax": ("def (\n", "AcmeLamp", "SyntaxError"),
    "no such name": (LAMP, "Nobody", "Nobody"),
    "an instance": (LAMP, "an_instance", "must be a class or a function, and is an object of AcmeLamp"),
    "a function": (LAMP, "wrong_twin", "must be a class, and is an object of function"),
    "no driver": (LAMP, "Other", "must have a class Settings"),
    "no settings": (LAMP, "NoSettings", "must have a class Settings"),
}


@pytest.mark.parametrize(("code", "named", "says"), BROKEN.values(), ids=BROKEN)
def test_a_broken_driver_is_one_sentence_for_its_rig(package, tmp_path, code, named, says):
    package("acme-broken", code, drivers={"broken": named})
    path = rig_file(tmp_path, '[relay]\ndriver = "broken"\n')
    said = raises(ConfigurationError, "the package acme-broken", load_rig_file, path)
    assert says in said and "\n" not in said


@pytest.mark.parametrize("named", ["Nobody", "an_instance", "wrong_twin"])
def test_a_broken_role_is_one_sentence_for_its_rig(package, tmp_path, named):
    acme(package, roles={"lamp": named})
    says = "cannot be loaded" if named == "Nobody" else "must be a class"
    with pytest.raises(ConfigurationError, match=f"The role 'lamp' of the package acme-lamp .*{says}"):
        load_rig_file(rig_file(tmp_path))


def test_what_is_broken_stops_no_other_rig(package):
    for number, (code, named, _) in enumerate(BROKEN.values()):
        package(f"acme-{number}", code, drivers={f"broken-{number}": named})
    package("acme-role", LAMP, roles={"lamp": "Nobody"})
    with open_rig("simulated") as rig:
        assert isinstance(rig, Rig)
    schema = rig_schema()
    known = schema["properties"]["relay"]["properties"]["driver"]["enum"]
    assert not [name for name in known if "broken" in name]
    assert all(f"acme-{which}" in schema["$comment"] for which in (*range(len(BROKEN)), "role"))


def test_ctrl_c_leaves_no_half_of_a_package(package, tmp_path):
    """Half of a module stays when its import is interrupted; of some, the rest cannot be imported then."""
    stop = "import signal\nsignal.raise_signal(signal.SIGINT)\n"
    module = package("acme-lamp", stop + LAMP, roles={"lamp": "Lamp"}, drivers={"acme-lamp": "AcmeLamp"})
    path = rig_file(tmp_path)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        raises(KeyboardInterrupt, "", load_rig_file, path)
    finally:
        signal.signal(signal.SIGINT, before)
    assert hasattr(sys.modules[module], "raise_when")


@pytest.mark.parametrize(("text", "says"), [
    ('[lamp]\ndriver = "acme-lamp"\nprt = "COM9"\n',
     r"rig\.toml, line 4: unknown key 'lamp\.prt'; did you mean 'po"),
    ('[relay]\ndriver = "pdv-100"\n', "'pdv-100' of the package haploop is not for the role 'relay'"),
    ('[lmp]\ndriver = "acme-lamp"\n', r"line 2: unknown key 'lmp'; did you mean 'lamp'\? If another package"),
    ("zzz = 3\n", "line 2: unknown key 'zzz'; known keys are .*lamp"),
    ('lamp = "acme-lamp"\n', "line 2: lamp must be a table"),
    ('[lamp]\nport = "COM9"\n', r"line 2: the key 'lamp\.driver' is missing"),
])  # fmt: skip
def test_what_is_wrong_with_a_table_is_one_sentence(lamp, tmp_path, text, says):
    assert "\n" not in raises(ConfigurationError, says, load_rig_file, rig_file(tmp_path, text))


def test_two_packages_with_one_name_are_both_named(package, tmp_path):
    for name in ("acme-one", "acme-two"):
        package(name, LAMP, drivers={"twice": "AcmeLamp"})
    with pytest.raises(ConfigurationError, match="acme-one and acme-two is added more than once"):
        load_rig_file(rig_file(tmp_path, '[relay]\ndriver = "twice"\n'))


def test_a_twin_that_is_none_is_named(package, tmp_path):
    acme(package, twins={"acme-lamp": "wrong_twin"})
    with pytest.raises(ConfigurationError, match="'acme-lamp' opened is no lamp, but an object of str"):
        open_rig(rig_file(tmp_path))


def test_the_command_line_ends_with_2_and_a_sentence(package, tmp_path):
    package("acme-broken", "import no_such_library\n", drivers={"broken": "AcmeLamp"})
    path = rig_file(tmp_path, '[relay]\ndriver = "broken"\n')
    run = [sys.executable, "-m", "haploop"]
    bad = subprocess.run([*run, "doctor", "--rig", str(path)], capture_output=True, text=True, check=False)
    assert bad.returncode == 2, bad.stderr
    assert "Traceback" not in bad.stderr and "the package acme-broken" in " ".join(bad.stderr.split())
    schema = subprocess.run([*run, "schema"], capture_output=True, text=True, check=True)
    assert "acme-broken" in json.loads(schema.stdout)["$comment"]
