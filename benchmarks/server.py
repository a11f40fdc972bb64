"""The NI driver on the simulated server, in real time: processor time of both, and how far the reading lags.

    python benchmarks/server.py                     # two minutes; Linux

16 channels of two cards at 5000 samples a second, in blocks of 10 and of 50 ms, read by haploop's driver and
by plain nidaqmx on the same server (two tasks, no check of clocks), one after the other in each round; and
the same into a file: haploop's recording, and h5py to which each block is appended and flushed. The client's
part of a core counts from the start of the acquisition to its last block; making tasks, checking the rig and
closing it are "beside". The server simulates the plant as well. "Behind" is how much later the last block
came than its last sample was due.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).parents[1]))

import grpc
import h5py
import nidaqmx
import numpy as np
from nidaqmx.constants import AcquisitionType
from nidaqmx.stream_readers import AnalogMultiChannelReader

import haploop
from benchmarks.contestants import header
from benchmarks.processes import spread
from benchmarks.table import Row, ratios
from haploop.acquisition.recording.writer import Writer
from haploop.acquisition.session.recorder import StreamReader
from haploop.base.arrays import FloatArray
from haploop.base.clock import RealClock
from haploop.base.validation import validate
from haploop.instruments import Stream
from haploop.instruments.daq.ni_daqmx import NiDaq

RATE = 5000.0
RIG = """
base = "simulated"
name = "sixteen"
[daq.channels]
{channels}
[sensors.extra]
{sensors}
"""


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Serve, read in rounds, print the table, and return its figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=8.0)
    asked = parser.parse_args(words)
    found: dict[tuple[int, str], list[tuple[float, float, float, float]]] = {}
    with tempfile.TemporaryDirectory() as name:
        file = rig(Path(name))
        for _ in range(asked.rounds):
            for size in (50, 250):
                for way, read in WAYS.items():
                    found.setdefault((size, way), []).append(measured(file, asked.seconds, size, read))
    print("| blocks | client | client: part of a core | server: part of a core | behind, s | beside, CPU s |")
    print("|---|---|---|---|---|---|")
    for (size, way), figures in found.items():
        own, its, behind, beside = zip(*figures, strict=True)
        shares = " | ".join(f"{100 * median(each):.1f} %" for each in (own, its))
        print(f"| {1e3 * size / RATE:.0f} ms | {way} | {shares} | {spread(behind)} | {median(beside):.2f} |")
    rows = []
    for size in (50, 250):
        blocks = f"{1e3 * size / RATE:.0f} ms blocks x 16 channels"
        for way, peer in PEERS.items():
            own, theirs = ([100 * one[0] for one in found[size, which]] for which in (way, peer))
            what = f"NI driver{way.removeprefix('haploop')}, {blocks}: CPU of the client"
            rows.append(Row(what, own, "% of a core", peer, ratios(own, theirs)))
        driver = found[size, "haploop"]
        goal = "50 %" if size == 50 else ""
        rows.append(
            Row(f"simulated NI server, {blocks}: CPU", [100 * x[1] for x in driver], "% of a core", goal=goal)
        )
        rows.append(
            Row(f"the same: behind real time at the end, {asked.seconds:g} s", [x[2] for x in driver], "s")
        )
    return rows


def rig(folder: Path) -> Path:
    """Write a rig file with six channels more than the ten of a recording."""
    names = [f"more{k}" for k in range(6)]
    channels = "\n".join(
        f'{n} = {{ terminal = "Dev2/ai{6 + k}", range = 5, config = "rse" }}' for k, n in enumerate(names)
    )
    sensors = "\n".join(f'{n} = {{ channel = "{n}", scale = 1.0, unit = "V" }}' for n in names)
    path = folder / "sixteen.toml"
    path.write_text(RIG.format(channels=channels, sensors=sensors), encoding="utf-8")
    return path


def used(pid: int) -> float:
    """Processor time of a process (s); Linux."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Reading:
    """What an acquisition has used up so far, from its first sample on (s)."""

    began: float = field(default_factory=time.perf_counter)
    used: float = field(default_factory=time.process_time)

    def after(self, samples: int) -> tuple[float, float]:
        """Part of a core, and how much later than due these samples are there (s)."""
        took = time.perf_counter() - self.began
        return (time.process_time() - self.used) / took, took - samples / RATE


Read = Callable[[int, Path, float, int], tuple[float, float]]


def measured(file: Path, seconds: float, size: int, read: Read) -> tuple[float, float, float, float]:
    """Parts of a core of client and server, the lag (s) at the end, and the client's CPU beside it (s)."""
    command = [sys.executable, "-m", "haploop", "twin", "ni", "--rig", str(file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            port = int(re.findall(r"\d+", server.stdout.readline())[-1])
            before, own, began = used(server.pid), time.process_time(), time.perf_counter()
            share, behind = read(port, file, seconds, size)
            beside = time.process_time() - own - share * (seconds + behind)
            return share, (used(server.pid) - before) / (time.perf_counter() - began), behind, beside
        finally:
            server.terminate()


def recorded(file: Path) -> list[str]:
    """The 16 channels that a recording reads, of the 18 that the rig has."""
    return list(haploop.load_rig_file(file).sensors.recorded)


@contextmanager
def driver(port: int, file: Path, size: int) -> Iterator[Stream]:
    """Stream of haploop's driver."""
    described = haploop.load_rig_file(file).daq.settings
    settings = validate(NiDaq.Settings, {**described, "server": f"127.0.0.1:{port}"}, "daq")
    daq = NiDaq.open(settings, RealClock())
    try:
        with daq.stream(recorded(file), RATE, size, None) as stream:
            yield stream
    finally:
        daq.close()


def ours(port: int, file: Path, seconds: float, size: int) -> tuple[float, float]:
    """Read with haploop's driver."""
    with driver(port, file, size) as stream:
        reading = Reading()
        for block in stream:
            if block.end >= seconds * RATE:
                break
        return reading.after(block.end)


def ours_kept(port: int, file: Path, seconds: float, size: int) -> tuple[float, float]:
    """The same into a recording's file, by a thread that reads and one that writes, as `record` does."""
    with tempfile.TemporaryDirectory(dir=file.parent) as folder, driver(port, file, size) as stream:
        about = replace(
            header(RATE), channels=stream.channels, full_scale=stream.full_scale, delays=stream.delays
        )
        blocks = round(seconds * RATE / size)
        with (
            Writer(Path(folder) / "P01-push.h5", about, size, blocks) as writer,
            StreamReader(stream, RealClock()) as reader,
        ):
            reading = Reading()
            for block in reader:
                writer.write(block, 0.0)
                if writer.written >= blocks * size:
                    break
            return reading.after(writer.written)


def plain(
    port: int,
    file: Path,
    seconds: float,
    size: int,
    keep: Callable[[list[FloatArray]], object] = len,
) -> tuple[float, float]:
    """Read the same channels with nidaqmx alone."""
    channels = haploop.load_rig_file(file).daq.settings["channels"]
    terminals = sorted(channels[name]["terminal"] for name in recorded(file))
    with grpc.insecure_channel(f"127.0.0.1:{port}") as line:
        tasks = []
        for card in sorted({terminal.split("/")[0] for terminal in terminals}):
            task = nidaqmx.Task(grpc_options=nidaqmx.GrpcSessionOptions(line, ""))
            mine = [terminal for terminal in terminals if terminal.startswith(f"{card}/")]
            for terminal in mine:
                task.ai_channels.add_ai_voltage_chan(terminal, min_val=-5, max_val=5)
            task.timing.cfg_samp_clk_timing(
                RATE, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=50_000
            )
            tasks.append((task, AnalogMultiChannelReader(task.in_stream), np.empty((len(mine), size))))
        for task, _, _ in tasks:
            task.start()
        reading, done = Reading(), 0
        while done < seconds * RATE:
            for _, reader, into in tasks:
                reader.read_many_sample(into, size, 10.0)
            keep([into for _, _, into in tasks])
            done += size
        found = reading.after(done)
        for task, _, _ in tasks:
            task.close()
    return found


def plain_kept(port: int, file: Path, seconds: float, size: int) -> tuple[float, float]:
    """The same into an h5py data set that grows, flushed after each block so that a kill loses little."""
    with tempfile.TemporaryDirectory(dir=file.parent) as folder, h5py.File(f"{folder}/volts.h5", "w") as kept:
        data = kept.create_dataset("volts", (16, 0), "f8", maxshape=(16, None), chunks=(16, size))

        def keep(parts: list[FloatArray]) -> None:
            data.resize(data.shape[1] + size, axis=1)
            data[:, -size:] = np.concatenate(parts)
            kept.flush()

        return plain(port, file, seconds, size, keep)


WAYS = {
    "haploop": ours,
    "nidaqmx": plain,
    "haploop to a file": ours_kept,
    "nidaqmx and h5py": plain_kept,
}
PEERS = {"haploop": "nidaqmx", "haploop to a file": "nidaqmx and h5py"}


if __name__ == "__main__":
    main()
