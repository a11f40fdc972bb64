"""Cost of a live view to a recording: `python benchmarks/tap.py`.

A card that keeps its pace (500 kS/s x 16 channels, 100 times the paper's rate) through the reader's thread
into a file, without a tap and with each kind of viewer, one after the other in each round. Needs signals that
stop a process, so it does not run on Windows. See README.md.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from benchmarks.contestants import NAMES, Material, header
from benchmarks.recording import PAPER_RATE, Paced
from benchmarks.table import Row, ratios
from haploop.acquisition.recording.salvage import read_contents
from haploop.acquisition.recording.writer import Writer
from haploop.acquisition.session.recorder import StreamReader
from haploop.base.clock import RealClock
from haploop.instruments import Sensors
from haploop.instruments.live import Feed, Publisher, Run

SENSORS = Sensors.model_validate(
    {"extra": {f"s{k}": {"channel": name, "scale": 1.0, "unit": "V"} for k, name in enumerate(NAMES)}}
)
"""Each channel is shown."""
_CLIENT = """
import sys, time
from haploop.instruments import watch_live
with watch_live("simulated", address=sys.argv[1]) as tap:
    print("ready", flush=True)
    for block in tap:
        time.sleep(float(sys.argv[2]))
"""


@contextmanager
def nobody(_feed: Feed, _folder: Path) -> Iterator[None]:
    yield


@contextmanager
def published(feed: Feed, folder: Path) -> Iterator[None]:
    """Published, and nobody looks: what every command does."""
    with Publisher(feed, "simulated", folder):
        yield


@contextmanager
def in_process(feed: Feed, _folder: Path, pause: float = 0.0) -> Iterator[None]:
    with feed.tap() as tap:
        viewer = threading.Thread(target=lambda: [time.sleep(pause) for _ in tap], daemon=True)
        viewer.start()
        yield
    viewer.join()
    print(f"    {tap.dropped} blocks dropped")


@contextmanager
def in_process_slow(feed: Feed, folder: Path) -> Iterator[None]:
    with in_process(feed, folder, 0.5):
        yield


@contextmanager
def client(
    feed: Feed, folder: Path, pause: float = 0.0, after: signal.Signals | None = None
) -> Iterator[None]:
    """A viewer in another process; `after` is sent to it when the recording has run for half a second."""
    with Publisher(feed, "simulated", folder) as publisher:
        command = [sys.executable, "-c", _CLIENT, str(publisher.path), str(pause)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            try:
                assert process.stdout is not None
                assert process.stdout.readline() == "ready\n"
                if after is not None:
                    timer = threading.Timer(0.5, process.send_signal, (after,))
                    timer.start()
                yield
            finally:
                process.kill()


@contextmanager
def client_slow(feed: Feed, folder: Path) -> Iterator[None]:
    with client(feed, folder, 0.5):
        yield


@contextmanager
def client_stopped(feed: Feed, folder: Path) -> Iterator[None]:
    with client(feed, folder, after=signal.SIGSTOP):
        yield


@contextmanager
def client_killed(feed: Feed, folder: Path) -> Iterator[None]:
    with client(feed, folder, after=signal.SIGKILL):
        yield


@contextmanager
def garbage(feed: Feed, folder: Path) -> Iterator[None]:
    """Connections without a token, and with one and then noise, again and again."""
    ended = threading.Event()

    def disturb(publisher: Publisher) -> None:
        token = json.loads(publisher.path.read_text())["token"].encode()
        while not ended.wait(0.02):
            for greeting in (os.urandom(4096), token + os.urandom(4096)):
                try:
                    with socket.create_connection(("127.0.0.1", publisher.port), timeout=1) as link:
                        link.sendall(greeting)
                except OSError:
                    pass

    with Publisher(feed, "simulated", folder) as publisher:
        thread = threading.Thread(target=disturb, args=(publisher,))
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()


_CONSOLE = """
import asyncio, json, sys, tempfile, threading, time
from pathlib import Path
import uvicorn
from websockets.sync.client import connect
from haploop.console.data_folder import DataFolder
from haploop.console.server import Access, application
from haploop.console.server.follower import Follower
from haploop.console.server.follower import LiveScope
from haploop.console.server.serving import _bound
from haploop.console.worker import Address
from haploop.instruments import load_rig_file

class Worker:
    address = Address(1, 9, "-", "-", "-")
    def state(self, after=0):
        time.sleep(0.1 if after == 0 else 5)
        return {"version": 1, "live": sys.argv[1]}
    def allow(self, origins): pass

listener = _bound("127.0.0.1", 0)
access = Access("127.0.0.1", listener.getsockname()[1])
follower = Follower(Worker(), Worker, LiveScope(load_rig_file("simulated"), None))
folder = Path(tempfile.mkdtemp())
app = application(access, follower, follower.scope, DataFolder(folder, folder / "history"))
config = uvicorn.Config(app, log_level="error", ws="websockets-sansio")
threading.Thread(target=uvicorn.Server(config).run, args=([listener],), daemon=True).start()
time.sleep(1)
origin = access.origins[0]
with connect(origin.replace("http", "ws") + "/socket", origin=origin, max_size=None) as page:
    page.send(access.token)
    print("ready", flush=True)
    while True:
        page.recv()
"""


@contextmanager
def console(feed: Feed, folder: Path) -> Iterator[None]:
    """The console's server in another process, with a page that takes every frame."""
    with Publisher(feed, "simulated", folder) as publisher:
        command = [sys.executable, "-c", _CONSOLE, str(publisher.path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            try:
                assert process.stdout is not None
                assert process.stdout.readline() == "ready\n"
                yield
            finally:
                process.kill()


Viewer = Callable[[Feed, Path], AbstractContextManager[None]]

VIEWERS: dict[str, Viewer] = {
    "no tap": nobody,
    "published, nobody looks": published,
    "in process, fast": in_process,
    "in process, 0.5 s a block": in_process_slow,
    "other process, fast": client,
    "other process, 0.5 s a block": client_slow,
    "other process, stopped (SIGSTOP)": client_stopped,
    "other process, killed": client_killed,
    "garbage, 100 connections a second": garbage,
    "the console's server and a page": console,
}


def record(folder: Path, viewer: Viewer, seconds: float, times: float) -> dict[str, float]:
    """Lateness of each block with the kernel (ms), samples lost, most blocks that waited, part of a core."""
    samples = round(250 * times)
    stream = Paced(Material(samples), times * PAPER_RATE, seconds)
    feed, inside = Feed(), Path(tempfile.mkdtemp(dir=folder))
    run = Run("simulated", True, "record", "", NAMES, stream.rate_hz, SENSORS, None)
    path, written, waiting = inside / "P01-push.h5", [], 0
    with viewer(feed, inside):
        publish = feed.begin(run)
        with (
            Writer(path, header(stream.rate_hz), samples, stream.blocks) as writer,
            StreamReader(stream, RealClock()) as reader,
        ):
            busy, began = time.process_time(), time.perf_counter()
            for block in reader:
                waiting = max(waiting, reader.waiting)
                writer.write(block, 0.0)
                written.append(time.perf_counter())
                publish(block)
            core = (time.process_time() - busy) / (time.perf_counter() - began)
        feed.close()
    codes = read_contents(path).codes
    wrong = sum(
        not np.array_equal(codes[:, i * samples : (i + 1) * samples], stream.material.codes[i % 8])
        for i in range(stream.blocks)
    )
    shutil.rmtree(inside)
    late = 1e3 * (np.array(written) - np.array(stream.given))
    return {
        "lost": float(wrong),
        "median": float(np.median(late)),
        "p99": float(np.percentile(late, 99)),
        "worst": float(late.max()),
        "waiting": float(waiting),
        "core": 100 * core,
    }


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Record in rounds, print the table, and return its figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=5.0, help="length of each recording")
    parser.add_argument("--times", type=float, default=100.0, help="times the paper's rate")
    parser.add_argument(
        "--only", nargs="*", choices=VIEWERS, help="these viewers; the first is the reference"
    )
    parser.add_argument("--folder", type=Path, default=Path.cwd(), help="on the disk to be measured")
    options = parser.parse_args(words)
    viewers = {name: VIEWERS[name] for name in options.only or VIEWERS}
    found: dict[str, list[dict[str, float]]] = {name: [] for name in viewers}
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        for _ in range(options.rounds):
            for name, viewer in viewers.items():
                found[name].append(record(Path(folder), viewer, options.seconds, options.times))
    print(
        f"{5 * options.times:g} kS/s x 16 channels, {options.rounds} x {options.seconds:g} s each; "
        "lateness in ms"
    )
    print(f"{'viewer':36} wrong  median (ratio)      p99 (ratio)     worst  waited  core")
    for name, rounds in found.items():
        middles = {
            key: statistics.median(
                r[key] / base[key] for r, base in zip(rounds, found[next(iter(viewers))], strict=True)
            )
            for key in ("median", "p99")
        }
        middle = {key: statistics.median(r[key] for r in rounds) for key in rounds[0]}
        print(
            f"{name:36} {sum(r['lost'] for r in rounds):5.0f}  "
            f"{middle['median']:6.2f} ({middles['median']:4.2f})   "
            f"{middle['p99']:8.2f} ({middles['p99']:5.2f})  "
            f"{max(r['worst'] for r in rounds):8.1f}  {max(r['waiting'] for r in rounds):6.0f}  "
            f"{middle['core']:3.0f} %"
        )
    rows = []
    first = next(iter(viewers))
    for name in list(viewers)[1:]:
        late, alone = ([one["median"] for one in found[which]] for which in (name, first))
        what = f"block to kernel, median; live view: {name}"
        rows.append(Row(what, late, "ms", first, ratios(late, alone)))
    wrong = sum(one["lost"] for each in found.values() for one in each)
    return [*rows, Row("blocks lost or wrong under all live views", [wrong], goal="0")]


if __name__ == "__main__":
    main()
