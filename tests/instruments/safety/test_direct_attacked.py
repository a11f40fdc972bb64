"""A rig without a relay under attack: other programs, and heat that no play has counted."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import haploop
from haploop.base.arrays import FloatArray
from haploop.base.errors import InstrumentError, LimitError
from haploop.base.threads import Flag
from haploop.instruments import RigFile, load_rig_file, open_rig
from haploop.instruments.safety.audit import entries
from tests.instruments.safety.lab import Lab
from tests.instruments.safety.lab import lab as a_lab
from tests.instruments.safety.test_coil_heat import warmest
from tests.instruments.safety.test_direct_wiring import TONE, served
from tests.instruments.safety.test_other_clients import Client, clients
from tests.raising import raises
from tests.rig_files import changed

RATE = 50_000
WATTS, TAU = 0.035, 2.0


def hardware() -> RigFile:
    file = load_rig_file("voice-coil")
    return changed(file, simulate=None, actuator={"watts": WATTS, "thermal_time": TAU})


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Lab]:
    with a_lab(tmp_path, hardware()) as here:
        yield here


def tone(seconds: float, before: float = 0.0) -> FloatArray:
    """2 s of it alone warm the coil to 0.032 W; `before` are seconds of zeros."""
    drive = 0.9 * np.sin(2 * np.pi * 250 * np.arange(round(seconds * RATE)) / RATE)
    drive[-1] = 0.0
    return np.concatenate([np.zeros(round(before * RATE)), drive])


def test_zeros_before_a_drive_are_no_rest_after_it(here):
    record = here.truth.record()
    told = []
    for drive in (tone(2.0, before=8.0), tone(2.0)):
        with open_rig(hardware()) as rig:
            try:
                rig.excite(drive, ["A"], ["drive"])
            except LimitError as error:
                told.append(str(error))
    assert warmest(record, 8.0, TAU) < 1.1 * WATTS
    assert len(told) == 1 and "earlier plays have left 0.0" in told[0]


def test_volts_that_stood_when_the_rig_was_opened_have_warmed_the_coil(here):
    with open_rig(hardware()) as rig:
        rig.prove_gain("A")
    here.leave("amplifier", 0.25)  # 0.03 W for ever
    here.clock.sleep(20)
    record = here.truth.record()
    with open_rig(hardware()) as rig:
        raises(LimitError, r"heats the coil by .* wait", rig.excite, tone(2.0), ["A"], ["drive"])
        here.clock.sleep(6 * TAU)
        rig.excite(tone(2.0), ["A"], ["drive"])
    assert warmest(record, 8.0, TAU) < 1.1 * WATTS


def test_a_coil_that_was_overheated_before_the_rig_was_opened_cools_first(here):
    open_rig(hardware()).close()
    here.leave("amplifier", 1.0)  # 0.5 W for ever
    here.clock.sleep(20)
    with open_rig(hardware()) as rig:
        with pytest.raises(
            LimitError, match=r"have left 0\.[45]\d* W in it, and it takes 0\.035 W: wait"
        ) as told:
            rig.excite(tone(0.1), ["A"], ["drive"])
        wait = float(str(told.value).removesuffix(" s.").rpartition("wait ")[2])
        assert wait > TAU * np.log(0.5 / WATTS)
        here.clock.sleep(wait)
        rig.excite(tone(0.1), ["A"], ["drive"])


@pytest.mark.usefixtures("place")
def test_a_taken_output_locks_out_whoever_finds_it(tmp_path):
    """Between two looks, a play or a safe state comes first."""
    for number in range(2):
        folder = tmp_path / str(number)
        folder.mkdir()
        path, world = served(folder)
        with open_rig(path) as rig, clients(rig) as (other,):
            rig.prove_gain("A")
            rig._limiter._watch.end()
            other.reset()
            assert other.write(1.5)
            act = (lambda r=rig: r.excite(TONE, ["A"], ["drive"]), rig.make_safe)[number]
            raises(InstrumentError, "has taken the outputs", act)
            assert rig.lockout is not None
            haploop.instruments.reset_lockout(path, "it was a test, and the other program is gone")
        world.close()


@pytest.mark.long
@pytest.mark.usefixtures("place")
def test_who_takes_the_output_gets_zero_each_time(tmp_path, monkeypatch):
    path, world = served(tmp_path)
    with open_rig(path) as rig, clients(rig) as (other,):
        server = rig.daq._settings.server
        watch, looks, waits = rig._limiter._watch, 0, []
        look, wait = watch._look, rig.clock.wait

        def looked() -> None:
            nonlocal looks
            try:
                look()
            finally:
                looks += 1

        def waited(event: Flag, seconds: float) -> bool:
            if threading.current_thread() is watch._thread:
                waits.append(seconds)
            return wait(event, seconds)

        def taken() -> bool:
            other.reset()
            return other.write(1.5)

        monkeypatch.setattr(watch, "_look", looked)
        monkeypatch.setattr(rig.clock, "wait", waited)
        since = time.monotonic()
        for _ in range(8):
            assert any(taken() for _ in range(20))  # a look between the two steps has reserved it again
            seen, began = looks, time.monotonic()
            # The look that went on at the write may have been past the output; the next one is not. A busy
            # computer looks late, so the looks are counted, and the time between them is what is asked for.
            while looks < seen + 2:
                assert time.monotonic() - began < 60.0, "nobody looks any more"
                time.sleep(0.01)
            time.sleep(0.05)
            assert abs(world.truth.patch_voltages["A"]) < 1e-3
            assert rig.lockout is not None
        assert waits and max(waits) <= 0.2
        tripped = [e for e in entries(rig.audit.folder) if e["kind"] == "tripped"]
        # After intervals of 0.2 s, 0.4 s, 0.8 s and so on.
        most = 1 + np.log2(1 + (time.monotonic() - since) / 0.2)
        assert 1 <= len(tripped) <= most, "not each is logged"
    again = Client(server, "somebody's again")
    assert again.write(0.0), "the output is free once the rig is closed"
    again.channel.close()
    world.close()


def test_a_generator_that_somebody_switches_on_is_switched_off(tmp_path):
    text = (Path(haploop.__file__).parent / "rigs" / "voice-coil.toml").read_text(encoding="utf-8")
    path = tmp_path / "lab.toml"
    path.write_text(
        text.replace('input = "amplifier"', 'input = "sweep"')
        + '\n[generator]\ndriver = "keysight-33500"\noutput = "sweep"\n'
        'resource = "TCPIP::192.0.2.10::5025::SOCKET"\n',
        encoding="utf-8",
    )
    with open_rig(path, simulate="wire") as rig:
        rig.generator._line.send("OUTP1 ON")
        assert rig.generator.is_on
        raises(InstrumentError, "is on, and this rig has not started it", rig._limiter.authorise_renewal)
        assert not rig.generator.is_on and rig.lockout is not None
