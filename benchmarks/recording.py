"""Throughput, latency and CPU load of recording, beside other libraries: `python benchmarks/recording.py`.

All in one run on one disk, one after the other in each round, so that ratios mean something. See README.md.
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from benchmarks.contestants import CHANNELS, CONTESTANTS, FULL_SCALE, NAMES, Material, Way, header, raw
from benchmarks.table import Row, ratios
from haploop.acquisition.recording.salvage import read_contents
from haploop.acquisition.recording.writer import Writer
from haploop.acquisition.session.recorder import StreamReader
from haploop.base.clock import RealClock
from haploop.instruments import Block, Stream

PAPER_RATE = 5000.0


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Measure, print the tables, and return their figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7, help="rounds of the comparison")
    parser.add_argument(
        "--megabytes", type=int, default=128, help="what each way records in a round; a quarter in 8 kB"
    )
    parser.add_argument("--seconds", type=float, default=20.0, help="length of each paced recording")
    parser.add_argument("--folder", type=Path, default=Path.cwd(), help="on the disk to be measured")
    options = parser.parse_args(words)
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    print(
        f"{time.strftime('%Y-%m-%d')}, {_processor()}, {os.cpu_count()} cores, {platform.system()}, "
        f"Python {platform.python_version()}{load}\n"
    )
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        return [
            *throughput(folder, options.rounds, options.megabytes, 10_000, ">= 0.8"),
            *throughput(folder, options.rounds, max(1, options.megabytes // 4), 250, ">= 0.4"),
            *paper_rate(folder, options.seconds),
            *hundredfold(folder, options.seconds),
            *latency(folder, options.seconds, busy=False),
            *latency(folder, options.seconds, busy=True),
        ]


def throughput(folder: Path, rounds: int, megabytes: int, samples: int, goal: str) -> list[Row]:
    """Blocks of `samples` of int16, as fast as they go, until the disk has them. Ratio to the raw writes of
    the same round, half of which come before a way's and half after it.
    """
    material = Material(samples)
    blocks = megabytes * 1_000_000 // (2 * CHANNELS * samples)
    rates: dict[str, list[float]] = {"raw write": []}
    beside: dict[str, list[float]] = {}
    for _ in range(rounds):
        before = _rate(raw, folder, material, blocks)
        for way in CONTESTANTS:
            rate = _rate(way.record, folder, material, max(1, round(blocks * way.part)))
            after = _rate(raw, folder, material, blocks)
            rates.setdefault(way.name, []).append(rate)
            beside.setdefault(way.name, []).append(2 * rate / (before + after))
            rates["raw write"].append(after)
            before = after
    size = f"{2 * CHANNELS * samples / 1000:.0f} kB blocks"
    print(f"{f'{size}, {megabytes} MB, {rounds} rounds':32} {'MB/s':>8}   ratio to raw (median, range)")
    print(f"{'raw write and fsync':32} {statistics.median(rates['raw write']):8.0f}")
    for name, each in beside.items():
        print(
            f"{name:32} {statistics.median(rates[name]):8.1f}   {statistics.median(each):.3f}  "
            f"({min(each):.3f} to {max(each):.3f})"
        )
    print()
    what, own = f"recording to disk, {size} x 16 channels, from volts", rates["haploop"]
    rows = [Row(what, own, "MB/s", "raw write and fsync", beside["haploop"], goal, more=True)]
    # Each of both in units of the raw writes around it, which a disk that changes its speed changes too.
    return rows + [
        Row(what, own, "MB/s", name, ratios(beside["haploop"], each), more=True)
        for name, each in beside.items()
        if name != "haploop"
    ]


def _rate(way: Way, folder: Path, material: Material, blocks: int) -> float:
    """MB of int16 a second."""
    inside = Path(tempfile.mkdtemp(dir=folder))
    steps = way(inside, material, blocks)
    next(steps)
    began = time.perf_counter()
    for _ in steps:
        pass
    took = time.perf_counter() - began
    shutil.rmtree(inside)
    return blocks * 2e-6 * CHANNELS * material.samples / took


class Paced(Stream):
    """A card that delivers blocks at its pace; `given` is when it gave each."""

    channels = NAMES
    full_scale = FULL_SCALE
    delays = np.zeros(CHANNELS)

    def __init__(self, material: Material, rate_hz: float, seconds: float) -> None:
        self.material, self.rate_hz = material, rate_hz
        self.blocks = round(seconds * rate_hz / material.samples)
        self.given: list[float] = []

    def __iter__(self) -> Iterator[Block]:
        began = time.perf_counter()
        for i in range(self.blocks):
            due = began + (i + 1) * self.material.samples / self.rate_hz
            time.sleep(max(0.0, due - time.perf_counter()))
            self.given.append(time.perf_counter())
            yield self.material.block(i)

    def close(self) -> None:
        """Nothing to stop."""


@dataclass
class Run:
    path: Path
    written: list[float]
    """Times at which the kernel had each block (s)."""
    waiting: int
    """Largest number of blocks that waited."""
    core: float
    """Part of one core that the process used from the first block to the last, pace of the card included."""


def _record(folder: Path, stream: Paced, watch: Callable[[Writer], None] = lambda _writer: None) -> Run:
    path = Path(tempfile.mkdtemp(dir=folder)) / "P01-push.h5"
    run = Run(path, [], 0, 0.0)
    with (
        Writer(path, header(stream.rate_hz), stream.material.samples, stream.blocks) as writer,
        StreamReader(stream, RealClock()) as reader,
    ):
        watch(writer)
        busy, began = time.process_time(), time.perf_counter()
        for block in reader:
            run.waiting = max(run.waiting, reader.waiting)
            writer.write(block, 0.0)
            run.written.append(time.perf_counter())
        run.core = (time.process_time() - busy) / (time.perf_counter() - began)
        while writer.committed < writer.written:
            time.sleep(0.01)
    return run


def paper_rate(folder: Path, seconds: float) -> list[Row]:
    """Fraction of one core that recording uses at the paper's rate."""
    run = _record(folder, Paced(Material(250), PAPER_RATE, seconds))
    print(f"5 kS/s x 16 channels, {seconds:g} s: {100 * run.core:.2f} % of one core\n")
    return [
        Row("recording at 5 kS/s x 16 channels, no driver: CPU", [100 * run.core], "% of a core", goal="2 %")
    ]


def hundredfold(folder: Path, seconds: float) -> list[Row]:
    """A hundred times the paper's rate from a card that keeps its pace: does the file have all of it?"""
    stream = Paced(Material(25_000), 100 * PAPER_RATE, seconds)
    run = _record(folder, stream)
    codes = read_contents(run.path).codes
    lost = stream.blocks * 25_000 - codes.shape[1]
    whole = not lost and all(
        np.array_equal(codes[:, i * 25_000 : (i + 1) * 25_000], stream.material.codes[i % 8])
        for i in range(stream.blocks)
    )
    print(
        f"500 kS/s x 16 channels, {seconds:g} s: {lost} samples lost, "
        f"{'every sample as it was given' if whole else 'SAMPLES ARE WRONG'}, "
        f"at most {run.waiting} of 400 blocks waited, {100 * run.core:.0f} % of one core\n"
    )
    assert whole, "samples are wrong"
    return [
        Row("recording at 500 kS/s x 16 channels: samples lost", [lost], goal="0"),
    ]


def latency(folder: Path, seconds: float, busy: bool) -> list[Row]:
    """From the card's block to the kernel and to the disk, at the paper's rate."""
    stream = Paced(Material(250), PAPER_RATE, seconds)
    kept: list[float] = []
    stop = threading.Event()

    def look(writer: Writer) -> None:
        while not stop.wait(0.002):
            done, now = writer.committed // 250, time.perf_counter()
            kept.extend([now] * (done - len(kept)))

    watching: list[threading.Thread] = []

    def watch(writer: Writer) -> None:
        watching.append(threading.Thread(target=look, args=(writer,)))
        watching[0].start()

    with _hog(folder, busy):
        try:
            run = _record(folder, stream, watch)
        finally:
            time.sleep(0.01)
            stop.set()
            watching[0].join()
    given = np.array(stream.given)
    kernel = np.array(run.written) - given
    durable = np.array(kept[: len(given)]) - given[: len(kept)]
    middle, late, worst = (1e3 * float(np.percentile(kernel, part)) for part in (50, 99, 100))
    safe, safest = (1e3 * float(np.percentile(durable, part)) for part in (99, 100))
    print(
        f"5 kS/s x 16 channels, {seconds:g} s, {'another process writing to' if busy else 'quiet'} disk: "
        f"block to kernel {middle:.2f} ms (p50), {late:.2f} ms (p99), {worst:.1f} ms (worst); "
        f"to durable {safe:.0f} ms (p99), {safest:.0f} ms (worst); at most {run.waiting} of 400 blocks waited"
    )
    disk = ", another process writing" if busy else ""
    return [
        Row(f"block from card to kernel, 99 %{disk}", [late], "ms", goal="" if busy else "1 ms"),
        Row(f"block from card to disk, 99 %{disk}", [safe], "ms", goal="" if busy else "100 ms"),
    ]


_HOG = """
import os, sys
block = os.urandom(1 << 20)
while True:
    with open(sys.argv[1], "wb") as file:
        for _ in range(256):
            file.write(block)
        file.flush()
        os.fsync(file.fileno())
"""


@contextmanager
def _hog(folder: Path, busy: bool) -> Iterator[None]:
    """Another process that writes 256 MB, asks the disk to keep them, and begins again."""
    if not busy:
        yield
        return
    process = subprocess.Popen([sys.executable, "-c", _HOG, str(folder / "hog")])
    try:
        time.sleep(1.0)
        yield
    finally:
        process.kill()
        process.wait()


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


if __name__ == "__main__":
    main()
