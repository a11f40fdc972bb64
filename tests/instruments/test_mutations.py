"""Whatever a notebook writes to what it can reach: no volts too many at a patch, and the safe state.

Everything is walked that an open rig shows under public names, at any depth. Each thing is assigned to,
deleted or cleared, past pydantic's own freezing too; then the rig plays, meets another program's volts, and
closes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict

from haploop.base.errors import ConfigurationError
from haploop.instruments import Rig, RigFile, Sweep, load_rig_file, open_rig
from haploop.instruments.amplifier.analog import AnalogAmplifier
from haploop.instruments.config.rig_file import AbortLimits, Device, SimulationSettings
from haploop.instruments.limits import Limits
from haploop.instruments.rig import opening
from haploop.instruments.rig import rig as rigs
from haploop.instruments.rig.roles import ratings
from haploop.instruments.safety import Outputs
from haploop.instruments.safety.audit import entries
from haploop.mocks.daq.twin import DaqTwin
from haploop.mocks.plant import AMPLIFIER_GAIN_ERROR
from haploop.nidaqmx_twin.nodes import Run
from tests.raising import raises
from tests.rig_files import changed
from tests.rows import thinned

pytestmark = pytest.mark.usefixtures("unproved", "few_callbacks")

CODE = 0.06
"""V that a code of a card makes at a patch."""
FOREIGN = 8.0
"""V that another program leaves on an output: 400 V behind the amplifier."""
TWO_BLOCKS = 0.25
"""Longest time (s) for which what is wrong with an amplifier may reach a patch."""
STRIDE = 131
"""Of so many mutations one is tried; all of them with --full."""

load = cache(load_rig_file)


def with_generator() -> RigFile:
    """A rig whose DAQ output and generator meet at the amplifier's one input."""
    box = {"resource": "TCPIP::127.0.0.1::5025::SOCKET", "output": "amplifier", "highest": 5.0}
    return changed(load("simulated"), generator=Device(driver="keysight-33500", **box))


def too_high(**abort: float) -> RigFile:
    """A rig whose amplifier has twice the gain of its rig file: abort limits stop what it plays."""
    fault = {"kind": "amplifier-gain", "gain": 100.0}
    file = changed(load("simulated"), simulation=SimulationSettings(faults=(fault,)))
    return changed(file, abort=AbortLimits(**abort))


RIGS: dict[str, Callable[[], RigFile]] = {
    **{
        name: partial(load, name)
        for name in ("simulated", "four-channel", "sound-card", "voice-coil", "no-ni")
    },
    "generator": with_generator,
    "gain": too_high,
    "motion": lambda: too_high(drive=1e4, drive_source="a test", velocity=1e-3),
}

# What is changed, and how

Step = tuple[str, Any]
"""How to come from a thing to what it has: an attribute, or an item."""


def steps(thing: Any) -> list[Step]:
    """All that a thing shows."""
    if isinstance(thing, dict | list | tuple):
        return [("item", key) for key in (thing if isinstance(thing, dict) else range(len(thing)))]
    if isinstance(thing, Rig):
        roles = [("attribute", role) for role in thing.instruments if role != "adc"]
        shown = ("file", "audit", "hardware", "mode", "clock", "sensors", "table")
        return [*roles, *(("attribute", name) for name in shown)]
    if not type(thing).__module__.startswith("haploop.") or not hasattr(thing, "__dict__"):
        return []
    names = {**vars(thing), **dict.fromkeys(("settings", "inputs", "folder"))}
    names.pop("box", None)  # of a twin: that is the simulated world itself
    return [("attribute", name) for name in names if not name.startswith("_") and hasattr(thing, name)]


def follow(thing: Any, path: tuple[Step, ...]) -> Any:
    for how, key in path:
        thing = thing[key] if how == "item" else getattr(thing, key)
    return thing


def paths(thing: Any, before: tuple[Step, ...] = ()) -> Iterator[tuple[Step, ...]]:
    for step in steps(thing):
        path = (*before, step)
        yield path
        if len(path) < 8 and path[-1] != ("attribute", "clock"):
            yield from paths(follow(thing, (step,)), path)


def other(value: Any, large: bool) -> Any:
    """Another value: a larger or a smaller one where it is a number."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return type(value)(value * 100 + 1 if large else value / 100)
    if isinstance(value, dict):
        return {} if large else {"elsewhere": next(iter(value.values()), None)}
    if isinstance(value, tuple | list | set | frozenset):
        return type(value)(() if large else list(value)[:1])
    return "elsewhere" if isinstance(value, str) and large else None


def change(rig: Rig, path: tuple[Step, ...], how: str) -> None:
    """Change what is at the end of a path. Raises for what is refused."""
    *before, (kind, key) = path
    owner, value = follow(rig, tuple(before)), follow(rig, path)
    new = other(value, large="larger" in how)
    if how == "cleared":
        value.clear()
    elif how.startswith("forced"):
        vars(owner)[key] = new
    elif how == "deleted":
        owner.__delitem__(key) if kind == "item" else delattr(owner, key)
    else:
        owner.__setitem__(key, new) if kind == "item" else setattr(owner, key, new)


HOW = ("larger", "smaller", "forced larger", "forced smaller", "deleted", "cleared")
PAST_A_NAME: dict[str, Callable[[Rig], object]] = {
    "the amplifier's limits": lambda r: setattr(r.amplifier, "limits", lambda _patches: Limits()),
    "the amplifier's conversion": lambda r: setattr(r.amplifier, "to_input", lambda drive: drive / 5),
    "the amplifier's own settings": lambda r: vars(r.amplifier._settings).update(gain=5.0),
    "all limits": lambda r: (
        vars(r.relay).update(rating=400.0),
        vars(r.file.limits).update(max=400.0, min=-400.0, peak_to_peak=800.0, slew=1e9),
    ),
    "where the generator leads": lambda r: vars(r.generator).update(output="elsewhere"),
    "what the relay has": lambda r: vars(r.relay).update(patches=()),
    "another file": lambda r: vars(r).update(file=load("four-channel")),
    "another amplifier": lambda r: vars(r).update(amplifier=None),
}


def mutations(rig: Rig) -> dict[str, Callable[[Rig], object]]:
    """Each change of an open rig, by its name. One that is refused raises."""
    named = {".".join(str(key) for _, key in path): path for path in paths(rig)}
    return PAST_A_NAME | {
        f"{name} {how}": partial(change, path=path, how=how) for name, path in named.items() for how in HOW
    }


# What comes of it


class Trial:
    """An open rig, and what is known of it from its file and not from what is changed."""

    def __init__(self, name: str) -> None:
        self.rig = open_rig(RIGS[name](), simulate="twin")
        self.file, self.limits, self.direct = self.rig.file, self.rig.limits, self.rig.file.wiring == "direct"
        self.world, self.clock, self.folder = self.rig.simulation, self.rig.clock, self.rig.audit.folder
        self.record, self.wrong = self.world.truth.record(), name in ("gain", "motion")
        self.patches, self.instruments = self.file.table.patches[:1], dict(self.rig.instruments)

    def run(self, change: Callable[[Rig], object], connected: bool = False) -> list[str]:
        """Change, play, meet another program's volts, and close; what is wrong then."""
        if connected:
            self.connect()
        with suppress(Exception):
            change(self.rig)
        for play in self.plays():
            with suppress(Exception):
                play()
        if not self.direct and not self.world.truth.closed:
            self.leave_volts()
            self.connect()
        with suppress(Exception):
            self.rig.close()
        return self.problems()

    def connect(self) -> None:
        with suppress(Exception):
            self.rig.relay.connect(self.patches)
            self.clock.sleep(0.05)

    def plays(self) -> Iterator[Callable[[], object]]:
        """What is allowed, and what is not."""
        rig, peak, rate_hz = self.rig, self.limits.peak, self.file.table.rate_hz
        t = np.arange(round((0.5 if self.wrong else 0.04) * rate_hz)) / rate_hz
        tone = peak * np.sin(2 * np.pi * 250 * t) * np.hanning(len(t))
        channels = self.file.sensors.drive.channels
        for share in (0.9, 2.0):
            yield lambda share=share: rig.excite(share * tone, self.patches, channels)
        yield lambda: rig.generate(Sweep(50, 400, 0.05, 2.0 * peak), self.patches, channels)

    def leave_volts(self) -> None:
        """Another program leaves volts on each output, and somebody switches the generator on."""
        self.world.plant.advance(self.clock.now())
        for terminal in self.instruments["daq"]._outputs.values():
            terminal.play(Run(self.clock.now(), np.inf, np.array([FOREIGN])))
        if "generator" in self.instruments:
            self.instruments["generator"]._line.send("FUNC SIN;:FREQ 100;:VOLT 6;:OUTP ON")

    def problems(self) -> list[str]:
        self.world.plant.advance(self.clock.now())
        most = self.limits.peak * (1 + AMPLIFIER_GAIN_ERROR) + CODE
        if self.wrong:
            loud = [o for o in self.record if o.closed and np.abs(o.volts).max() > most]
            lasted = sum(o.period * len(o.volts) for o in loud if np.isfinite(o.period))
            found = [f"{lasted:.2f} s beyond the limit"] if lasted > TWO_BLOCKS else []
        else:
            got = max((float(np.abs(o.volts).max()) for o in self.record if o.closed), default=0.0)
            found = [] if got <= most else [f"{got:.0f} V of {self.limits.peak:g}"]
        if self.world.truth.closed and not self.direct:
            found.append("left closed")
        if self.record and not abs(self.record[-1].volts[-1]) <= CODE:
            found.append("left with volts on the output")
        logged = {entry["rig_sha256"] for entry in entries(self.folder)}
        return found if logged == {self.file.digest} else [*found, "logged as another file"]


@pytest.mark.parametrize("name", thinned(RIGS, 3))
def test_no_mutation_plays_a_volt_too_many(name, full, tmp_path, monkeypatch):
    monkeypatch.setenv("HAPLOOP_STATE", str(tmp_path / "first"))
    with Trial(name).rig as rig:
        known = mutations(rig)
    chosen = list(known) if full else [*PAST_A_NAME, *list(known)[len(PAST_A_NAME) :: STRIDE]]
    assert len(known) > 1000 and len(chosen) > 15
    found = {}
    for number, what in enumerate(chosen):
        for connected in (False, True):
            monkeypatch.setenv("HAPLOOP_STATE", str(tmp_path / f"{number} {connected}"))
            if problems := Trial(name).run(known[what], connected):
                found[what] = problems
    assert not found


def asked_again(patch: pytest.MonkeyPatch) -> None:
    """Limits, gain and wiring are read anew for each play, of what a notebook has changed."""
    patch.setattr(rigs, "ReadOnce", lambda amplifier, _patches: amplifier)
    patch.setattr(Rig, "file", property(lambda rig: rig._file))
    patch.setattr(Outputs, "read_wiring", lambda _: None)
    read_once = Rig._read_once

    def read_always(rig: Rig) -> None:
        read_once(rig)
        rig._limiter.kept.of = lambda patches: ratings(rig._own, patches)

    patch.setattr(Rig, "_read_once", read_always)


@pytest.mark.parametrize(
    ("name", "what", "says"),
    [
        ("simulated", "all limits", "V of 48"),
        ("simulated", "the amplifier's own settings", "V of 48"),
        ("generator", "where the generator leads", "V of 48"),
        ("gain", "file.sensors.drive.ratio forced smaller", "s beyond the limit"),
    ],
)
def test_it_is_noticed_when_nothing_is_copied(name, what, says, monkeypatch):
    asked_again(monkeypatch)
    with Trial(name).rig as rig:
        change = mutations(rig)[what]
    assert says in " ".join(Trial(name).run(change))


# Drivers of other packages, which nobody here can copy


class Settings(BaseModel):
    model_config = ConfigDict(frozen=True)

    outputs: list[str]


def test_a_driver_that_shows_what_it_works_with_is_not_opened(monkeypatch):
    told = property(lambda _: Settings(outputs=["amplifier"]))
    monkeypatch.setattr(DaqTwin, "told", told, raising=False)
    raises(ConfigurationError, "shows 'told', in which a program could change", open_rig, "simulated")
    for value in ({}, [], set(), Settings(outputs=[])):
        raises(ConfigurationError, "'x'", opening._refuse_shown, "daq", SimpleNamespace(x=value), "acme-1")


def test_what_a_driver_shows_is_not_assigned_to_in_an_open_rig():
    with open_rig("simulated") as rig:
        for name, value in {"patches": (), "rating": 500.0, "dead_man": 1e6}.items():
            raises(ConfigurationError, f"'{name}' of an open rig's", setattr, rig.relay, name, value)


@pytest.mark.parametrize(
    "to_input", [lambda v: v / 50 + 0.1, lambda v: 0 * v, lambda v: v * abs(v) / 5000, lambda v: abs(v) / 50]
)
def test_an_amplifier_that_is_no_plain_gain_plays_nothing(monkeypatch, to_input):
    """Plays rest on one gain, read when the rig is opened."""
    monkeypatch.setattr(AnalogAmplifier, "to_input", lambda _self, drive: to_input(drive))
    with open_rig("simulated") as rig:
        drive = np.ones(1000)
        raises(ConfigurationError, "is no plain gain", rig.excite, drive, ["A"], ["laser"])
        assert rig.simulation.truth.peak == 0
