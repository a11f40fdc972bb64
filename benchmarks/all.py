"""Every benchmark in a short form, into one table: `python benchmarks/all.py --out RESULTS`.

    python benchmarks/all.py
    python benchmarks/all.py --only start fits
    python benchmarks/all.py --long                         # each with what it does by default; hours

Every benchmark runs in a process of its own, one after the other; peers have their turn in the same rounds.
What each printed follows the table. Exits with 1 when a benchmark failed.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import multiprocessing
import os
import platform
import sys
import time
import traceback
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.table import Row, markdown

SHORT = {
    "recording": "--rounds 5 --megabytes 128 --seconds 4",
    "server": "--rounds 3 --seconds 5",
    "tap": "--rounds 3 --seconds 2",
    "calls": "--rounds 5",
    "start": "--rounds 5",
    "representative": "--seeds 100 101 --families tempo",
    "corpus": "36",
    "responses": "--seeds 5",
    "fits": "--count 5",
    "uncertainty": "--plants 4 --settled 1 --sweeps 1",
    "drives": "--seeds 1 --plays 4 --only beside",
    "patches": "--seeds 1 --plays 3",
    "points": "--tables 1",
    "people": "",
    "recalibration": "--tables 1 --part 1/30 --restore 100 --iterations 0",
}
"""Arguments that make each benchmark take a minute or a few."""
LONG = dict.fromkeys(SHORT, "") | {"corpus": "360 3600"}


def main() -> int:
    """Run them, and print or write the table and what they said."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", nargs="+", choices=SHORT, default=list(SHORT))
    parser.add_argument("--long", action="store_true", help="each with what it does by default")
    parser.add_argument("--out", type=Path, help="a Markdown file, written anew after each benchmark")
    asked = parser.parse_args()
    packages = ", ".join(f"{name} {metadata.version(name)}" for name in ("numpy", "scipy", "h5py"))
    about = f"Python {platform.python_version()}, {packages}; {platform.platform()}, {os.cpu_count()} cores."
    took = [
        "| benchmark | arguments | began (UTC) | load | CPU s | s | ended |",
        "|---|---|---|---|---|---|---|",
    ]
    rows: list[Row] = []
    said: list[str] = []
    for name in asked.only:
        arguments = (LONG if asked.long else SHORT)[name]
        print(name, arguments, file=sys.stderr, flush=True)
        began, clock, before, load = datetime.now(UTC), time.monotonic(), os.times(), os.getloadavg()[0]
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(1, mp_context=context) as process:
            found, text, failure = process.submit(run, name, arguments.split()).result()
        after = os.times()
        cpu = after.children_user + after.children_system - before.children_user - before.children_system
        took.append(
            f"| {name} | `{arguments}` | {began:%Y-%m-%d %H:%M} | {load:.1f} | {cpu:.0f} | "
            f"{time.monotonic() - clock:.0f} | {failure} |"
        )
        rows += found
        said.append(f"## {name}\n\n{text.strip()}")
        document = "\n\n".join([about, markdown(rows), "\n".join(took), *said]) + "\n"
        if asked.out:
            asked.out.write_text(document, encoding="utf-8")
    if not asked.out:
        print(document)
    return int(any(not line.endswith("|  |") for line in took[2:]))


def run(name: str, arguments: list[str]) -> tuple[list[Row], str, str]:
    """The rows of one benchmark, what it printed, and the last line of what went wrong, if anything did."""
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed):
            return importlib.import_module(f"benchmarks.{name}").main(arguments), printed.getvalue(), ""
    except BaseException as error:  # also an exit; the others are to have their turn
        traceback.print_exc()
        return [], printed.getvalue(), f"{type(error).__name__}: {error}".splitlines()[0]


if __name__ == "__main__":
    raise SystemExit(main())
