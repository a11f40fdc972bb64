"""A known pattern, files that hold it, and what runs in the processes that are killed while recording it."""

import contextlib
import sys
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from haploop.acquisition import Recording, record
from haploop.acquisition.recording.file_format import Header, from_codes
from haploop.acquisition.recording.rows import PressVerdict
from haploop.acquisition.recording.salvage import finish
from haploop.acquisition.recording.writer import Writer
from haploop.acquisition.session.recorder import StreamReader
from haploop.base.clock import RealClock
from haploop.instruments import Block, Stream, load_rig_file
from tests.acquisition.presses.pressworld import world_rig

CHANNELS = 16
RATE = 5000
BLOCK = 250
FULL_SCALE = np.full(CHANNELS, 10.0)
RIG = load_rig_file("simulated")  # which imports every driver: here, and not in each process


def header(channels: int = CHANNELS, presses: int = 1) -> Header:
    sensors = (RIG.sensors.force, RIG.sensors.acceleration, RIG.sensors.activation)
    names = [name for sensor in sensors for name in sensor.channels]
    names += [f"spare{i}" for i in range(len(names), channels)]
    return Header(
        button="push", participant="P01", presses=presses, rig_name="simulated", simulated=True, rest=0.5,
        rate_hz=float(RATE), channels=tuple(names[:channels]), full_scale=np.full(channels, 10.0),
        delays=np.zeros(channels), rig=RIG.model_dump_json(), daq="none", software="test",
        started="2026-01-01T00:00:00+00:00",
    )  # fmt: skip


def codes_of(first: int, count: int, channels: int = CHANNELS) -> np.ndarray:
    """Any sample of any channel differs from its neighbours, and can be told from its index."""
    k = np.arange(first, first + count) * 7919 + np.arange(channels)[:, None] * 104729
    return (k % 65536 - 32768).astype(np.int16)


def block_of(first: int, count: int = BLOCK) -> Block:
    return Block(first, from_codes(codes_of(first, count), FULL_SCALE), np.zeros(CHANNELS, dtype=bool))


PRESS = PressVerdict(1, 1, 100, 200, 112.5, 2.25, True, (), "")


def written(path: Path, blocks: int = 1) -> Path:
    """A recording that was interrupted after some blocks."""
    with Writer(path, header(), BLOCK, blocks + 12) as writer:
        for i in range(blocks):
            writer.write(block_of(BLOCK * i), 0.0)
    return path


def unfinished(path: Path, blocks: int = 8) -> Path:
    with Writer(path, header(), 250, 20) as writer:
        for i in range(blocks):
            writer.write(block_of(250 * i), 0.05 * (i + 1))
        writer.note(500, "pressed", "Press 1 of 1 was seen.")
        writer.write_verdict(PRESS)
    return path


def kept(path: Path) -> int:
    """How many samples a file has, each of which is what was recorded."""
    volts = Recording.open(path).volts
    assert np.array_equal(volts, from_codes(codes_of(0, volts.shape[1]), FULL_SCALE))
    return volts.shape[1]


class Paced(Stream):
    """A card that delivers the pattern at its real pace, late where the machine is, but never less."""

    channels = tuple(f"c{i}" for i in range(CHANNELS))
    rate_hz = float(RATE)

    def __init__(self, tell: Connection) -> None:
        self.tell = tell

    def __iter__(self) -> Iterator[Block]:
        began = time.monotonic()
        self.tell.send(("began", round(began * 1e9)))
        for first in range(0, 10**9, BLOCK):
            time.sleep(max(0.0, began + (first + BLOCK) / RATE - time.monotonic()))
            self.tell.send(("given", first + BLOCK))
            yield block_of(first)

    def close(self) -> None:
        pass


def record_at_pace(path: Path, tell: Connection) -> None:
    """Record the pattern until this process is killed; `tell` what was given and what was written."""
    writer = Writer(path, header(presses=10), BLOCK, 4000)
    with writer, StreamReader(Paced(tell), RealClock()) as reader:
        for block in reader:
            writer.write(block, 0.0)
            tell.send(("written", writer.written))
            if block.first % (10 * BLOCK) == 0:
                writer.note(block.end, "pressed", f"After {block.end}.")


def preallocate(path: Path, tell: Connection) -> None:
    """Preallocate files of 80 MB, one after the other."""
    for number in range(1000):
        tell.send(("preallocating", number))
        Writer(path.with_name(f"P{number}-push.h5"), header(), BLOCK, 10_000).close()


def finish_again(path: Path, tell: Connection) -> None:
    """Record 100 blocks and finish the file, one file after the other."""
    for number in range(1000):
        destination = path.with_name(f"P{number}-push.h5")
        written(destination, 100)
        tell.send(("finishing", number))
        finish(destination)


def record_session(path: Path, tell: Connection) -> None:
    """A session of 500 presses."""
    record(
        world_rig(seed=2), "push", "P01", 500, path.parent, progress=lambda *p: tell.send(("pressed", p[1]))
    )


def run(what: str, path: Path, tell: Connection) -> None:
    """One of the functions above, by its name. A pipe that its reader has left is no traceback."""
    with contextlib.suppress(BrokenPipeError):
        getattr(sys.modules[__name__], what)(path, tell)
