"""Simulated seconds in a second of the processor while presses are recorded on the twin.

    python benchmarks/twin.py                       # a minute
    python benchmarks/twin.py --earlier 2000        # as after so many presses on the same rig

The rate says how long a soak takes, and `--earlier` whether it falls as presses add up.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.table import Row
from haploop import open_rig, record
from haploop.instruments import Press


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Record in rounds, and print the median rate with its range."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--presses", type=int, default=10)
    parser.add_argument("--earlier", type=int, default=0, help="presses that the plant has seen before")
    asked = parser.parse_args(words)
    rates = []
    with (
        tempfile.TemporaryDirectory() as folder,
        open_rig("simulated", simulate="twin", simulation={"seed": 5}) as rig,
    ):
        for number in range(asked.earlier):
            rig.operator.tell(Press("push", "P00", number + 1, asked.earlier))
            rig.clock.sleep(1.5)
        # The first one also loads what the others use.
        record(rig, "push", "P00", 1, folder)
        for number in range(asked.rounds):
            began, simulated = time.process_time(), rig.clock.now()
            record(rig, "push", f"P{number + 1:02}", asked.presses, folder)
            rates.append((rig.clock.now() - simulated) / (time.process_time() - began))
    print(f"{median(rates):.0f} simulated s in a CPU s ({min(rates):.0f} to {max(rates):.0f}), after")
    print(f"{asked.earlier} presses; {asked.rounds} rounds of {asked.presses} presses")
    what = f"presses recorded on the twin, {asked.earlier} before: simulated s in a CPU s"
    return [Row(what, rates, "", "real time", rates, ">= 60", more=True)]


if __name__ == "__main__":
    main()
