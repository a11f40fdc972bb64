"""Recordings of 0.1 to 10 hours: CPU time and memory to record, verify and show one.

    python benchmarks/hours.py 0.1 1                        # 10 hours take 6 GB of disk; not on Windows

The presses of one simulated recording follow each other, with their verdicts, as fast as the disk takes
them: 5 kS/s x 10 channels. Prints Markdown.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from benchmarks.processes import haploop, in_rounds
from benchmarks.table import Row

_BLOCK = 250
"""Samples."""


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Measure each length, print the table, and return its figures."""
    rows: list[Row] = []
    print("| recording | what | CPU s | MB |\n|---|---|---|---|", flush=True)
    for text in (sys.argv[1:] if words is None else words) or ["0.1", "1"]:
        with tempfile.TemporaryDirectory() as temporary:
            steps = {
                "record": [sys.executable, __file__, "--record", text],
                "verify": haploop("verify P01-latch.h5"),
                "show": haploop("show P01-latch.h5"),
            }
            for step, command in steps.items():
                (cost,) = in_rounds({step: command}, 1, Path(temporary))[step]
                print(f"| {text} h | {step} | {cost.cpu:.1f} | {cost.memory:.0f} |", flush=True)
                what = f"recording of {text} h, {step}"
                rows.append(Row(f"{what}: CPU an hour", [cost.cpu / float(text)], "s"))
                rows.append(Row(f"{what}: memory", [cost.memory], "MB"))
    return rows


def record(hours: float) -> None:
    """Write P01-latch.h5 of so many hours into this folder."""
    import haploop
    from haploop.acquisition.recording import Writer, finish
    from haploop.instruments import Block

    with tempfile.TemporaryDirectory(dir=".") as source, haploop.open_rig("simulated") as rig:
        made = haploop.record(rig, "latch", "P01", 10, source)
        whole = made.volts
    volts = np.ascontiguousarray(whole[:, : whole.shape[1] // _BLOCK * _BLOCK])
    samples = volts.shape[1]
    rounds = round(3600 * hours * made.rate_hz / samples)
    header = replace(made.header, presses=rounds * len(made.verdicts))
    none = np.zeros(len(volts), dtype=np.bool_)
    path = Path("P01-latch.h5")
    with Writer(path, header, _BLOCK, rounds * samples // _BLOCK) as writer:
        for number in range(rounds):
            begin = number * samples
            for first in range(0, samples, _BLOCK):
                block = Block(begin + first, volts[:, first : first + _BLOCK], none)
                writer.write(block, (begin + first) / made.rate_hz)
            for one in made.verdicts:
                if one.end <= samples:
                    moved = one._replace(
                        number=number * len(made.verdicts) + one.number,
                        first=begin + one.first,
                        end=begin + one.end,
                        activation=begin + one.activation,
                    )
                    writer.write_verdict(moved)
    finish(path)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--record"]:
        record(float(sys.argv[2]))
    else:
        main()
