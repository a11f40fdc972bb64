"""The model of people behind `experiment predict`, fitted on the paper's Group I and tried on its Group II.

    python -m benchmarks.people                      # of the buttons of `haploop demo`, which it runs
    python -m benchmarks.people haploop-demo         # of those in a folder of it

Two things that nobody measured are fitted to the 18 cells of Table III (Group I): by how much the table is
stronger, against the threshold of a pressing finger, than the one in the folder, and what memory keeps on
each day (without confirmation, and with it). The 18 cells of Table IV (Group II) are then predicted, on both
days with the memory of the day with confirmation, for Group II had it first. The range is 90 %, of what the
fit leaves open and of what it leaves over in Group I: model error, people and counts, which four matrices
cannot tell apart. Truth are the published cells.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

import haploop
from benchmarks.table import Row
from haploop.base.arrays import FloatArray
from haploop.calibration.perception import pressing_act
from haploop.experiments import PAPER_METRICS
from haploop.experiments.analysis import METRICS
from haploop.experiments.analysis.prediction import (
    answers_of_people,
    felt_levels,
    metrics_of,
    recorded_levels,
)

BUTTONS = ("latch", "toggle", "push")
STRONGER = np.arange(0.0, 51.0, 1.5)
"""dB."""
KEPT = np.geomspace(0.003, 1.0, 18)
DRAWS = 4
DAYS = (("I", 1), ("I", 2), ("II", 1), ("II", 2))


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Fit, print the 36 cells, and return how many of Group II lie within."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", help="what `haploop demo` wrote")
    folder = parser.parse_args(words).folder
    if folder is not None:
        cells = _cells(folder)
    else:
        with tempfile.TemporaryDirectory() as empty:
            demo = [sys.executable, "-m", "haploop", "demo"]
            subprocess.run(demo, cwd=empty, check=True, stdout=subprocess.DEVNULL)
            cells = _cells(Path(empty) / "haploop-demo")
    published = {day: np.array(PAPER_METRICS[day]) for day in DAYS}
    left = [((cells - published["I", day]) ** 2).mean(axis=(2, 3)) for day in (1, 2)]  # (strengths, memories)
    # Both days share the strength. What the best fit leaves over is the deviation of a cell.
    over = 0.5 * (left[0].min(axis=1) + left[1].min(axis=1)).min()
    first, second = (np.exp(-0.5 * one * published["I", 1].size / over) for one in left)
    fits = [first * second.sum(axis=1, keepdims=True), second * first.sum(axis=1, keepdims=True)]
    shares = dict(zip(DAYS, (one / one.sum() for one in (fits[0], *3 * [fits[1]])), strict=True))
    stronger = _percentiles(STRONGER, shares["I", 1].sum(axis=1))
    print("The table is stronger by {:.0f} dB ({:.0f} to {:.0f}).".format(*stronger))
    for day in (1, 2):
        kept = _percentiles(KEPT, shares["I", day].sum(axis=0))
        print("Day {}: memory keeps {:.2f} ({:.2f} to {:.2f}).".format(day, *kept))
    print(f"Left over in Group I: {np.sqrt(over):.1f} points.\n")
    print("| group, day | metric | " + " | ".join(BUTTONS) + " |\n|---|---|---|---|---|")
    within = {"I": 0, "II": 0}
    missed: list[FloatArray] = []
    for (group, day), fit in shares.items():
        share = fit[..., None, None]
        mean = (share * cells).sum(axis=(0, 1))
        reach = 1.645 * np.sqrt((share * (cells - mean) ** 2).sum(axis=(0, 1)) + over)
        inside = np.abs(published[group, day] - mean) <= reach
        within[group] += int(inside.sum())
        missed += [np.stack([mean, published["I", 2]]) - published[group, day]] if group == "II" else []
        low, high = np.maximum(mean - reach, 0), np.minimum(mean + reach, 100)
        for metric, *row in zip(METRICS, published[group, day], mean, low, high, inside, strict=True):
            each = " | ".join(
                f"{one:.0f}: {is_:.0f} ({least:.0f} to {most:.0f}){'' if good else ', outside'}"
                for one, is_, least, most, good in zip(*row, strict=True)
            )
            print(f"| {group}, {day} | {metric} | {each} |")
    print(f"\nWithin their ranges: {within['I']} of 18 that were fitted, {within['II']} of 18 that were not.")
    model, same = np.sqrt(np.mean(np.square(missed), axis=(0, 2, 3)))
    print(f"Group II is missed by {model:.1f} points; by its being as Group I on day 2, by {same:.1f}.")
    what = "cells of the paper's Group II within their ranges, fitted on Group I"
    return [Row(what, [within["II"]], "of 18", more=True)]


def _cells(folder: Path) -> FloatArray:
    """(strengths, memories, metrics, buttons) in percent."""
    presses = [haploop.load(folder / "presses" / f"{name}.h5") for name in BUTTONS]
    checks = [haploop.load(folder / "checks" / f"{name}.h5") for name in BUTTONS]
    act = pressing_act(checks[0].lab)
    felt = np.array([felt_levels(*one) for one in zip(presses, checks, strict=True)]) - act.shift
    recorded = np.array([recorded_levels(one) for one in presses]) - act.shift
    rng = np.random.default_rng(0)

    def metrics(stronger: float, kept: float) -> FloatArray:
        answers = [answers_of_people(felt + stronger, recorded, act.spread, kept, rng) for _ in range(DRAWS)]
        return np.asarray(100 * metrics_of(np.array(answers)).mean(axis=0))

    return np.array([[metrics(stronger, kept) for kept in KEPT] for stronger in STRONGER])


def _percentiles(values: FloatArray, shares: FloatArray) -> list[float]:
    """The median, and 90 % between."""
    total = np.cumsum(shares)
    return [float(values[np.searchsorted(total, at)]) for at in (0.5, 0.05, 0.95)]


if __name__ == "__main__":
    main()
