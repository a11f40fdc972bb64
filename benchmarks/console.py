"""The console beside a recording of 16 channels: lost samples, updates a second, processor time, memory.

    python benchmarks/console.py --seconds 600 --browser

A simulated rig in real time with 16 channels of 5000 samples a second, recorded by the worker of
`haploop serve`, and a socket that takes every frame; with --browser the page Record in Chromium too, whose
own count of updates is read. What is on its way is the difference between the samples that the clock demands
and those that the server has; it holds the block of 40 ms that is being filled. `tap.py` measures what the
console costs the acquisition.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import Request, urlopen

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from websockets.sync.client import connect

from benchmarks.table import Row
from haploop.acquisition import Recording
from haploop.console.worker import Address

_EVERY = 3.1
"""s between two presses: the 200 of a session last for more than ten minutes."""
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


@contextmanager
def page(url: str, wanted: bool) -> Iterator[Callable[[], float]]:
    """The page Record in Chromium, as a function that reads its updates a second; NaN without one."""
    if not wanted:
        yield lambda: float("nan")
        return
    from playwright.sync_api import sync_playwright

    with sync_playwright() as program:
        browser = program.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
        )
        shown = browser.new_page()
        shown.goto(url)
        shown.goto(url.partition("#")[0] + "record")

        def rate() -> float:
            found = re.match(r"(\d+) updates", shown.locator("#rate").inner_text())
            return float(found[1]) if found else float("nan")

        yield rate
        browser.close()


def main(words: Sequence[str] | None = None) -> list[Row]:  # noqa: PLR0915  one run from beginning to end
    """Run the benchmark, print one line for each figure, and return those of the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600)
    parser.add_argument("--browser", action="store_true", help="show the page Record in Chromium too")
    options = parser.parse_args(words)
    seconds = options.seconds
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        environment = {**os.environ, "HAPLOOP_STATE": str(folder / "state")}
        given = ["--json", "--port", "0", "--data", str(folder), "--rig", str(rig(folder))]
        server = subprocess.Popen(
            [sys.executable, "-m", "haploop", "serve", *given],
            stdout=subprocess.PIPE,
            env=environment,
            text=True,
        )
        assert server.stdout is not None
        url = json.loads(server.stdout.readline())["url"]
        base, _, token = url.partition("/#")

        def command(what: str, **values: object) -> None:
            body = json.dumps(values).encode()
            headers = {"X-Haploop-Token": token}
            urlopen(Request(f"{base}/api/command/{what}", body, headers), timeout=60).close()

        address = Address.read(next((folder / "state" / "simulated").glob("console-*.json")))
        assert address is not None
        command("override", reason="a benchmark")
        command("auto", on=False)
        wanted = {"button": "latch", "participant": "P01", "presses": 200}
        command("start", kind="record", parameters=wanted)
        behind: list[float] = []
        memory: list[tuple[float, float, float, int]] = []
        drawn: list[float] = []
        at: list[float] = []
        with (
            page(url, options.browser) as rate,
            connect(base.replace("http", "ws") + "/socket", origin=base, max_size=None) as socket,
        ):
            socket.send(token)
            while not isinstance(socket.recv(), bytes):
                pass
            before = used(server.pid)[0], used(address.pid)[0]
            begin = time.monotonic()
            pressed = 0
            while (now := time.monotonic() - begin) < seconds:
                if now > _EVERY * (pressed + 1):
                    pressed += 1
                    with suppress(HTTPError):  # the session asks for no press at this moment
                        command("press")
                message = socket.recv(timeout=30)
                if isinstance(message, bytes):
                    at.append(now)
                    continue
                scope = json.loads(message).get("scope")
                if scope and scope.get("received"):
                    rate_hz = scope["rate_hz"]
                    behind.append(1e3 * (scope["expected"] - scope["received"]) / rate_hz)
                    if memory and now - memory[-1][0] < 1:
                        continue
                    memory.append((now, used(server.pid)[1], used(address.pid)[1], scope["missed_here"]))
                    drawn.append(rate())
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
        every = np.bincount(np.array(at, int), minlength=int(seconds))[: int(seconds)]
        print(
            f"updates a second: {len(at) / seconds:.1f}; in each second, 1st percentile and least:", end=" "
        )
        print(*np.percentile(every, [1, 0]))
        print("longest time between two (ms):", round(1e3 * float(np.diff(at).max())))
        if options.browser:
            print("updates a second by the page's own count, median, 1st percentile, least:", end=" ")
            print(*np.nanpercentile(drawn, [50, 1, 0]))
        print("on its way (ms), median, p99, max:", *np.round(np.percentile(behind, [50, 99, 100])))
        print(
            "processor, server and worker (%):",
            *(f"{100 * (b - a) / seconds:.1f}" for a, b in zip(before, after, strict=True)),
        )
        for process, column in (("server", 1), ("worker", 2)):
            held = [memory[min(len(memory) - 1, len(memory) * part // 10)][column] for part in range(11)]
            print(f"memory of the {process} (MB), each tenth of the time:", *(f"{one:.0f}" for one in held))
        print("presses judged:", len(recording.verdicts))
        what = f"console beside a recording of {seconds:g} s x 16 channels"
        return [
            Row(f"{what}: samples lost", [float(np.count_nonzero(gaps) + memory[-1][3])], goal="0"),
            Row(f"{what}: updates a second", [len(at) / seconds], goal=">= 20", more=True),
            Row(f"{what}: block on its way to the page, 99 %", [float(np.percentile(behind, 99))], "ms"),
            Row(f"{what}: CPU of the server", [100 * (after[0] - before[0]) / seconds], "% of a core"),
        ]


if __name__ == "__main__":
    main()
