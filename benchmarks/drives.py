"""The paper baseline beside our methods, played on simulated tables: `python benchmarks/drives.py`.

Prints one table in Markdown: every method on the same press, calibrations and plants, measured by the same
check. The paper baseline is computed at every even order from 2 to 32, and played at the order of its
smallest predicted error. See README.md.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from benchmarks.paper_drive import ORDERS, paper_drive
from benchmarks.table import Row, ratios
from haploop.acquisition import Representative
from haploop.calibration import Calibration, Check, Drive, calibrate, drive_for, learn
from haploop.calibration.drive import Method, check
from haploop.instruments import Rig, open_rig
from haploop.mocks.plant.table import FEWEST_HZ

STALE = 0.03
WORLDS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "beside": ({}, {}),
    "under": ({"collocated": True}, {}),
    "under, no hysteresis": ({"collocated": True, "hysteresis": 0.0}, {}),
    "beside, drifted 3 %": ({}, {"mode_drift": STALE}),
}
"""Where the patch is to the point: the plant as it is calibrated, and what it changes into."""
METHODS: tuple[Method, ...] = ("modulated", "broadband")
Found = dict[str, list[Check]]


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Play every method on every table, print the table, and return the errors beside the paper's."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=2, help="how many tables")
    parser.add_argument("--first", type=int, default=401, help="seed of the first")
    parser.add_argument("--plays", type=int, default=8)
    parser.add_argument("--noise", type=float, default=0.5, help="of the vibrometer, over the PDV-100's")
    parser.add_argument("--only", choices=list(WORLDS), help="one kind of table")
    options = parser.parse_args(words)
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    print(f"Simulated; {options.seeds} tables from seed {options.first}{load}\n")
    print(
        "| patch | target | method | whole motion | in band | outside | noise | predicted | envelope | "
        "scale | verdict |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    rows: list[Row] = []
    for world in [options.only] if options.only else WORLDS:
        found: dict[Method, Found] = {method: {} for method in METHODS}
        for seed in range(options.first, options.first + options.seeds):
            as_calibrated, change = WORLDS[world]
            plant = {"seed": seed, "highest_hz": FEWEST_HZ, **as_calibrated}
            plant["vibrometer_noise_scale"] = options.noise
            with open_rig("simulated", simulation=plant) as rig:
                calibration = calibrate(rig)
            with open_rig("simulated", simulation={**plant, **change}) as rig:
                for method in METHODS:
                    for name, result in compared(rig, calibration, method, options.plays):
                        found[method].setdefault(name, []).append(result)
        for method in METHODS:
            tell(world, method, found[method])
            errors = {name: [100 * one.error for one in each] for name, each in found[method].items()}
            paper, *own = errors
            rows += [
                Row(
                    f"error of the played press, patch {world}, {method}, {name}",
                    errors[name],
                    "%",
                    "the paper's inverse",
                    ratios(errors[name], errors[paper]),
                )
                for name in own
            ]
    return rows


def compared(rig: Rig, calibration: Calibration, method: Method, plays: int) -> list[tuple[str, Check]]:
    """Every method on one table."""
    press, limits = snap(), rig.limits
    paper = [paper_drive(press, calibration, limits, order, method=method) for order in ORDERS]
    planned = drive_for(press, calibration, limits, method=method)
    learning = learn(rig, planned, calibration, iterations=5, plays=plays)

    def learnt(count: int) -> Drive:
        kept = [i for i in learning.iterations[: count + 1] if i.kept]
        return replace(planned, volts=kept[-1].volts)

    drives = {
        "paper baseline, best order": min(paper, key=lambda drive: drive.predicted_error),
        "regularised": drive_for(press, calibration, limits, method=method, inversion="regularised"),
        "optimised": planned,
        "+ learning, 3": learnt(3),
        "+ learning, 5": learnt(5),
    }
    return [(name, check(rig, drive, plays=plays)) for name, drive in drives.items()]


def snap() -> Representative:
    """A click that rings at 235 Hz and dies in 10 ms, over one of 120 Hz and 14 ms."""
    rate_hz, begin = 5000.0, 0.3
    since = np.maximum(np.arange(round(0.6 * rate_hz)) / rate_hz - begin, 0.0)
    shape = 10 * np.exp(-since / 0.010) * np.sin(2 * np.pi * 235 * since)
    shape += 3 * np.exp(-since / 0.014) * np.sin(2 * np.pi * 120 * since)
    rest = np.zeros(len(since))
    return Representative(
        button="snap",
        rate_hz=rate_hz,
        acceleration=np.asarray(shape),
        force=rest,
        activation=np.asarray(since > 0, dtype=np.float64),
        activation_index=round(begin * rate_hz),
        members=1,
        spread=rest,
        bandwidth_hz=500.0,
        sources=(("made for a benchmark", "0" * 64),),
        left_out=(),
        method="made for a benchmark",
        simulated=True,
    )


def tell(world: str, method: str, found: Found) -> None:
    """Rows in Markdown: the mean over the tables, and the worst error."""
    for name, results in found.items():
        mean = {
            metric: float(np.mean([attrgetter(metric)(result) for result in results]))
            for metric in ("whole.root", "within.root", "outside.root", "whole.floor", "envelope_correlation")
        }
        worst = max(result.error for result in results)
        predicted = float(np.mean([result.drive.predicted_error for result in results]))
        scale = float(np.mean([result.drive.scale for result in results]))
        verdicts = ", ".join(sorted({result.verdict for result in results}))
        print(
            f"| {world} | {method} | {name} | {mean['whole.root']:.1%} ({worst:.1%}) | "
            f"{mean['within.root']:.1%} | "
            f"{mean['outside.root']:.1%} | {mean['whole.floor']:.1%} | {predicted:.1%} | "
            f"{mean['envelope_correlation']:.3f} | {scale:.3f} | {verdicts} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
