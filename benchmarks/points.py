"""Silent points and two buttons at once, on simulated tables that drift: `python benchmarks/points.py`.

Prints two tables in Markdown. Points beside the button's are taken from a map; patches differ in hysteresis,
the laser has its noise, the cards their steps. Judged is the plant's own motion in one play of the drive as
computed, within its band. Silent points are beside a button as loud as patch A alone; two buttons are as loud
as 5 % of error allows, and have the least error where that is not within reach. See README.md.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from scipy.fft import rfft, rfftfreq

import haploop
from benchmarks.drives import snap
from benchmarks.patches import WIDTHS, opened
from benchmarks.table import Row, ranged, seeds_of
from haploop.acquisition import Representative
from haploop.calibration import (
    Drive,
    Multisine,
    TradeOff,
    VibrationMap,
    calibrate,
    drive_for,
    map_plan,
    with_map,
)
from haploop.calibration.drive import STEADY, Wanted
from haploop.calibration.response import settle
from haploop.instruments import Rig

DRIFT = 0.003
STEPS = (1, 2, 3, 5)
PLANS = {"": STEADY, ", with covariance": None}
Found = dict[tuple[str, str], list[float]]


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Play every drive on every table before and after a drift, print the tables, and return one figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tables", type=int, default=10, help="how many tables")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--word", default="murmuration", help="what the tables' seeds are hashed from")
    options = parser.parse_args(words)
    silent: Found = {}
    both: Found = {}
    for seed in seeds_of(options.word, options.first, options.tables):
        with opened(seed) as rig:
            drives = made(rig, np.random.default_rng(seed))
        for world, change in (("as calibrated", {}), (f"{DRIFT:.1%} drift", {"mode_drift": DRIFT})):
            with opened(seed, **change) as rig:
                for name, drive in drives.items():
                    own, others = moved(rig, drive)
                    if drive.elsewhere[0].button:
                        both.setdefault((name, world), []).append(100 * max(own, *others))
                    else:
                        level = 20 * np.log10(np.sqrt(np.mean(np.square(others))))
                        silent.setdefault((name, world), []).append(-float(level))
                        expected = np.mean([one.expected[0] for one in drive.elsewhere])
                        print(
                            seed,
                            world,
                            name,
                            f"{-level:.1f} dB, error {own:.1%}, expected "
                            f"{-20 * np.log10(expected):.1f} dB, {drive.predicted_error:.1%}",
                        )
                        continue
                    print(
                        seed,
                        world,
                        name,
                        [f"{one:.1%}" for one in (own, *others)],
                        "expected",
                        f"{drive.predicted_error:.1%} {drive.elsewhere[0].expected[0]:.1%}",
                        flush=True,
                    )
        tell("contrast, dB", silent)
        tell("error of the worse button, %", both)
    kept = silent["silent at 1 point", "as calibrated"]
    return [Row("motion at a silent point taken from the map, below the target", kept, "dB", "", [])]


def made(rig: Rig, rng: np.random.Generator) -> dict[str, Drive]:
    """Drives as computed, without any correction by playing."""
    near = {step: beside(rig, step, rng) for step in STEPS}
    far = apart(rig, 3, rng)
    with tempfile.TemporaryDirectory() as folder:
        points = sorted({int(point) for point in (*near.values(), *far)})
        haploop.measure_map(rig, Path(folder) / "map", map_plan(rig, points=points))
        found = VibrationMap.load(Path(folder) / "map")
    own = [calibrate(rig, patch, excitation=Multisine()) for patch in WIDTHS]
    limits, press = rig.limits, snap()
    scale = drive_for(press, own[0], limits).scale
    taken = with_map(own, found, [str(point) for point in points])

    def planned(wanted: Wanted, trade: TradeOff) -> Drive:
        kept = [c for c in taken if c.response.point in ("button", *wanted)]
        return drive_for(press, kept, limits, trade=trade, elsewhere=wanted)

    drives = {}
    for plan, drift in PLANS.items():
        quiet, both = TradeOff(scale=scale, drift=drift), TradeOff(error=0.05, drift=drift)
        for count in range(1, len(far) + 1):
            name = f"silent at {count} point{'s' if count > 1 else ''}{plan}"
            drives[name] = planned(dict.fromkeys(far[:count]), quiet)
        for step, point in near.items():
            name = f"two buttons, {step} step{'s' if step > 1 else ''} apart{plan}"
            drives[name] = planned({point: other(press)}, both)
            print(f"{name}: {drives[name].scale / scale:.2f} times as loud as A alone", flush=True)
    for step, point in near.items():
        name = f"silent {step} step{'s' if step > 1 else ''} beside the button"
        drives[name] = planned({point: None}, TradeOff(scale=scale, drift=STEADY))
    return drives


def other(press: Representative) -> Representative:
    """Another button's press, as strong: the same partials, one after the other."""
    late = np.roll(press.acceleration, round(0.015 * press.rate_hz))
    return replace(press, button="tick", acceleration=np.asarray(0.5 * press.acceleration - 0.8 * late))


def beside(rig: Rig, steps: int, rng: np.random.Generator) -> str:
    """A grid point so many steps from the button's along its row or column."""
    row, column = divmod(rig.table.button_point, rig.table.columns)
    places = [(row + s * a, column + s * b) for s in (steps, -steps) for a, b in ((0, 1), (1, 0))]
    inside = [p for p in places if 0 <= p[0] < rig.table.rows and 0 <= p[1] < rig.table.columns]
    chosen = inside[int(rng.integers(len(inside)))]
    return str(chosen[0] * rig.table.columns + chosen[1])


def apart(rig: Rig, steps: int, rng: np.random.Generator) -> list[str]:
    """Three grid points, each so many steps or more from each other and the button's."""
    chosen = [divmod(rig.table.button_point, rig.table.columns)]
    for index in rng.permutation(rig.table.rows * rig.table.columns):
        place = divmod(int(index), rig.table.columns)
        if all(np.hypot(place[0] - p[0], place[1] - p[1]) >= steps for p in chosen) and len(chosen) < 4:
            chosen.append(place)
    return [str(row * rig.table.columns + column) for row, column in chosen[1:]]


def moved(rig: Rig, drive: Drive) -> tuple[float, list[float]]:
    """True rms errors within the band in one play: of the drive's point, and of each other one.

    Over the point's target; of a silent one over the drive's own.
    """
    assert rig.simulation is not None
    settle(rig, drive.patches)
    truth = rig.simulation.truth
    record = truth.record()
    rig.excite_each(
        drive.by_patch, (*dict.fromkeys(map(rig.monitor, drive.patches)), rig.vibrometer.channel), 0.1
    )
    start = truth.began(record)
    times = start + np.arange(len(drive.target)) / drive.rate_hz
    f = rfftfreq(len(times), 1 / drive.rate_hz)
    inside = (f >= drive.band[0]) & (f <= drive.band[1])

    def error(point: str, target: np.ndarray) -> float:
        own = rfft(target)[inside]
        size = np.linalg.norm(own if own.any() else rfft(drive.target)[inside])
        motion = (rfft(rig.simulation.truth.velocity(point, times)) * 2j * np.pi * f)[inside]
        return float(np.linalg.norm(motion - own) / size)

    return error(drive.point, drive.target), [error(one.point, one.target) for one in drive.elsewhere]


def tell(what: str, found: Mapping[tuple[str, str], Sequence[float]]) -> None:
    """A table in Markdown: mean and range over the tables so far."""
    names, worlds = (list(dict.fromkeys(keys)) for keys in zip(*found, strict=True))
    count = len(found[names[0], worlds[0]])
    print(f"\n| {what}, mean (range), {count} tables | {' | '.join(worlds)} |\n|---|{'---|' * len(worlds)}")
    for name in names:
        each = [found[name, world] for world in worlds]
        print(f"| {name} | {' | '.join(map(ranged, each))} |", flush=True)


if __name__ == "__main__":
    main()
