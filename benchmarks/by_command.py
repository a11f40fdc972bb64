"""Calibrations and checks by the command line alone, on worlds that nobody chose, beside the truth.

    python -m benchmarks.by_command --worlds 200            # about 20 s of CPU each
    python -m benchmarks.by_command --worlds 20 --word other

Each world is a rig file: the table, or a random modal plate, of which every second one has modes above
2.5 kHz; plant, hysteresis, press, and the drift between calibration and check come from hashes. `haploop
calibrate` and `haploop check` run as programs of their own. Truth is the surface's own velocity in another
play of the checked drive on that rig, from 20 Hz to half of the drive's rate, which no laser saw.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.disturbed import TOLERANCE, errors_of, press_of
from benchmarks.synthetic_responses import generator
from haploop import open_rig
from haploop.calibration import Check, Drive
from haploop.calibration.response import settle
from haploop.instruments import Rig
from haploop.mocks.plant import random_modal

_LOW_HZ = 2500.0


@dataclass(frozen=True)
class Outcome:
    """What was said of one world, and what was so."""

    high: bool
    """True for a world with modes above 2.5 kHz."""
    verdict: str
    low: float
    upper: float
    truth: float
    below: float
    """Truth up to the frequency to which the check judged."""
    by_error: bool
    """True where the error is a reason for the verdict."""

    @property
    def wrong(self) -> str:
        """ "false pass", "false fail", or nothing."""
        if self.truth > TOLERANCE:
            return "false pass" if self.verdict == "pass" else ""
        return "false fail" if self.verdict == "fail" and self.by_error else ""

    @property
    def holds(self) -> bool:
        """True when the interval contains the truth of what was judged."""
        return self.low <= self.below <= self.upper


def main() -> None:
    """Print each world, then the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--worlds", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--word", default="by command", help="what all is hashed from")
    asked = parser.parse_args()
    found: list[Outcome] = []
    refused = 0
    for number in range(asked.first, asked.first + asked.worlds):
        with tempfile.TemporaryDirectory() as folder:
            outcome = tried(asked.word, number, Path(folder))
        if isinstance(outcome, str):
            refused += 1
            print(f"{number}: {outcome}", flush=True)
            continue
        found.append(outcome)
        print(
            f"{number}{' high' if outcome.high else ''}: {outcome.verdict} ({outcome.low:.3f} to "
            f"{outcome.upper:.3f}), true {outcome.below:.3f}, of all {outcome.truth:.3f} {outcome.wrong}"
            f"{'' if outcome.holds else ' outside'}",
            flush=True,
        )
    for name, own in (
        ("up to 2.5 kHz", [o for o in found if not o.high]),
        ("above", [o for o in found if o.high]),
    ):
        shown = [o for o in own if np.isfinite(o.low)]
        print(
            f"modes {name}: {len(own)} checks, {dict(Counter(o.verdict for o in own))}, wrong "
            f"{dict(Counter(o.wrong for o in own if o.wrong))}, intervals right "
            f"{sum(o.holds for o in shown)} of {len(shown)}; truth beyond {TOLERANCE:.0%}: "
            f"{sum(o.truth > TOLERANCE for o in own)}"
        )
    print(f"refused: {refused}")


def tried(word: str, number: int, folder: Path) -> Outcome | str:
    """One world; the last line that a command said where it refused."""
    rng, high = generator(word, number), bool(number % 2)
    settings = plant(rng, high)
    drift = float(rng.choice([0.0, 0.0, 1.0]) * rng.normal(0, 0.006))
    (folder / "before.toml").write_text(rig_file(settings), encoding="utf-8")
    fault = f'\n[[simulation.faults]]\nkind = "mode-drift"\nfrequency = {drift!r}\n' if drift else ""
    (folder / "after.toml").write_text(rig_file(settings) + fault, encoding="utf-8")
    press_of(generator(word, number, "press")).save(folder / "press.h5")
    made = run(folder, "calibrate", "--out", "table.h5", "--no-waveforms", "--rig", "before.toml")
    if made.returncode:
        return f"calibrate: {made.stderr.strip().splitlines()[-1]}"
    checked = run(folder, "check", "press.h5", "-c", "table.h5", "-o", "out", "--rig", "after.toml", "--json")
    files = sorted((folder / "out").glob("*check*.h5"))
    if not files:
        return f"check: {checked.stderr.strip().splitlines()[-1]}"
    result, said = Check.load(files[0]), json.loads(checked.stdout)
    assert checked.returncode == {"pass": 0, "fail": 1, "not shown": 4}[result.verdict]
    with open_rig(folder / "after.toml") as rig:
        truth, below = true_errors(rig, result.drive, result.judged_hz)
    by_error = any("differs from the target" in one for one in said["reasons"])
    return Outcome(high, result.verdict, *result.interval, truth, below, by_error)


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command of haploop as a program of its own."""
    command = [sys.executable, "-m", "haploop", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def plant(rng: np.random.Generator, high: bool) -> dict[str, Any]:
    """Settings of a simulation: the table, or a random plate; with modes above 2.5 kHz if `high`."""
    settings: dict[str, Any] = {
        "seed": int(rng.integers(2**31)),
        "hysteresis": float(rng.uniform(0.03, 0.2)),
    }
    if rng.random() < 0.5:
        top = rng.uniform(4000, 12_000) if high else rng.uniform(850, _LOW_HZ)
        scale = float(np.exp(rng.uniform(np.log(0.25), np.log(1.5))))
        return settings | {"highest_hz": float(top), "damping_scale": scale}
    lowest = float(np.exp(rng.uniform(np.log(0.003), np.log(0.02))))
    drawn = random_modal(rng, damping=(lowest, 2.5 * lowest))
    count = int(rng.integers(1, 9)) if high else 0
    hz = np.exp(rng.uniform(np.log(_LOW_HZ), np.log(10_000), count))
    # As a plate's: the force grows with the curvature, which is the frequency.
    largest = float(np.max(np.abs(drawn.coupling["A"]) / np.array(drawn.natural_hz)))
    force = {patch: largest * hz * rng.uniform(-1, 1, count) for patch in drawn.coupling}
    return settings | {
        "plant": "modal",
        "natural_hz": [*drawn.natural_hz, *hz.tolist()],
        "damping": [*drawn.damping, *rng.uniform(0.003, 0.02, count).tolist()],
        "coupling": {patch: [*own, *force[patch].tolist()] for patch, own in drawn.coupling.items()},
        "shapes": {"button": [*drawn.shapes["button"], *rng.uniform(-1, 1, count).tolist()]},
    }


def rig_file(settings: Mapping[str, Any]) -> str:
    """The text of a rig file, of the shipped rig with other settings of the simulation."""
    plain = {name: value for name, value in settings.items() if not isinstance(value, Mapping)}
    lines = ['base = "simulated"', 'name = "world"', "[simulation]"]
    lines += [f"{name} = {json.dumps(value)}" for name, value in plain.items()]
    for name, table in settings.items():
        if isinstance(table, Mapping):
            lines += [f"[simulation.{name}]", *(f"{key} = {json.dumps(own)}" for key, own in table.items())]
    return "\n".join(lines) + "\n"


def true_errors(rig: Rig, drive: Drive, top: float) -> tuple[float, float]:
    """Rms error of the surface in the second of two plays, over the target: in all, and up to `top` Hz."""
    assert rig.simulation is not None
    settle(rig, drive.patches)
    truth = rig.simulation.truth
    for _ in range(2):
        record = truth.record()
        rig.excite_each(drive.by_patch, (rig.monitor(drive.patch), rig.vibrometer.channel), 0.1)
        start = truth.began(record)
        times = start + np.arange(len(drive.target)) / drive.rate_hz
        velocity = truth.velocity(drive.point, times)
    return errors_of(velocity, drive, top)


if __name__ == "__main__":
    main()
