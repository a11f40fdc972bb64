"""The paper's way to a drive beside ours, played on simulated tables: `python benchmarks/drives.py`.

Prints a table in Markdown: every way on the same press, calibration and plant, measured by the same check.
The paper's way is run at every even order from 2 to 32, and shown at the order that its own prediction
likes best and at a typical one. See README.md.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from acquisition import Representative
from calibration import Calibration, Check, Drive, calibrate, check, drive_for, learn, paper_drive
from calibration.drive import Method
from calibration.paper_way import ORDERS
from instruments import Rig, open_rig

TYPICAL = 12
"""Poles: about two for each resonance within the band."""
STALE = 0.03
WORLDS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "patch beside the point": ({}, {}),
    "patch under the point": ({"collocated": True}, {}),
    "beside, table drifted 3 %": ({}, {"mode_drift": STALE}),
}
"""The plant as it is calibrated, and what it changes into."""


@dataclass(frozen=True)
class Row:
    """What one way came to."""

    way: str
    check: Check


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=301, help="which table")
    parser.add_argument("--plays", type=int, default=8)
    parser.add_argument("--noise", type=float, default=0.5, help="of the vibrometer, over the PDV-100's")
    parser.add_argument("--iterations", type=int, default=10)
    parser.add_argument("--only", choices=list(WORLDS), help="one of the tables")
    options = parser.parse_args()
    plant = {"seed": options.seed, "vibrometer_noise_scale": options.noise}
    for world, (as_calibrated, change) in WORLDS.items():
        if options.only in (None, world):
            with open_rig("simulated", simulation={**plant, **as_calibrated}) as rig:
                calibration = calibrate(rig)
            with open_rig("simulated", simulation={**plant, **as_calibrated, **change}) as rig:
                for method in ("modulated", "broadband"):
                    tell(world, method, rows(rig, calibration, method, options.plays, options.iterations))


def rows(rig: Rig, calibration: Calibration, method: Method, plays: int, iterations: int) -> list[Row]:
    """Every way on one table."""
    press, limits = snap(), rig.limits
    paper = [paper_drive(press, calibration, limits, order, method=method) for order in ORDERS]
    best = min(range(len(ORDERS)), key=lambda number: paper[number].predicted_error)
    typical = ORDERS.index(TYPICAL)
    planned = drive_for(press, calibration, limits, method=method)

    def played(way: str, drive: Drive) -> Row:
        return Row(way, check(rig, drive, plays=plays))

    found = [
        played(f"paper's, best order ({ORDERS[best]})", paper[best]),
        played(f"paper's, order {TYPICAL}", paper[typical]),
        played("regularised", drive_for(press, calibration, limits, method=method, inversion="regularised")),
        played("optimised", planned),
    ]
    learning = learn(rig, planned, calibration, iterations=iterations, plays=plays)
    for count in sorted({3, iterations}):
        kept = [i for i in learning.iterations[: count + 1] if i.kept]
        found.append(played(f"+ learning, {count} at most", replace(planned, volts=kept[-1].volts)))
    return found


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


def tell(world: str, method: str, found: list[Row]) -> None:
    """One table in Markdown."""
    load = f"; load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    print(f"\n{world}, {method} (simulated{load})\n")
    print("| way | error | floor | correlation | envelope | third octaves | scale |")
    print("|---|---|---|---|---|---|---|")
    for row in found:
        c = row.check
        print(
            f"| {row.way} | {c.nrmse:.1%} | {c.floor:.1%} | {c.correlation:.3f} | "
            f"{c.envelope_correlation:.3f} | {c.third_octave_error_db:.1f} dB | {c.drive.scale:.3f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
