"""A second program with the same hardware is refused, and one that is killed leaves an open relay."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

import numpy as np
import pytest

import haploop
from haploop.base.clock import RealClock
from haploop.base.errors import HaploopError, InstrumentError
from haploop.base.marks import is_marked, marked
from haploop.instruments import load_rig_file, open_rig
from haploop.instruments.relay.yocto import Yocto
from haploop.instruments.rig.opening import hardware
from haploop.instruments.safety.duty import plays_of
from haploop.instruments.safety.lockout import lockout_of
from haploop.instruments.safety.machine import hold, reserve
from tests.raising import raises, raising

DRIVE = 20 * np.sin(2 * np.pi * 250 * np.arange(50_000) / 50_000) * np.hanning(50_000)
TraceFunction = Callable[[FrameType, str, Any], Any]
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="signals to another program are POSIX")


CHILD = """
import sys, time
from haploop.instruments import open_rig
with open_rig(sys.argv[1]) as rig:
    rig.relay.connect(["A"])
    print("connected", flush=True)
    while True:
        rig.relay.renew()
        time.sleep(0.1)
"""


@POSIX
def test_a_killed_program_leaves_an_open_relay(lab, tmp_path):
    path, world = lab
    with subprocess.Popen(
        [sys.executable, "-c", CHILD, str(path)], stdout=subprocess.PIPE, text=True
    ) as child:
        try:
            assert child.stdout is not None and child.stdout.readline() == "connected\n"
            assert world.truth.closed == {"A"}
            # Another file that names only the same relay is refused as well.
            other = tmp_path / "other.toml"
            other.write_text(path.read_text().replace('name = "lab"', 'name = "other"'))
            owner = rf"The rig 'other' is in use \(.*\) by process {child.pid} \(-c .*\) of .* on .*: wait"
            raises(InstrumentError, owner, open_rig, other)
            # One names the box by its number, and the other does not; their cards are others.
            (box,) = (piece for piece in hardware(load_rig_file(path), None) if "MXCOUPL" in piece)
            named = f'[relay]\nserial = "{box.split()[-1].lower()}"\n'
            elsewhere = '[daq]\nserver = "127.0.0.1:1"\n'
            hub = path.read_text().partition("[relay]\n")[2]
            other.write_text(f'base = "haptable"\nname = "other"\n{elsewhere}{named}{hub}')
            raises(InstrumentError, rf"in use \({box}\) by process {child.pid} ", open_rig, other)
            other.write_text(path.read_text().replace('name = "lab"', 'name = "other"'))
            time.sleep(1.5)
            assert world.truth.closed == {"A"}  # renewed while the program is healthy
        finally:
            child.kill()
        child.wait()
    killed = time.monotonic()
    while world.truth.closed:
        assert time.monotonic() - killed < 2.0
        time.sleep(0.02)
    with open_rig(path) as rig:
        assert rig.relay.connected() == frozenset()
        raises(InstrumentError, "is open in this program already", open_rig, other)


@pytest.mark.usefixtures("unproved")
def test_a_card_is_one_under_every_name(lab, tmp_path, place):
    """What one rig holds, trips and plays is held, locked out and counted for a rig with another name."""
    path, _ = lab
    path.write_text(path.read_text() + "[abort]\ndrive = 15.0\n")
    address = load_rig_file(path).daq.settings["server"]
    other = tmp_path / "other.toml"
    card = 'devices = { Dev1 = "PCI-6034E" }'
    other.write_text(f'base = "minimal"\nname = "other"\n[daq]\nserver = "ipv4:{address}"\n{card}\n')
    with open_rig(path) as rig:
        raises(InstrumentError, r"open in this program already \(PCI-6034E 1[0-9A-F]{6}\)", open_rig, other)
        raises(InstrumentError, r"allows 15 V", rig.excite, DRIVE[::10], ["A"], ["drive"])
    with open_rig(other) as rig:
        assert rig.lockout is not None and "allows 15 V" in rig.lockout.why
        now = RealClock().now()
        ((start, stop),) = plays_of(place, rig.hardware, now)
        assert stop - start == pytest.approx(0.1, abs=0.01)
    haploop.instruments.reset_lockout(other, "a test")
    assert lockout_of(place, rig.hardware) is None


@pytest.mark.parametrize("role", ["daq", "relay"])
def test_hardware_that_answered_too_late_is_not_used_under_another_name(lab, role, monkeypatch):
    """Under its address it would have neither the lock nor the lockout that its number has."""
    path, _ = lab
    if role == "daq":
        monkeypatch.setattr("haploop.instruments.daq.ni_cards.numbers_of", lambda *_: {})
    else:
        monkeypatch.setattr(Yocto, "hardware", staticmethod(lambda settings: (settings.hub,)))
    raises(InstrumentError, f"The {role} of the rig 'lab' is another one .* or answers on", open_rig, path)
    monkeypatch.undo()
    open_rig(path).close()


def test_a_lock_and_a_mark_hold_on_a_full_disk(tmp_path, place, monkeypatch):
    """The holder's name is missing then, and no more; a network disk may refuse as late as on closing."""
    close, full = os.close, raising(OSError(28, "No space left on device"))

    def closed(descriptor: int) -> None:
        close(descriptor)
        full()

    with monkeypatch.context() as patch:
        patch.setattr("os.write", full)
        with hold({"card"}, "The rig 'one'"):
            (lock,) = place.glob("*.lock")
            assert not lock.read_bytes()
    with marked(tmp_path / "one"):
        monkeypatch.setattr("os.close", closed)
    monkeypatch.undo()
    assert not is_marked(tmp_path / "one")


def test_a_reservation_is_for_this_programs_rigs():
    with reserve({"card"}, "The rig 'one'"):
        for _ in range(2):
            with hold({"card"}, "The rig 'one'"):
                pass
        with hold({"card"}, "The rig 'one'"):
            with (
                pytest.raises(HaploopError, match="The rig 'two' is open in this program already"),
                hold({"card", "relay"}, "The rig 'two'"),
            ):
                pass
            with hold({"relay"}, "The rig 'two'"):
                pass
