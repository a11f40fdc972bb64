"""Processor time and memory of commands on small files: what a person waits for before anything is measured.

    python benchmarks/start.py                              # a few minutes; not on Windows

Prints Markdown. `tests/commands/test_start.py` holds what each command may load, which does not depend on a
machine.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.processes import haploop, in_rounds, spread
from benchmarks.table import Row, ratios

COMMANDS = {
    "--help": "--help",
    "--version": "--version",
    "record --help": "record --help",
    "schema": "schema",
    "log": "log",
    "verify FILE": "verify P01-latch.h5",
    "show RECORDING": "show P01-latch.h5",
    "show CALIBRATION": "show calibration.h5",
    "show RECORDING --plot PNG": "show P01-latch.h5 --plot NEW.png",
    "list": "list --in .",
    "export RECORDING --to csv": "export P01-latch.h5 --to csv --out NEW.csv",
    "doctor, simulated": "doctor",
    "record, one press, simulated": "record latch -p P02 -n 1 --out NEW",
    "report CALIBRATION": "report calibration.h5 -o NEW.html",
}


GOALS = {"--help": 0.25, "schema": 0.8, "log": 0.8, "doctor, simulated": 1.5} | dict.fromkeys(
    ("verify FILE", "show RECORDING", "show CALIBRATION"), 0.8
)
"""CPU s."""
PEERS = {
    "a script that imports numpy, scipy.signal and h5py": "import numpy, scipy.signal, h5py",
    "the same and matplotlib.pyplot": "import numpy, scipy.signal, h5py, matplotlib.pyplot",
}
"""What people would run instead of `show` and `show --plot` has at least these to load."""


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Make the files, run the commands in rounds, print the table, and return its figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these rows")
    asked = parser.parse_args(words)
    chosen = {name: words for name, words in COMMANDS.items() if name in (asked.only or COMMANDS)}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for made in ("record latch -p P01 -n 3 --out .", "calibrate --out calibration.h5"):
            subprocess.run(haploop(made), cwd=folder, capture_output=True, check=True)
        programs = {name: haploop(command) for name, command in chosen.items()}
        programs |= {peer: [sys.executable, "-c", imports] for peer, imports in PEERS.items()}
        found = in_rounds(programs, asked.rounds, folder)
    print(f"| command | CPU s, median (range) of {asked.rounds} | MB |")
    print("|---|---|---|")
    for name in chosen:
        cpu = [cost.cpu for cost in found[name]]
        print(f"| {name} | {spread(cpu)} | {max(cost.memory for cost in found[name]):.0f} |")
    script, plot = PEERS
    rows = []
    for name in chosen:
        cpu = [cost.cpu for cost in found[name]]
        peer = plot if name.startswith(("report", "show RECORDING --plot")) else script
        goal = f"{GOALS[name]} s" if name in GOALS else ""
        theirs = [cost.cpu for cost in found[peer]]
        rows.append(Row(f"`haploop {name}`: CPU", cpu, "s", peer, ratios(cpu, theirs), goal))
    return rows


if __name__ == "__main__":
    main()
