"""A rig without a relay: one actuator, always connected. Each sentence of safety.md about it has a test."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import haploop
from haploop.base.clock import RealClock
from haploop.base.entry_points import driver_class
from haploop.base.errors import ConfigurationError, InstrumentError, LimitError
from haploop.calibration.self_test import examine
from haploop.instruments import Rig, RigFile, load_rig_file, open_rig
from haploop.instruments.config.rig_file import AbortLimits
from haploop.instruments.daq.ni_daqmx import NiDaq
from haploop.instruments.relay import LOST
from haploop.instruments.safety.audit import entries
from haploop.mocks.simulation import Simulation
from tests.instruments.safety.foreign import held, leave
from tests.instruments.safety.lab import Lab
from tests.instruments.safety.lab import lab as a_lab
from tests.instruments.safety.test_other_clients import clients
from tests.raising import raises
from tests.rig_files import changed

RATE = 50_000
TONE = 0.8 * np.sin(2 * np.pi * 250 * np.arange(RATE // 2) / RATE) * np.hanning(RATE // 2)
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="signals to another program are POSIX")
FILE = load_rig_file("voice-coil")
MODES = pytest.mark.parametrize("mode", ["twin", "wire"])


def stands(rig: Rig) -> float:
    """Volts at the actuator, from the plant itself."""
    rig.clock.sleep(0.01)
    return abs(rig.simulation.truth.patch_voltages["A"])


def hardware(**changes: object) -> RigFile:
    return changed(FILE, simulate=None, **changes)


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Lab]:
    with a_lab(tmp_path, hardware()) as here:
        yield here


# From open to close


def test_outputs_are_held_from_open_to_close():
    with open_rig(FILE, simulate="wire") as rig, clients(rig) as (other,):
        play, open_all = (lambda: rig.excite(TONE, ["A"], ["drive"])), (lambda: rig.relay.connect([]))
        for act in (lambda: None, play, open_all, rig.make_safe, rig.daq.zero):
            act()
            assert not other.write(), "the output is ours"
            assert stands(rig) < 1e-3


@MODES
def test_what_another_program_left_is_at_zero_once_the_rig_is_open(mode):
    with open_rig(FILE, simulate=mode) as rig:
        rig.daq._let_go()
        leave(rig, "amplifier", 1.5)
        assert stands(rig) == pytest.approx(3.0, rel=0.02), "no relay lies between"
        rig._limiter.begin()
        assert stands(rig) < 1e-3
        found = [e["found"] for e in entries(rig.audit.folder) if e["kind"] == "connected"]
        assert found[-1] == {"amplifier": pytest.approx(1.5, abs=0.01)}


@MODES
def test_a_rig_whose_output_another_program_holds_is_not_opened(mode):
    with open_rig(FILE, simulate=mode) as rig:
        rig.daq._let_go()
        with (
            held(rig, "amplifier", 0.5),
            pytest.raises(InstrumentError, match=r"always connected, and .* not known to be at zero.*-50103"),
        ):
            rig._limiter.begin()


def test_one_actuator_on_one_amplifier():
    with pytest.raises(ConfigurationError, match=r"\[table\] names 2 patches: name one, or use a relay"):
        open_rig(changed(FILE, table={"patches": ("A", "B")}))


# Plays


def test_volts_for_no_patch_are_refused_because_the_actuator_would_get_them():
    with open_rig(FILE) as rig:
        for patches in ((), ("B",)):
            raises(LimitError, "reaches A in any case", rig.excite, TONE, patches, ["drive"])
        raises(ConfigurationError, "no patch 'B'", rig.relay.connect, ["B"])
        assert rig.simulation.truth.peak == 0
        rig.excite(0 * TONE, (), ["drive"])
        capture = rig.excite(TONE, ["A"], ["drive"])
        assert np.abs(2 * capture.volts).max() == pytest.approx(0.8, rel=0.02)
        assert stands(rig) < 1e-3 and rig.relay.connected() == {"A"}


@pytest.mark.usefixtures("unproved")
def test_a_trip_puts_zero_out_within_two_blocks_and_locks_out():
    with open_rig(changed(FILE, abort=AbortLimits(drive=0.3))) as rig:
        record = rig.simulation.truth.record()
        raises(InstrumentError, r"allows 0\.3 V", rig.excite, np.tile(TONE, 4), ["A"], ["drive"])
        assert stands(rig) < 1e-3
        sound = [r for r in record if len(r.volts) > 1]
        times = np.concatenate([r.start + r.period * np.arange(len(r.volts)) for r in sound])
        volts = np.concatenate([r.volts for r in sound])
        first = times[np.flatnonzero(np.abs(volts) > 0.3)[0]]
        assert times[np.flatnonzero(np.abs(volts) > 1e-3)[-1]] < first + 0.2
        raises(LimitError, "locked out", rig.excite, TONE, ["A"], ["drive"])
        assert not rig.daq.outputs_read()["amplifier"] > 2e-3


def test_a_gain_that_is_not_what_the_file_says_is_found_at_a_quarter_of_the_limit():
    with open_rig(FILE, simulation={"faults": [{"kind": "amplifier-gain", "gain": 8.0}]}) as rig:
        with pytest.raises(InstrumentError, match=r"when 0\.25 V were played to prove the gain"):
            rig.excite(TONE, ["A"], ["drive"])
        assert rig.simulation.truth.peak < 1.1 and rig.lockout is not None


# The coil's heat


def warm(watts: float) -> RigFile:
    return hardware(actuator={"watts": watts, "thermal_time": 20.0})


def warming(seconds: float) -> np.ndarray:
    """0.9 V: in 2 s they warm the coil by 0.005 W."""
    drive = 0.9 * np.sin(2 * np.pi * 250 * np.arange(round(seconds * RATE)) / RATE)
    drive[-1] = 0.0
    return drive


def test_a_coil_stays_warm_from_one_program_to_the_next(here):
    """A play that a cold coil takes is refused to a warm one, and taken again once it has cooled."""
    drive, file = warming(2.0), warm(0.012)
    plays = 0
    for _ in range(4):
        with open_rig(file) as rig:
            try:
                rig.excite(drive, ["A"], ["drive"])
                plays += 1
            except LimitError as error:
                told = str(error)
                assert "heats the coil by 0.00" in told and "it takes 0.012 W: wait" in told
    assert plays == 2
    here.clock.sleep(1.02 * float(told.removesuffix(" s.").rpartition("wait ")[2]))
    with open_rig(file) as rig:
        rig.excite(drive, ["A"], ["drive"])


def test_an_unreadable_record_of_heat_counts_as_all_that_a_coil_takes(here, tmp_path):
    drive = warming(1.0)
    with open_rig(warm(0.012)) as rig:
        rig.excite(drive, ["A"], ["drive"])
    for path in tmp_path.glob("*.heat"):
        path.write_bytes(b"torn")
    with open_rig(warm(0.012)) as rig, pytest.raises(LimitError, match="heats the coil by"):
        rig.excite(drive, ["A"], ["drive"])


def test_a_play_heats_before_it_begins_as_a_killed_program_leaves_it(here, tmp_path):
    seen: list[bytes] = []

    def look(*_: object) -> None:
        seen.append(next(tmp_path.glob("*.heat")).read_bytes())

    with open_rig(warm(0.5)) as rig:
        rig.excite(TONE, ["A"], ["drive"], progress=look)
    assert seen[0] == seen[-1] and b"0.0\n" not in seen[0].split(b'"content"')[1]


# What is lost


def test_doctor_and_the_log_say_once_what_is_lost():
    with open_rig(changed(FILE, actuator={"watts": 0.1})) as rig:
        findings = examine(rig)
        logged = [e for e in entries(rig.audit.folder) if e.get("why") == LOST]
    (shown,) = [f for f in findings if f.name == "No relay"]
    assert shown.status == "yellow" and shown.sentence.startswith(LOST)
    assert "a fuse of 0.5 A in series" in shown.sentence
    assert "1 V that stays would make the coil dissipate 0.125 W, and it takes 0.1 W" in shown.sentence
    assert len(logged) == 1 and logged[0]["kind"] == "connected"
    assert not [f for f in findings if f.status == "red"]
    assert not [f for f in findings if f.instrument == "relay"]
    (safe,) = [f for f in findings if f.name == "Safe state"]
    assert safe.sentence == "The output is zero, read back; the actuator stays connected."
    assert not [f for f in findings if "relay is open" in f.sentence or "relay channel" in f.sentence]
    assert FILE.at_rest == "the output is zero, and the actuator stays connected"
    assert load_rig_file("haptable").at_rest == "the output is zero and the relay is open"
    assert load_rig_file("minimal").at_rest == "the output is zero"


def test_a_killed_program_leaves_at_most_its_drive_until_the_rig_is_opened_again(here):
    """Its card holds its last value: a volt that stays, here from the middle of a play."""

    def kill(_doing: str, seconds: float, *_: object) -> None:
        if seconds > 0.25:
            raise KeyboardInterrupt

    rig = open_rig(hardware())
    rig.prove_gain("A")
    safe = rig._safe.reach
    rig._safe.reach = lambda: None  # type: ignore[method-assign]  it never gets there
    raises(KeyboardInterrupt, "", rig.excite, TONE, ["A"], ["drive"], progress=kill)
    here.forget(rig)
    rig._safe.reach = safe
    here.leave("amplifier", 0.4)
    here.clock.sleep(5)
    assert abs(here.truth.patch_voltages["A"]) == pytest.approx(0.8, rel=0.02)
    with open_rig(hardware()):
        here.clock.sleep(0.01)
        assert abs(here.truth.patch_voltages["A"]) < 1e-3


def test_outputs_stay_reserved_after_a_play_too(here):
    with open_rig(hardware()) as rig:
        rig.prove_gain("A")
        rig.excite(TONE, ["A"], ["drive"])
        rig.relay.connect([])
        raises(LimitError, "The outputs stay reserved", rig.daq.let_go)


CHILD = """
import sys
import numpy as np
from haploop.instruments import open_rig
t = np.arange(4 * 50_000) / 50_000
drive = 0.8 * np.sin(2 * np.pi * 250 * t) * np.hanning(len(t))
with open_rig(sys.argv[1]) as rig:
    rig.prove_gain("A")
    print("playing", flush=True)
    rig.excite(drive, ["A"], ["drive"])
"""


def served(folder: Path) -> tuple[Path, Simulation]:
    """The rig's file as of hardware, whose card is served from a plant in real time."""
    world = Simulation(hardware(), RealClock())
    card = world.serve("ni-daqmx", NiDaq.Settings.model_validate(FILE.daq.settings))
    pdv: Any = driver_class("pdv-100", "vibrometer")
    world.instrument("vibrometer", FILE.vibrometer, pdv, "twin")
    path = folder / "lab.toml"
    text = (Path(haploop.__file__).parent / "rigs" / "voice-coil.toml").read_text(encoding="utf-8")
    text = text.replace('base = "simulated"', 'base = "haptable"').replace(
        "[table]", f'[daq]\nserver = "{card["server"]}"\n\n[table]'
    )
    path.write_text(text, encoding="utf-8")
    return path, world


@pytest.mark.long
@POSIX
def test_kill_9_in_a_play_leaves_what_the_server_plays_to_its_end(tmp_path):
    """A device server outlives the program: a finite waveform ends at zero."""
    path, world = served(tmp_path)
    with subprocess.Popen(
        [sys.executable, "-c", CHILD, str(path)], stdout=subprocess.PIPE, text=True
    ) as child:
        try:
            assert child.stdout is not None and child.stdout.readline() == "playing\n"
            time.sleep(1.5)
        finally:
            child.kill()
        child.wait()
    time.sleep(4.0)
    assert world.truth.closed == {"A"}, "nothing opens"
    assert world.truth.peak < 0.85
    assert abs(world.truth.patch_voltages["A"]) < 1e-3
    with open_rig(path) as rig:
        assert abs(rig.daq.outputs_read()["amplifier"]) < 2e-3
    world.close()
