"""The confusion matrix of `recalibrate`: what it says of changed tables, beside what is true of them.

    python -m benchmarks.recalibration                     # all conditions, once each
    python -m benchmarks.recalibration --rounds 3 --only hysteresis

A few tables are calibrated, with three buttons each, and looked at once. Then each condition opens one of
them again with something changed, and runs `recalibrate` on a copy of its history. Truth is known to the
simulator alone: the old drives are played on the changed table, and the surface's own velocity, without laser
and noise, is compared with their targets from 20 Hz to 2.5 kHz. "Fails" is an error above the tolerance of a
check, for any of the three. Seeds are hashes, which nobody chose. With --restore n, only every n-th drifted
table is restored, and the others are "left" as soon as they are found drifted.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.fft import irfft, rfft, rfftfreq

import haploop
from benchmarks.table import Row
from haploop.base.arrays import FloatArray
from haploop.calibration import DigitalButton
from haploop.calibration.recalibration import History, adopt, buttons_of, recalibrate
from haploop.calibration.response import settle
from haploop.instruments import Rig

BUTTONS = ("latch", "toggle", "push")
TOLERANCE = 0.20
WHOLE = (20.0, 2500.0)
SENSORS = ("laser-", "mains-", "sensor-", "accelerometer-")
"""Faults of what measures: they are not in the truth."""
GAUGES = tuple(f"gauge{k}" for k in range(6))


@dataclass(frozen=True)
class Condition:
    """What is changed, and whether it is nothing, a drift, or a fault. A fault need not make drives fail."""

    name: str
    cause: str
    simulation: Mapping[str, Any] = field(default_factory=dict)
    faults: Sequence[Mapping[str, Any]] = ()
    aim: str = "button"
    range_factor: float = 1.0


def conditions() -> Iterator[Condition]:
    """All conditions; the thresholds of the rig file are crossed from both sides."""

    def drift(name: str, **values: Any) -> Condition:
        return Condition(name, "drift", faults=[{"kind": "mode-drift", **values}])

    def law(name: str, width: float, kind: str = "play") -> Condition:
        fault = {"kind": "patch-hysteresis", "law": kind, "width": width}
        return Condition(name, "drift", faults=[fault])

    def fault(name: str, *faults: Mapping[str, Any], **more: Any) -> Condition:
        return Condition(name, "fault", faults=faults, **more)

    yield Condition("as it was", "none")
    yield Condition("as it was, again", "none")
    yield Condition("noise of the laser x 1.4", "none", {"vibrometer_noise_scale": 1.4})
    for shift in (
        0.001,
        -0.001,
        0.002,
        -0.0025,
        0.0028,
        0.0032,
        -0.0035,
        0.005,
        -0.01,
        0.02,
        -0.03,
        0.06,
        -0.09,
    ):
        yield drift(f"all modes {shift:+.2%}", frequency=shift)
    for spread in (0.0005, 0.001, 0.002, 0.004, 0.007, 0.01, 0.02, 0.02, 0.03):
        yield drift(f"each mode by its own {spread:.2%}", frequency_each=spread)
    for shift in (0.002, -0.003, 0.005, -0.01, 0.02, -0.02, 0.03):
        yield drift(f"main mode alone {shift:+.1%}", frequency=shift, near=263.5)
    yield drift("a mode at 200 Hz alone +2 %", frequency=0.02, near=200.0)
    for change in (0.1, -0.15, 0.18, 0.25, -0.3, 0.6, 1.0):
        yield drift(f"damping {change:+.0%}", damping=change)
    for spread in (0.1, 0.2, 0.3):
        yield drift(f"damping of each mode {spread:.0%}", damping_each=spread)
    yield drift(
        "all modes +1 %, each 1 %, damping 20 %", frequency=0.01, frequency_each=0.01, damping_each=0.2
    )
    for gain in (51.5, 47.5, 45.5, 44.0, 42.0):
        change = {"kind": "amplifier-gain", "gain": gain}
        yield Condition(f"gain {gain / 50 - 1:+.0%}", "drift", faults=[change])
    for width in (0.11, 0.13, 0.14, 0.15, 0.16, 0.2, 0.24, 0.09, 0.06, 0.0):
        yield law(f"hysteresis 0.12 to {width:g}", width)
    yield law("hysteresis of another law (Bouc-Wen), 0.12", 0.12, "bouc-wen")
    yield law("hysteresis of another law (Bouc-Wen), 0.2", 0.2, "bouc-wen")
    yield Condition(
        "main mode +1 % and hysteresis 0.15",
        "drift",
        faults=[
            {"kind": "mode-drift", "frequency": 0.01, "near": 263.5},
            {"kind": "patch-hysteresis", "law": "play", "width": 0.15},
        ],
    )
    for rate, height in ((0.5, 2e-3), (2.0, 2e-3), (20.0, 2e-3), (100.0, 5e-3)):
        yield fault(f"laser spikes {rate:g}/s", {"kind": "laser-spikes", "rate": rate, "height": height})
    for volts, hz in ((0.0005, 50.0), (0.01, 50.0), (0.05, 60.0), (0.3, 50.0)):
        yield fault(
            f"hum {volts:g} V at {hz:g} Hz",
            {"kind": "mains-hum", "channel": "laser", "volts": volts, "frequency": hz},
        )
    yield fault("noise of the laser x 6", simulation={"vibrometer_noise_scale": 6.0})
    yield fault("laser blocked", {"kind": "laser-blocked"})
    yield fault("laser disconnected", {"kind": "sensor-disconnected", "channel": "laser"})
    yield fault("range of the laser x 5", {"kind": "vibrometer-range", "range": 0.1})
    for point in ("8", "19", "21", "32"):
        yield fault(f"aimed at point {point}, next to it", aim=point)
    yield fault("aimed far away", aim="60")
    yield fault("patch dead", {"kind": "patch-dead"})
    for other in "BCD":
        yield fault(f"patches A and {other} swapped", {"kind": "relay-swapped", "patches": ["A", other]})
    yield fault("accelerometer upside down", {"kind": "accelerometer-inverted"})
    yield fault("accelerometer loose", {"kind": "sensor-disconnected", "channel": "acceleration_z"})
    yield fault("amplifier tripped", {"kind": "amplifier-trip"})
    yield fault("gain -50 %", {"kind": "amplifier-gain", "gain": 25.0})
    yield fault(
        "all modes +3 %, patches A and B swapped",
        {"kind": "mode-drift", "frequency": 0.03},
        {"kind": "relay-swapped"},
    )
    yield fault("each mode 2 %, aimed at point 21", {"kind": "mode-drift", "frequency_each": 0.02}, aim="21")


def seed_of(number: int) -> int:
    """A seed that nobody chose."""
    return int.from_bytes(hashlib.sha256(f"recalibration {number}".encode()).digest()[:4], "big")


def calibrated(seed: int, folder: Path, iterations: int) -> Path:
    """A history with three buttons, and one healthy look."""
    history = History(folder / f"{seed}")
    with haploop.open_rig("simulated", simulation={"seed": seed}) as rig:
        presses = [
            haploop.representative([haploop.record(rig, name, "P01", 2, folder / f"presses-{seed}")])
            for name in BUTTONS
        ]
        calibration = haploop.calibrate(rig)
        buttons = [haploop.build_button(rig, press, calibration, iterations=iterations) for press in presses]
        for button in buttons:
            if not button.passed:
                print(f"seed {seed}: {button.press.button} did not pass and is left out: {button.check}")
        adopt(history, [button for button in buttons if button.passed], actor="benchmark", reason="it begins")
        rig.adopt("operator", haploop.instruments.Unattended("button"))
        first = recalibrate(rig, history)
        print(
            f"seed {seed}: {len(buttons)} buttons; the look at the calibrated table: {first.kind}", flush=True
        )
    return history.folder


def errors(rig: Rig, button: DigitalButton) -> tuple[float, float]:
    """True error of a drive in its band and of the whole motion, over the target."""
    drive = button.drive
    channels = (*dict.fromkeys(map(rig.monitor, drive.patches)), rig.vibrometer.channel)
    settle(rig, drive.patches)
    record = rig.simulation.truth.record()
    rig.excite_each(drive.by_patch, channels, 0.1)
    try:
        start = rig.simulation.truth.began(record)
    except LookupError:
        return 1.0, 1.0  # no volts reach the patch, and nothing moves
    times = start + np.arange(len(drive.target) + round(0.05 * drive.rate_hz)) / drive.rate_hz
    velocity = rig.simulation.truth.velocity(drive.point, times)
    f = rfftfreq(2 * len(times), 1 / drive.rate_hz)
    moved = rfft(velocity, 2 * len(times)) * 2j * np.pi * f
    target = rfft(drive.target, 2 * len(times))

    def rms(spectrum: FloatArray, low: float, high: float) -> float:
        return float(np.linalg.norm(irfft(spectrum * ((f >= low) & (f <= high)))))

    size = rms(target, 0, np.inf)
    return rms(moved - target, *drive.band) / size, rms(moved - target, *WHOLE) / size


def truth(seed: int, condition: Condition, history: History) -> float:
    """The largest error of the whole motion that an old drive makes on the changed table."""
    faults = [fault for fault in condition.faults if not fault["kind"].startswith((*SENSORS, "vibrometer-"))]
    simulation = {"seed": seed, "faults": faults}
    with haploop.open_rig("simulated", simulation=simulation) as rig:
        found = []
        for button in buttons_of(history.active()).values():
            try:
                found.append(errors(rig, button)[1])
            except haploop.HaploopError:
                found.append(np.inf)
    return max(found)


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Run the conditions, and print a line for each and the matrix; return the number of wrong outcomes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tables", type=int, default=4, help="number of calibrated tables")
    parser.add_argument("--rounds", type=int, default=1, help="how often each condition is tried")
    parser.add_argument("--only", default="", help="conditions whose name this regular expression finds")
    parser.add_argument("--part", default="1/1", help="one of several parts of the conditions, as 2/3")
    parser.add_argument("--first", type=int, default=0, help="number of the first seed")
    parser.add_argument("--iterations", type=int, default=2, help="corrections in learning")
    parser.add_argument(
        "--restore", type=int, default=1, help="restore every n-th drifted table, and leave the others"
    )
    options = parser.parse_args(words)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ |= {"HAPLOOP_STATE": str(folder / "state"), "HAPLOOP_LIVE": "off"}
        seeds = [seed_of(options.first + k) for k in range(options.tables)]
        bases = {seed: calibrated(seed, folder, options.iterations) for seed in seeds}
        part, parts = (int(number) for number in options.part.split("/"))
        chosen = [c for c in conditions() if re.search(options.only, c.name)][part - 1 :: parts]
        matrix: Counter[tuple[str, str]] = Counter()
        wrong: list[str] = []
        drifted = 0
        print("| condition | cause | worst true error of an old drive | outcome | after | CPU s |")
        print(f"|{'---|' * 6}")
        for number, condition in enumerate(chosen * options.rounds):
            seed = seeds[(number + number // len(chosen)) % len(seeds)]
            restore = not drifted % options.restore
            outcome, line, failing = tried(
                seed, condition, bases[seed], folder / "copy", options.iterations if restore else None
            )
            drifted += outcome in ("restored", "drifted", "left")
            row = condition.cause if condition.cause == "fault" else "fails" if failing else "holds"
            matrix[row, outcome] += 1
            if (failing and outcome == "unchanged") or (row != "fault" and outcome == "broken"):
                wrong.append(f"{condition.name}, seed {seed}")
            print(line, flush=True)
        rows = ("holds", "fails", "fault")
        columns = ("unchanged", "restored", "left", "drifted", "touched", "broken")
        print(f"\n| table | {' | '.join(columns)} |\n|{'---|' * 7}")
        for row in rows:
            print(f"| {row} | {' | '.join(str(matrix[row, column]) for column in columns)} |")
        print(f"\n{sum(matrix.values())} tables; wrong: {'; '.join(wrong) or 'none'}")
        what = f"recalibrate on {sum(matrix.values())} changed tables: wrong outcomes"
        return [Row(what, [len(wrong)], goal="0")]


class _Left(Exception):  # noqa: N818
    """The table has drifted, and its restoration is left out."""


def tried(
    seed: int, condition: Condition, base: Path, copy: Path, iterations: int | None
) -> tuple[str, str, bool]:
    """The outcome of one condition, its line of the table, and whether an old drive really fails.

    Without a number of `iterations`, a table that has drifted is left before its restoration begins.
    """

    def leaving(doing: str, *_more: Any) -> None:
        if iterations is None and "old drive" in doing:
            raise _Left

    shutil.rmtree(copy, ignore_errors=True)
    history = History(shutil.copytree(base, copy))
    worst = truth(seed, condition, history)
    simulation = {"seed": seed, "faults": list(condition.faults), **condition.simulation}
    began = time.process_time()
    with haploop.open_rig("simulated", simulation=simulation) as rig:
        rig.simulation.plant.aim(condition.aim)
        rig.adopt("operator", haploop.instruments.Unattended("button"))
        try:
            outcome = recalibrate(rig, history, iterations=iterations or 0, progress=leaving)
            kind = str(outcome.kind)
            told, after = outcome.sentences, [button.check for button in outcome.after.values()]
        except _Left:
            kind, told, after = "left", (), []
    took = time.process_time() - began
    if os.environ.get("VERBOSE"):
        print("\n".join(f"    {sentence}" for sentence in told))
    remains = f"{max(check.error for check in after):.1%}" if after else ""
    cells = (condition.name, condition.cause, f"{worst:.1%}", kind, remains, f"{took:.0f}")
    return kind, f"| {' | '.join(cells)} |", worst > TOLERANCE


if __name__ == "__main__":
    main()
