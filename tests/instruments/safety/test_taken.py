"""A play that another program cuts off: the rig is locked out, whatever was played and wherever it went."""

import random
import threading
import time
from collections.abc import Callable

import pytest

from haploop.base.errors import InstrumentError, LimitError, TakenError
from haploop.instruments import Rig, open_rig
from haploop.instruments.daq.ni_outputs import NiOutputs
from haploop.instruments.relay.board import ChannelRelay
from haploop.instruments.safety import clear_lockout
from haploop.mocks.relay.box import SimulatedBox
from haploop.mocks.simulation import Simulation
from tests.instruments.rig.test_played_whole import TONE, at_block
from tests.instruments.safety.lab import FOUR_CHANNELS
from tests.instruments.safety.test_other_clients import Client, clients, peak
from tests.raising import raises

FOUR = f'base = "simulated"\nname = "four"\n[daq]\ndevices = {{ Dev2 = "PCIe-6363" }}{FOUR_CHANNELS}'


PATCHES = pytest.mark.parametrize("patches", [["A"], []], ids=["patch", "no patch"])


def takes(other: Client, writes: bool = True, output: int = 0) -> Callable[[Rig], None]:
    def take(_rig: Rig) -> None:
        other.reset()
        if writes:
            other.write(output=f"Dev2/ao{output}")

    return take


def assert_locked_out(rig: Rig) -> None:
    assert rig.simulation.truth.closed <= {"B"}, "B is welded where it is closed"
    assert rig.daq.outputs_read()["amplifier"] == pytest.approx(0, abs=0.01)
    assert rig.lockout is not None and "another program" in rig.lockout.why.lower()
    raises(LimitError, "locked out", rig.excite, TONE, ["A"], ["drive"])


@PATCHES
@pytest.mark.parametrize("block", [1, 3, 6, 7], ids=["begin", "middle", "end", "tail"])
@pytest.mark.parametrize("writes", [True, False], ids=["writes", "only resets"])
def test_a_reset_of_the_card_in_a_play_locks_out(patches, block, writes):
    with open_rig("simulated", simulate="wire") as rig, clients(rig) as (other,):
        if patches:
            rig.prove_gain("A")
        with pytest.raises(InstrumentError) as raised:
            rig.excite(
                TONE, patches, ["drive"], tail=0.5, progress=at_block(block, takes(other, writes), rig)
            )
        assert f"'amplifier' read {8 if writes else 0} V then" in str(raised.value)
        assert rig.lockout is not None and f"read {8 if writes else 0} V" in rig.lockout.why
        assert_locked_out(rig)


def test_so_does_one_with_a_welded_contact(monkeypatch):
    """The box reads open: volts reach the patch that is welded, whichever is played into."""
    with open_rig("simulated", simulate="wire") as rig, clients(rig) as (other,):

        def weld(_rig: Rig) -> None:
            monkeypatch.setattr(SimulatedBox, "_fires", lambda _box, kind, _channel: kind == "welded")

        rig.excite(TONE, ["B"], ["drive"], progress=at_block(3, weld, rig))
        assert rig.simulation.truth.closed == {"B"}
        raises(TakenError, "", rig.excite, TONE, [], ["drive"], progress=at_block(2, takes(other), rig))
        assert_locked_out(rig)


@pytest.mark.long
@pytest.mark.parametrize("output", range(4))
def test_so_does_one_at_any_channel_of_four(tmp_path, output):
    path = tmp_path / "four.toml"
    path.write_text(FOUR)
    with open_rig(path, simulate="wire") as rig, clients(rig) as (other,):
        monitors = [rig.monitor(patch) for patch in "ABCD"]
        drives, taken = dict.fromkeys("ABCD", TONE), at_block(2, takes(other, output=output), rig)
        rig.excite_each(drives, monitors)
        raises(TakenError, " read 8 V then", rig.excite_each, drives, monitors, progress=taken)
        assert_locked_out(rig)


@PATCHES
def test_a_program_cannot_free_the_outputs_in_its_own_play(patches):
    with open_rig("simulated", simulate="wire") as rig, clients(rig) as (other,):
        taken: list[bool] = []

        def free(_rig: Rig) -> None:
            try:
                rig.daq.let_go()
            finally:
                taken.append(other.write())

        with pytest.raises(LimitError, match=r"The outputs stay reserved .* rig\.relay\.connect\(\[\]\)"):
            rig.excite(TONE, patches, ["drive"], progress=at_block(2, free, rig))
        assert taken == [False] and peak(rig) < 10.5
        rig.relay.connect(["A"])
        raises(LimitError, "The outputs stay reserved", rig.daq.let_go)
        rig.relay.connect([])
        rig.daq.let_go()
        assert other.write()
        other.write(0.0)


def test_what_takes_an_output_after_the_last_block_is_noticed(monkeypatch):
    """Between the last look at the samples and zero nothing else would show it."""
    with open_rig("simulated", simulate="wire") as rig, clients(rig) as (other,):
        rest = NiOutputs.rest

        def first(outputs: NiOutputs) -> None:
            if outputs._plays:
                other.reset()
            rest(outputs)

        rig.prove_gain("A")
        monkeypatch.setattr(NiOutputs, "rest", first)
        raises(TakenError, "", rig.excite, TONE, ["A"], ["drive"])
        monkeypatch.undo()
        assert_locked_out(rig)


@pytest.mark.parametrize("at", ["before it plays", "while it rests"])
def test_so_is_what_takes_one_round_a_play(monkeypatch, at):
    """While a contact closes, and while zero volts wait for it to open: also where no output reads back."""
    with open_rig("simulated", simulate="wire") as rig, clients(rig) as (other,):
        rig.prove_gain("A")
        monkeypatch.setattr(rig.daq, "outputs_read", dict)
        connect = ChannelRelay._connect

        def around(relay: ChannelRelay, patches: list[str]) -> None:
            connect(relay, patches)
            if bool(patches) == (at == "before it plays"):
                other.reset()

        monkeypatch.setattr(ChannelRelay, "_connect", around)
        raises(InstrumentError, "Another program has taken the outputs", rig.excite, TONE, ["A"], ["drive"])
        monkeypatch.undo()
        assert_locked_out(rig)


@pytest.mark.usefixtures("place")
def test_a_contact_that_does_not_open_is_watched_after_the_play(lab, monkeypatch):
    """In real time: who resets the card and writes then trips the rig, again and again."""
    path, world = lab
    path.write_text(path.read_text().replace("dead_man = 1.0", "dead_man = 30.0"))
    with open_rig(path) as rig, clients(rig) as (other,), monkeypatch.context() as patch:
        patch.setattr(type(rig.relay._board), "open_channel", lambda *_: None)
        raises(InstrumentError, "told to open but reads closed", rig.excite, TONE, ["A"], ["drive"])
        assert world.truth.closed == {"A"} and not other.write()
        for _ in range(2):
            other.reset()
            other.write()
            within(2.0, lambda: rig.lockout is not None and volts(world) < 0.5)


def volts(world: Simulation) -> float:
    return max(abs(v) for v in world.truth.patch_voltages.values())


def within(seconds: float, condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.long
def test_at_random_moments_of_real_plays(lab, place, full):
    path, world = lab
    r = random.Random(46)
    with open_rig(path) as rig, clients(rig) as (other,):
        rig.prove_gain("A")
        for _ in range(20 if full else 3):
            attacker = threading.Timer(r.uniform(0, 0.5), takes(other), (rig,))
            starts = at_block(1, lambda _, own=attacker: own.start(), rig)
            raises(InstrumentError, "", rig.excite, TONE, ["A"], ["drive"], tail=0.5, progress=starts)
            attacker.join()
            assert not world.truth.closed and rig.lockout is not None
            clear_lockout(place, rig.hardware)
            other.write(0.0)
