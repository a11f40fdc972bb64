"""Processor time and memory of `haploop demo`, by the number of participants.

    python benchmarks/demo.py                                        # one and twelve: three minutes
    python benchmarks/demo.py --participants 1 12 48 --rounds 1
    python benchmarks/demo.py --against OTHER/bin/python             # beside another environment

Prints Markdown.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.processes import haploop, in_rounds, spread
from benchmarks.table import Row, ratios

GOALS = {1: "8 s", 12: "25 s"}


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Run the demos in rounds, print the table, and return its figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--participants", type=int, nargs="+", default=[1, 12])
    parser.add_argument("--against", metavar="PYTHON", help="of an environment with another haploop")
    asked = parser.parse_args(words)
    pythons = {"this": sys.executable} | ({"other": asked.against} if asked.against else {})
    programs = {
        f"{which}, {count}": haploop(f"demo --participants {count} --out NEW", python)
        for count in asked.participants
        for which, python in pythons.items()
    }
    with tempfile.TemporaryDirectory() as name:
        found = in_rounds(programs, asked.rounds, Path(name))
    print(f"| haploop, participants | CPU s, median (range) of {asked.rounds} | s each | MB |")
    print("|---|---|---|---|")
    for name, costs in found.items():
        cpu = [cost.cpu for cost in costs]
        each = median(cpu) / int(name.split()[-1])
        print(f"| {name} | {spread(cpu, 1)} | {each:.1f} | {max(cost.memory for cost in costs):.0f} |")
    rows = []
    for count in asked.participants:
        ours, others = (
            [cost.cpu for cost in found.get(f"{which}, {count}", [])] for which in ("this", "other")
        )
        beside = "other version" if others else ""
        what = f"`haploop demo`, {count} participant{'s' * (count > 1)}"
        goal = GOALS.get(count, "")
        rows.append(Row(f"{what}: CPU", ours, "s", beside, ratios(ours, others) if others else (), goal))
        rows.append(Row(f"{what}: memory", [cost.memory for cost in found[f"this, {count}"]], "MB"))
    return rows


if __name__ == "__main__":
    main()
