"""The NI driver on the simulated server, in real time: processor time of both, and how far the reading lags.

    python benchmarks/server.py                     # two minutes
    python benchmarks/server.py --against OTHER/bin/python

16 channels of two cards at 5000 samples a second, in blocks of 10 and of 50 ms, read by haploop's driver and
by plain nidaqmx on the same server (two tasks, no check of clocks), one after the other in each round. The
server simulates the plant as well. "Behind" is how much later the last block came than its last sample was
due.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).parents[1]))

import grpc
import nidaqmx
import numpy as np
from nidaqmx.constants import AcquisitionType
from nidaqmx.stream_readers import AnalogMultiChannelReader

import haploop
from benchmarks.console import rig, used
from benchmarks.processes import spread
from haploop.instruments.clock import RealClock
from haploop.instruments.config.rig_file import validate
from haploop.instruments.daq.ni_daqmx import NiDaq

RATE = 5000.0


def main() -> None:
    """Serve, read in rounds, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--against", metavar="PYTHON", help="whose server is another haploop's")
    asked = parser.parse_args()
    servers = {"this server": sys.executable}
    if asked.against:
        servers["other server"] = asked.against
    ways: dict[str, Callable[[int, Path, float, int], float]] = {"haploop": ours, "nidaqmx": plain}
    found: dict[tuple[str, str, int], list[tuple[float, float, float]]] = {}
    with tempfile.TemporaryDirectory() as name:
        file = rig(Path(name))
        for _ in range(asked.rounds):
            for server, python in servers.items():
                for size in (50, 250):
                    for way, read in ways.items():
                        row = measured(python, file, asked.seconds, size, read)
                        found.setdefault((server, way, size), []).append(row)
    print("| blocks | server | client | client: part of a core | server: part of a core | most behind, s |")
    print("|---|---|---|---|---|---|")
    for (server, way, size), rows in found.items():
        own, its, behind = zip(*rows, strict=True)
        shares = " | ".join(f"{100 * median(each):.0f} %" for each in (own, its))
        print(f"| {1e3 * size / RATE:.0f} ms | {server} | {way} | {shares} | {spread(behind)} |")


def measured(
    python: str, file: Path, seconds: float, size: int, read: Callable[[int, Path, float, int], float]
) -> tuple[float, float, float]:
    """Parts of a core of client and server, and the lag (s) at the end, of one acquisition."""
    command = [python, "-m", "haploop", "twin", "ni", "--rig", str(file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            port = int(re.findall(r"\d+", server.stdout.readline())[-1])
            before, own, began = used(server.pid)[0], time.process_time(), time.perf_counter()
            behind = read(port, file, seconds, size)
            took = time.perf_counter() - began
            return (time.process_time() - own) / took, (used(server.pid)[0] - before) / took, behind
        finally:
            server.terminate()


def ours(port: int, file: Path, seconds: float, size: int) -> float:
    """Read with haploop's driver."""
    described = haploop.load_rig_file(file).daq.settings
    settings = validate(NiDaq.Settings, {**described, "server": f"127.0.0.1:{port}"}, "daq")
    daq = NiDaq.open(settings, RealClock())
    try:
        with daq.stream([*settings.channels], RATE, size, None) as stream:
            began = time.perf_counter()
            for block in stream:
                if block.end >= seconds * RATE:
                    break
            return time.perf_counter() - began - block.end / RATE
    finally:
        daq.close()


def plain(port: int, file: Path, seconds: float, size: int) -> float:
    """Read the same channels with nidaqmx alone."""
    channels = haploop.load_rig_file(file).daq.settings["channels"]
    terminals = sorted(channel["terminal"] for channel in channels.values())
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
        began, done = time.perf_counter(), 0
        while done < seconds * RATE:
            for _, reader, into in tasks:
                reader.read_many_sample(into, size, 10.0)
            done += size
        behind = time.perf_counter() - began - done / RATE
        for task, _, _ in tasks:
            task.close()
    return behind


if __name__ == "__main__":
    main()
