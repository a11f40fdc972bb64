"""Every benchmark in a short form, into one document: `python benchmarks/all.py --out RESULTS`.

    python benchmarks/all.py
    python benchmarks/all.py --only start twin
    python benchmarks/all.py --against OTHER/bin/python     # start, demo, server beside another environment

The short forms show that a figure is still of the size that README.md states; what README.md states comes
from the long forms. Every benchmark runs by itself, one after the other; those that have peers run them in
their own rounds. Exits with 1 when a benchmark failed.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import time
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

HERE = Path(__file__).parent
SHORT = {
    "start": "--rounds 3",
    "demo": "--rounds 2 --participants 1 4",
    "twin": "--rounds 5 --presses 5",
    "server": "--rounds 1 --seconds 5",
    "recording": "--rounds 3 --megabytes 32 --seconds 4",
    "tap": "--rounds 2 --seconds 2",
    "console": "--seconds 20",
    "representative": "--seeds 100 --families tempo",
    "fits": "--count 4",
    "responses": "--seeds 1",
    "uncertainty": "--plants 4 --settled 1 --sweeps 1",
    "drives": "--seeds 1 --plays 4",
    "recalibration": "--tables 1 --part 1/30 --restore 100 --iterations 0",
}
"""Arguments that make each benchmark take a minute or a few."""


def main() -> int:
    """Run them, and print or write what they said."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", nargs="+", choices=SHORT, default=list(SHORT))
    parser.add_argument("--against", metavar="PYTHON", help="of an environment with another haploop")
    parser.add_argument("--out", type=Path, help="a Markdown file, written anew")
    asked = parser.parse_args()
    packages = ", ".join(f"{name} {metadata.version(name)}" for name in ("numpy", "scipy", "h5py"))
    parts = [
        f"Python {platform.python_version()}, {packages}; {platform.platform()}, {os.cpu_count()} cores.",
        "| benchmark | arguments | began (UTC) | load | CPU s | s | ended |\n|---|---|---|---|---|---|---|",
    ]
    failed = False
    for name in asked.only:
        arguments = SHORT[name]
        if asked.against and name in ("start", "demo", "server"):
            arguments += f" --against {asked.against}"
        began, clock, before = datetime.now(UTC), time.monotonic(), os.times()
        load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
        print(f"{name} {arguments}", file=sys.stderr, flush=True)
        done = subprocess.run(
            [sys.executable, "-m", f"benchmarks.{name}", *arguments.split()],
            cwd=HERE.parent,
            capture_output=True,
            text=True,
            check=False,
        )
        after = os.times()
        cpu = after.children_user + after.children_system - before.children_user - before.children_system
        ended = "" if done.returncode == 0 else f"with {done.returncode}"
        failed |= bool(done.returncode)
        parts[1] += (
            f"\n| {name} | `{SHORT[name]}` | {began:%Y-%m-%d %H:%M} | {load} | {cpu:.0f} | "
            f"{time.monotonic() - clock:.0f} | {ended} |"
        )
        parts.append(f"## {name}\n\n{done.stdout.strip()}")
        if done.returncode:
            parts.append(f"```\n{done.stderr.strip()[-2000:]}\n```")
    text = "\n\n".join(parts) + "\n"
    if asked.out:
        asked.out.write_text(text, encoding="utf-8")
    else:
        print(text)
    return int(failed)


if __name__ == "__main__":
    raise SystemExit(main())
