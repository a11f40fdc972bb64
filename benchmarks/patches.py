"""Four patches at once beside one, on simulated tables that drift: `python benchmarks/patches.py`.

Prints a table in Markdown: the error of a press, measured by the check, with hysteresis that differs from
patch to patch, the vibrometer's noise and the cards' steps. Loudness is the scale of the press over that
which patch A reaches alone within the same volts. See README.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from benchmarks.drives import METHODS, snap
from benchmarks.table import Row, ratios
from haploop.calibration import Drive, TradeOff, calibrate, drive_for
from haploop.calibration.drive import check
from haploop.instruments import Rig, open_rig
from haploop.instruments.config import RigFile
from haploop.mocks.plant.hysteresis import Hysteresis
from haploop.mocks.plant.modal_surface import ModalSurface
from haploop.mocks.plant.table import FEWEST_HZ, TouchTable, make_plate

WIDTHS = {"A": 0.12, "B": 0.09, "C": 0.15, "D": 0.11}
WORLDS: dict[str, dict[str, float]] = {
    "as calibrated": {},
    "all modes +1 %": {"mode_drift": 0.01},
    "all modes -1 %": {"mode_drift": -0.01},
    "all modes +2 %": {"mode_drift": 0.02},
    "each mode its own 1 %": {"scatter": 0.01},
    "damping x 1.2": {"damping_scale": 1.2},
}
LOUD = (1, 2, 3)


class Table(TouchTable):
    """A table of 17 modes, each of which may drift on its own, and whose patches differ in hysteresis."""

    scatter: float = 0.0

    def make(self, file: RigFile, rng: np.random.Generator) -> ModalSurface:
        """See `PlantSettings.make`."""
        plate = make_plate(rng, self.mode_drift, self.damping_scale, highest_hz=FEWEST_HZ)
        own = np.random.default_rng([file.simulation.seed, 1]).standard_normal(len(plate.natural_hz))
        return ModalSurface(replace(plate, natural_hz=plate.natural_hz * (1 + self.scatter * own)))

    def law(self, patch: str, file: RigFile) -> Hysteresis:
        """See `PlantSource.law`."""
        return Hysteresis(WIDTHS[patch])


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Play every drive on every table, print the tables, and return the errors after a drift of 1 %."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=6, help="how many tables")
    parser.add_argument("--first", type=int, default=401, help="seed of the first")
    parser.add_argument("--plays", type=int, default=4)
    options = parser.parse_args(words)
    rows = []
    for method in METHODS:
        found: dict[str, dict[str, list[float]]] = {world: {} for world in WORLDS}
        for seed in range(options.first, options.first + options.seeds):
            with opened(seed) as rig:
                drives = made(rig, method)
            for world, change in WORLDS.items():
                with opened(seed, **change) as rig:
                    for name, drive in drives.items():
                        error = 100 * check(rig, drive, plays=options.plays).error
                        found[world].setdefault(name, []).append(error)
        tell(method, found)
        after = found["all modes +1 %"]
        alone, twice = after["A alone"], after["four, 2 x as loud"]
        what = f"error of the played press after a drift of 1 %, four patches at 2 x, {method}"
        rows.append(Row(what, twice, "%", "patch A alone", ratios(twice, alone)))
    return rows


def opened(seed: int, **change: float) -> Rig:
    """A rig with a channel for each patch."""
    return open_rig("four-channel", simulation={"seed": seed}, plant=Table(**change))


def made(rig: Rig, method: str) -> dict[str, Drive]:
    """Drives as computed, without any correction by playing."""
    press, limits = snap(), rig.limits
    calibrations = [calibrate(rig, patch) for patch in WIDTHS]
    drives = {"A alone": drive_for(press, calibrations[0], limits, method=method)}  # type: ignore[arg-type]
    for loud in LOUD:
        trade = TradeOff(scale=loud * drives["A alone"].scale)
        drives[f"four, {loud} x as loud"] = drive_for(press, calibrations, limits, method=method, trade=trade)  # type: ignore[arg-type]
    return drives


def tell(method: str, found: dict[str, dict[str, list[float]]]) -> None:
    """A table in Markdown: mean and worst error over the tables."""
    names = list(next(iter(found.values())))
    print(f"\n| {method}, mean (worst) error, % | {' | '.join(names)} |\n|---|{'---|' * len(names)}")
    for world, errors in found.items():
        cells = [f"{np.mean(errors[name]):.1f} ({max(errors[name]):.1f})" for name in names]
        print(f"| {world} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
