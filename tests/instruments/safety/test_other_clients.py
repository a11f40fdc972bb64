"""Other programs that write to the output, at every time: nothing of theirs reaches a patch.

They are real nidaqmx clients of the same device server, with connections of their own.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import grpc
import nidaqmx
import numpy as np
import pytest
from nidaqmx import GrpcSessionOptions
from nidaqmx.errors import DaqError
from nidaqmx.system import System

from haploop.base.errors import InstrumentError, LimitError
from haploop.instruments import Rig, open_rig
from haploop.instruments.relay.board import ChannelRelay
from haploop.instruments.safety import lockout_of
from haploop.instruments.safety.audit import entries
from tests.instruments.safety.test_limiter import TONE
from tests.raising import raises

REFUSED = -50103


class Client:
    """A program of somebody else's, on the same card."""

    def __init__(self, server: str, name: str) -> None:
        self.channel = grpc.insecure_channel(server)
        self.name = name
        self.taken = self.refused = 0

    def write(self, volts: float = 8.0, output: str = "Dev2/ao0") -> bool:
        """Write volts once; False when the output is reserved."""
        try:
            with nidaqmx.Task(self.name, grpc_options=GrpcSessionOptions(self.channel, self.name)) as task:
                task.ao_channels.add_ao_voltage_chan(output)
                task.write(volts, auto_start=True)
        except DaqError as error:
            assert error.error_code == REFUSED
            self.refused += 1
            return False
        self.taken += 1
        return True

    def reset(self) -> None:
        """Reset the card, whoever has reserved what: it aborts their tasks."""
        System.remote(GrpcSessionOptions(self.channel, "")).devices["Dev2"].reset_device()


@contextmanager
def clients(rig: Rig, count: int = 1) -> Iterator[list[Client]]:
    """Clients of the rig's device server."""
    server = rig.daq._settings.server
    made = [Client(server, f"somebody's {number}") for number in range(count)]
    yield made
    for client in made:
        client.channel.close()


@contextmanager
def writing(rig: Rig, count: int) -> Iterator[list[Client]]:
    """Clients that write 8 V in a loop while the context lasts."""
    ended = threading.Event()

    def loop(client: Client) -> None:
        while not ended.wait(1e-3):
            client.write()

    with clients(rig, count) as made:
        threads = [threading.Thread(target=loop, args=(client,)) for client in made]
        for thread in threads:
            thread.start()
        try:
            yield made
        finally:
            ended.set()
            for thread in threads:
                thread.join(10)


def peak(rig: Rig) -> float:
    """Largest volts at any patch so far."""
    rig.simulation.plant.advance(rig.clock.now())
    return float(rig.simulation.truth.peak)


@pytest.mark.long
def test_clients_that_write_in_a_loop_get_nothing_through(full):
    with open_rig("simulated", simulate="wire") as rig:
        played = 0
        with writing(rig, 3) as others:
            while sum(client.taken for client in others) < 2:
                time.sleep(0.01)
            for _ in range(100 if full else 3):
                # Which of them is first at a given moment is chance: one who holds the output then is named.
                with suppress(InstrumentError):
                    capture = rig.excite(TONE, ["A"], ["drive"], tail=0.3)
                    assert np.ptp(rig.drive_monitor().to_si(capture.volts)) == pytest.approx(20, rel=0.05)
                    played += 1
                assert peak(rig) < 10.5
                assert rig.simulation.truth.closed == frozenset()  # the plant is at the present now
                with suppress(InstrumentError):
                    rig.relay.connect(["B"])
                    for _ in range(5):
                        rig.relay.renew()
                    rig.relay.connect([])
                assert peak(rig) < 10.5
        assert played
        assert all(client.refused and client.taken for client in others)
        assert rig.lockout is None


@pytest.mark.long
def test_at_no_moment_of_a_play_is_an_output_free(monkeypatch):
    """From before the contact closes until it reads open again, step by step of the rig's own."""
    said: dict[str, list[bool]] = {}
    with open_rig("simulated", simulate="wire") as rig, clients(rig) as (other,):

        def tried(where: str, method: Callable[..., Any]) -> Callable[..., Any]:
            def around(*args: Any, **named: Any) -> Any:
                said.setdefault(f"before {where}", []).append(other.write())
                try:
                    return method(*args, **named)
                finally:
                    said.setdefault(f"after {where}", []).append(other.write())

            return around

        def switched(self: ChannelRelay, patches: Any, _switch: Any = ChannelRelay._connect) -> None:
            tried("closing" if patches else "opening", lambda: _switch(self, patches))()

        monkeypatch.setattr(ChannelRelay, "_connect", switched)
        for name in ("_stream", "zero", "_outputs_read"):
            monkeypatch.setattr(rig.daq, name, tried(name, getattr(rig.daq, name)))
        sleep = rig.clock.sleep
        monkeypatch.setattr(rig.clock, "sleep", tried("resting", sleep))
        assert other.write()
        blocks = said.setdefault("block", [])
        rig.excite(TONE, ["A"], ["drive"], progress=lambda *_: blocks.append(other.write()))
        monkeypatch.undo()
        assert other.write()
        assert peak(rig) == pytest.approx(10, rel=0.03)
    assert {"before closing", "after closing", "after _stream", "block", "after zero"} <= set(said)
    free = {where for where, taken in said.items() if any(taken)}
    assert not free, said


def test_who_takes_an_output_under_a_closed_contact_trips(lab, place):
    """By a reset of the card, which no reservation withstands. In real time, without any renewal."""
    path, world = lab
    path.write_text(path.read_text().replace("dead_man = 1.0", "dead_man = 30.0"))
    with open_rig(path) as rig, clients(rig) as (other,):
        rig.relay.connect(["A"])
        assert world.truth.closed == {"A"} and not other.write()
        time.sleep(1.0)
        assert world.truth.closed == {"A"} and rig.lockout is None
        other.reset()
        assert other.write()
        since = time.monotonic()
        while not (tripped := [e for e in entries(rig.audit.folder) if e["kind"] == "tripped"]):
            assert time.monotonic() - since < 1.0
            time.sleep(0.01)
        assert rig.daq.outputs_read()["amplifier"] == pytest.approx(0, abs=0.01)
        assert rig.lockout is not None and "A patch was connected, and may have got volts" in rig.lockout.why
        assert not world.truth.closed and "may have got volts" in str(tripped[0]["why"])
        raises(LimitError, "locked out", rig.excite, TONE, ["A"], ["drive"])
    assert lockout_of(place, rig.hardware) is not None


def test_a_renewal_looks_at_what_stands_on_the_output():
    with open_rig("simulated", simulate="wire") as rig, clients(rig) as (other,):
        rig.relay.connect(["A"])
        rig.relay.renew()
        other.reset()
        other.write()
        with pytest.raises(
            InstrumentError, match=r"may have got volts.*'amplifier' was set to zero and reads 8 V"
        ):
            rig.relay.renew()
        assert rig.simulation.truth.closed == frozenset() and rig.lockout is not None


def test_an_output_that_was_taken_and_reads_zero_is_noticed_too():
    """A card that cannot read its outputs back would show nothing else."""
    with open_rig("simulated", simulate="wire") as rig, clients(rig) as (other,):
        rig.relay.connect(["A"])
        other.reset()
        raises(InstrumentError, "Another program has taken the outputs of Dev2", rig.relay.renew)
        assert rig.simulation.truth.closed == frozenset() and rig.lockout is not None


def test_what_stands_on_an_output_after_a_play_locks_the_rig_out(monkeypatch):
    """The outputs are read back once the relay reads open: not zero is an error, a lockout and a line."""
    with open_rig("simulated", simulate="wire") as rig, clients(rig) as (other,):
        connect = ChannelRelay._connect

        def last(self: ChannelRelay, patches: Any) -> None:
            if not patches:
                other.reset()
                other.write()
            connect(self, patches)

        monkeypatch.setattr(ChannelRelay, "_connect", last)
        with pytest.raises(InstrumentError, match=r"not confirmed: A patch may have got volts.* read 8 V"):
            rig.excite(TONE, ["A"], ["drive"])
        monkeypatch.undo()
        assert rig.lockout is not None and "read 8 V" in rig.lockout.why
        assert [e["kind"] for e in entries(rig.audit.folder)].count("tripped") == 1
        raises(LimitError, "locked out", rig.excite, TONE, ["A"], ["drive"])


def test_after_a_rig_the_outputs_are_free():
    with open_rig("simulated", simulate="wire") as rig, clients(rig) as (other,):
        for act in (
            lambda: rig.excite(TONE, ["A"], ["drive"]),
            lambda: rig.relay.connect([]),
            rig.make_safe,
            rig.daq.zero,
        ):
            act()
            assert other.write()
        other.write(0.0)


@pytest.mark.long
@pytest.mark.parametrize(("name", "place"), [
    ("stop", 1), ("start", 2), ("stop", 2), ("write", 3),
], ids=["before its stop", "before it starts", "before it is stopped", "before zero"])  # fmt: skip
def test_a_reset_between_two_calls_locks_out(name, place, monkeypatch):
    """The task that has lost its outputs reserves them again by itself, as if nothing had been."""
    with open_rig("simulated", simulate="wire") as rig, clients(rig) as (other,):
        rig.prove_gain("A")
        own, calls = getattr(nidaqmx.Task, name), []

        def called(task: nidaqmx.Task, *args: Any, **named: Any) -> Any:
            if task.name.endswith("Dev2 output"):
                calls.append(name)
                if len(calls) == place:
                    other.reset()
                    other.write()
            return own(task, *args, **named)

        monkeypatch.setattr(nidaqmx.Task, name, called)
        with pytest.raises(InstrumentError, match="Another program has taken the outputs of Dev2"):
            rig.excite(TONE, ["A"], ["drive"])
        monkeypatch.undo()
        assert rig.lockout is not None and not rig.simulation.truth.closed
        assert rig.daq.outputs_read()["amplifier"] == pytest.approx(0, abs=0.01)
