"""Whatever an NI device server answers, what comes out is what the answer says, or one sentence.

The server's own words are protobuf messages, and what takes them apart is NI's library: a reply is
mutated where it leaves the server, or in memory between protobuf and NI's library.
"""

from __future__ import annotations

import random
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from typing import Any

import grpc
import numpy as np
import pytest
from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx.errors import DaqWarning

from haploop.base.errors import HaploopError, InstrumentError
from haploop.instruments.conformance import bypass_interlock
from haploop.instruments.daq.ni_daqmx import NiDaq
from haploop.instruments.daq.role import Capture
from haploop.nidaqmx_twin import NiServer, inventory_of
from tests.instruments.daq.conftest import CARDS, WIRING, settings
from tests.instruments.test_fuzzed_replies import SEED, replies
from tests.nidaqmx_twin.ni_client import Bench

RANGES = np.array([[10.0], [5.0]])
"""V, of the channels `drive` and `laser`."""
CHANNELS, COUNT = ["drive", "laser"], 20


@pytest.fixture(autouse=True)
def _no_warnings() -> Iterator[None]:
    """A status above zero is a warning of NI's, and the data are good."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DaqWarning)
        yield


@contextmanager
def serving() -> Iterator[tuple[NiServer, Bench]]:
    bench = Bench()
    with NiServer(inventory_of(CARDS), bench, WIRING, rtsi=True) as server:
        yield server, bench


@contextmanager
def opened(server: NiServer, bench: Bench) -> Iterator[NiDaq]:
    daq = NiDaq.open(settings(server=server.address), bench.clock)
    try:
        daq.clear_left()
        bypass_interlock(daq)
        yield daq
    finally:
        daq.close()


class Refused(grpc.RpcError):
    """A call that failed, as grpc has it."""

    def __init__(self, code: grpc.StatusCode, details: str, *metadata: tuple[str, str]) -> None:
        self._code, self._details = code, details
        self._metadata = [_Entry(*entry) for entry in metadata]

    def code(self) -> grpc.StatusCode:
        return self._code

    def details(self) -> str:
        return self._details

    def trailing_metadata(self) -> list[_Entry]:
        return self._metadata


class _Entry:
    def __init__(self, key: str, value: str) -> None:
        self.key, self.value = key, value


def reading(volts: np.ndarray, **fields: int) -> bytes:
    whole = {"status": 0, "samps_per_chan_read": COUNT, **fields}
    reply = pb.ReadAnalogF64Response(read_array=volts.ravel(), **whole)
    return bytes(reply.SerializeToString())


def readings() -> tuple[bytes, ...]:
    """Good ones, and such as are wrong in one field only."""
    rng = np.random.default_rng(SEED)
    good = RANGES * rng.uniform(-1, 1, (2, COUNT))
    odd = [np.where(rng.random(good.shape) < 0.03, value, good) for value in (np.nan, np.inf, 1e300, -21.0)]
    return (
        *[reading(good)] * 6,
        *(reading(volts) for volts in odd),
        reading(good[:, :-1]),
        reading(np.hstack([good, good])),
        *(reading(good, samps_per_chan_read=n) for n in (0, COUNT - 1, COUNT + 1, -1)),
        *(reading(good, status=n) for n in (-200284, -1, 7, 200010)),
        b"",
    )


def test_what_a_read_says(full):
    """From a reply's bytes to a block, by the driver and NI's library, without the network between."""
    reply = b""
    chance = random.Random(SEED)

    def read(request: object, metadata: object = None) -> Any:
        if chance.random() < 0.05:
            code = chance.choice(list(grpc.StatusCode))
            value = chance.choice(("-200279", "nonsense", "", "0", "-1", "9" * 30))
            key = chance.choice(("ni-error", "ni-samps-per-chan-read", "else"))
            raise Refused(code, chance.choice(("", "It failed.\nTwice.")), (key, value))
        try:
            return pb.ReadAnalogF64Response.FromString(reply)
        except Exception:
            # As grpc itself does with what it cannot take apart.
            raise Refused(grpc.StatusCode.INTERNAL, "Exception deserializing response!") from None

    taken = 0
    with (
        serving() as (server, bench),
        opened(server, bench) as daq,
        daq.stream(CHANNELS, 5000, COUNT) as stream,
    ):
        (task,) = stream._inputs
        task._interpreter._client.ReadAnalogF64 = read
        for reply in islice(replies(readings(), SEED), 100_000 if full else 1000):
            try:
                block = next(iter(stream))
            except InstrumentError as error:
                assert "\n" not in str(error)
                continue
            said = pb.ReadAnalogF64Response.FromString(reply)
            volts = np.reshape(said.read_array, (2, COUNT))
            assert said.status >= 0 and said.samps_per_chan_read == COUNT
            assert np.array_equal(block.volts, volts) and np.all(np.abs(volts) <= 2 * RANGES)
            taken += 1
    assert taken > 50, "whole replies among them are taken"


def play_and_record(daq: NiDaq) -> Capture:
    wave = {"amplifier": np.sin(np.arange(200) / 10)}
    with daq.stream(["laser", "force", "drive"], 5000, 50, 200, wave) as stream:
        return stream.capture()


def test_whole_calls_through_the_wire(full):
    """One reply of a session is corrupted, or several, or all; the next session finds all as it should be."""
    calls: list[str] = []
    sent: dict[str, list[np.ndarray]] = {}
    corrupted: set[int] = set()
    noise = random.Random(SEED)

    def corrupt(call: str, reply: bytes) -> bytes:
        calls.append(call)
        if len(calls) - 1 in corrupted:
            reply = next(replies((reply,), noise.randrange(1 << 30)))
        if call == "ReadAnalogF64":
            try:
                said = pb.ReadAnalogF64Response.FromString(reply)
            except Exception:
                return reply
            sent.setdefault("volts", []).append(np.array(said.read_array))
        return reply

    outcomes = {"refused": 0, "taken": 0}
    with serving() as (server, bench):
        server.corrupt(corrupt)
        with opened(server, bench) as daq:
            play_and_record(daq)
        whole = len(calls)
        for number in range(400 if full else 2):
            calls.clear()
            sent.clear()
            corrupted = set(noise.sample(range(whole), noise.choice((1, 1, 1, 3)) if number else whole))
            began = time.monotonic()
            try:
                with opened(server, bench) as daq:
                    capture = play_and_record(daq)
            except HaploopError as error:
                assert "\n" not in str(error)
                outcomes["refused"] += 1
            else:
                said = np.sort(np.concatenate(sent["volts"]))
                assert np.array_equal(np.sort(capture.volts.ravel()), said)
                assert capture.volts.shape == (3, 200) and np.abs(capture.volts).max() <= 20
                outcomes["taken"] += 1
            assert time.monotonic() - began < 30, "no answer is waited for longer than a call may take"
            corrupted = set()
            with opened(server, bench) as daq:
                daq.zero()
                assert server.output("Dev2/ao0") == 0
                assert play_and_record(daq).volts.shape == (3, 200)
    print(outcomes)
    assert outcomes["refused"], outcomes
