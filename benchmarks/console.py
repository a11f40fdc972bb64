"""The console beside a recording of 16 channels: lost samples, updates a second, processor time, memory.

    python benchmarks/console.py --seconds 600

A simulated rig in real time with 16 channels of 5000 samples a second, recorded by the worker of
`haploop serve`; a browser's part is played by a socket that takes every frame. What is on its way is the
difference between the samples that the clock demands and those that the server has; it holds the block of
50 ms that is being filled.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from urllib.request import Request, urlopen

import numpy as np
from websockets.sync.client import connect

from haploop.acquisition import Recording
from haploop.console.worker import Address

RIG = """
base = "simulated"
name = "sixteen"
[daq.channels]
{channels}
[sensors.extra]
{sensors}
"""


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


def used(pid: int) -> tuple[float, float]:
    """Processor time (s) and resident memory (MB) of a process; Linux."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    ticks = int(fields[11]) + int(fields[12])
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    found = re.search(r"VmRSS:\s+(\d+)", status)
    return ticks / os.sysconf("SC_CLK_TCK"), int(found[1]) / 1e3 if found else float("nan")


def main() -> None:  # noqa: PLR0915  one run from beginning to end
    """Run the benchmark, and print one line for each figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600)
    seconds = parser.parse_args().seconds
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        environment = {**os.environ, "HAPLOOP_STATE": str(folder / "state")}
        options = ["--json", "--port", "0", "--data", str(folder), "--rig", str(rig(folder))]
        server = subprocess.Popen(
            [sys.executable, "-m", "haploop", "serve", *options],
            stdout=subprocess.PIPE,
            env=environment,
            text=True,
        )
        assert server.stdout is not None
        base, _, token = json.loads(server.stdout.readline())["url"].partition("/#")

        def command(what: str, **values: object) -> None:
            body = json.dumps(values).encode()
            headers = {"X-Haploop-Token": token}
            urlopen(Request(f"{base}/api/command/{what}", body, headers), timeout=60).close()

        address = Address.read(next((folder / "state" / "simulated").glob("console-*.json")))
        assert address is not None
        command("override", reason="a benchmark")
        wanted = {"button": "latch", "participant": "P01", "presses": 200}
        command("start", kind="record", parameters=wanted)
        frames, behind, memory = 0, [], []
        with connect(base.replace("http", "ws") + "/socket", origin=base, max_size=None) as socket:
            socket.send(token)
            while not isinstance(socket.recv(), bytes):
                pass
            before = used(server.pid)[0], used(address.pid)[0]
            begin = time.monotonic()
            while (now := time.monotonic() - begin) < seconds:
                message = socket.recv(timeout=30)
                if isinstance(message, bytes):
                    frames += 1
                    continue
                scope = json.loads(message).get("scope")
                if scope and scope.get("received"):
                    rate_hz = scope["rate_hz"]
                    behind.append(1e3 * (scope["expected"] - scope["received"]) / rate_hz)
                    memory.append((now, used(server.pid)[1], used(address.pid)[1], scope["missed_here"]))
            after = used(server.pid)[0], used(address.pid)[0]
        headers = {"X-Haploop-Token": token}
        with urlopen(Request(f"{base}/api/stop", b"", headers), timeout=60) as answer:
            print("STOP:", json.loads(answer.read())["sentence"])
        server.terminate()
        server.wait(60)
        recording = Recording.open(folder / "recordings" / "P01-latch.h5")
        blocks = recording.blocks
        gaps = np.diff(blocks["first"]) - blocks["count"][:-1]
        size = len(recording.channels), recording.rate_hz, recording.duration
        print("{} channels, {:g} Hz, {:.0f} s on disk".format(*size))
        print(f"gaps in the file: {np.count_nonzero(gaps)}; missing in the view: {memory[-1][3]} samples")
        print(f"updates a second: {frames / seconds:.1f}")
        print("on its way (ms), median, p99, max:", *np.round(np.percentile(behind, [50, 99, 100])))
        print(
            "processor, server and worker (%):",
            *(f"{100 * (b - a) / seconds:.1f}" for a, b in zip(before, after, strict=True)),
        )
        early, late = memory[len(memory) // 10], memory[-1]
        print(f"memory (MB), server {early[1]:.0f} -> {late[1]:.0f}, worker {early[2]:.0f} -> {late[2]:.0f}")


if __name__ == "__main__":
    main()
