"""Checks under correlated noise, and on plants that break an assumption, beside the truth.

    python -m benchmarks.disturbed                  # 20 plants x 8 kinds x 3 levels: 480 checks
    python -m benchmarks.disturbed --plants 2       # a part of them
    python -m benchmarks.disturbed --seed other     # other plants and disturbances

Every second plant is the table, the others are random modal plates; damping, hysteresis, the press, the drift
since calibration, and each disturbance's frequencies and times come from hashes, which nobody chose. A drive
is computed on the quiet plant. Then it is checked with the laser disturbed at three levels: by mains (50, 60
or 49.9 Hz with harmonics), a fan (whose speed wanders, for half of them), flicker noise, or a neighbour's
motor that starts during the check. Four further kinds are plants: quiet ones, patches whose up differs from
their down (2 to 12 %, of any shape), plates that ring long (damping of the table over 2 to 8, of a plate 0.1
to 0.4 %), and a laser that was pushed askew since the calibration (it shows 95 to 80 %). Truth is the
surface's own velocity in the very plays, without laser and noise.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.synthetic_responses import generator
from haploop import open_rig
from haploop.acquisition import Representative
from haploop.base.arrays import FloatArray
from haploop.base.errors import HaploopError
from haploop.calibration import Check, Drive, calibrate, drive_for
from haploop.calibration.drive import check
from haploop.instruments import Capture, Rig
from haploop.mocks.plant import random_modal

Levels = Mapping[str, Sequence[float]]
NOISE: Levels = dict.fromkeys(("mains", "fan", "flicker", "motor"), (0.002, 0.006, 0.02))
"""Amplitude (V at the laser's output) of a disturbance; of flicker noise half of it, rms."""
PLANTS: Levels = {
    "quiet": (0.0, 0.003, 0.01),
    "even": (0.02, 0.06, 0.12),
    "ringing": (0.5, 0.25, 0.125),
    "askew": (0.95, 0.9, 0.8),
}
"""Drift of the frequencies, even order, damping over the usual one, and the share that the laser shows."""
TOLERANCE = 0.20
VERDICTS = ("pass", "fail", "not shown")


@dataclass(frozen=True)
class Row:
    """One check: what it was, what was said, and what was so."""

    plant: int
    kind: str
    level: float
    """See `NOISE` and `PLANTS`."""
    verdict: str
    error: float
    low: float
    high: float
    truth: float
    below: float
    """Truth up to the frequency to which the check judged."""
    said: str

    @property
    def shown(self) -> bool:
        """True when an interval was stated."""
        return bool(np.isfinite(self.low))

    @property
    def holds(self) -> bool:
        """True when the stated interval contains the truth of what is judged."""
        return self.low <= self.below <= self.high

    @property
    def wrong(self) -> bool:
        """True for a false pass, or for an error that is wrongly said to be beyond the tolerance."""
        if self.truth > TOLERANCE:
            return self.verdict == "pass"
        # A drive that holds too little of its press fails for that, whatever its error.
        return self.verdict == "fail" and self.low > TOLERANCE


def disturbance(kind: str, volts: float, rng: np.random.Generator) -> dict[str, Any]:
    """One fault of the laser's channel."""
    if kind == "mains":
        hz = float(rng.choice([50.0, 60.0, 49.9]))
        return {"kind": "mains-hum", "channel": "laser", "volts": volts, "frequency": hz}
    if kind == "flicker":
        return {"kind": "flicker-noise", "channel": "laser", "volts": volts / 2}
    turning = {"kind": "rotating-machine", "channel": "laser", "volts": volts}
    if kind == "fan":
        wander = float(rng.choice([0.0, 0.001]))
        return turning | {"frequency": float(rng.uniform(20, 300)), "wander": wander}
    starts = {"after": 1.0, "within": 12.0, "run_up": float(rng.uniform(0.3, 3))}
    return turning | {"frequency": float(rng.uniform(30, 300))} | starts


def press_of(rng: np.random.Generator) -> Representative:
    """A snap that rings in two or three partials."""
    t = np.arange(3000) / 5000
    since = np.maximum(t - 0.3, 0)
    partials = [
        (rng.uniform(80, 500), rng.uniform(2, 12), rng.uniform(0.004, 0.02))
        for _ in range(rng.integers(2, 4))
    ]
    shape = sum(a * np.exp(-since / decay) * np.sin(2 * np.pi * f * since) for f, a, decay in partials)
    return Representative(
        button="push",
        rate_hz=5000.0,
        acceleration=np.asarray(shape),
        force=np.zeros(len(t)),
        activation=np.asarray(t > 0.3, dtype=np.float64),
        activation_index=1500,
        members=1,
        spread=np.zeros(len(t)),
        bandwidth_hz=500.0,
        sources=(("P01-push.h5", "0" * 64),),
        left_out=(),
        method="made for a benchmark",
        simulated=True,
    )


def true_error(rig: Rig, drive: Drive, plays: int) -> tuple[Check, float, float]:
    """A check, and the true errors of the mean motion in its plays, from 20 Hz on.

    In all, to half of the drive's rate, and up to the frequency to which the check judged.
    """
    assert rig.simulation is not None
    excite, truth, seen = rig.excite_each, rig.simulation.truth, []

    def watched(volts: Any, *args: Any, **more: Any) -> Capture:
        record = truth.record()
        capture = excite(volts, *args, **more)
        lead = len(volts[drive.patch]) - len(drive.target)
        if lead >= 0 and np.array_equal(volts[drive.patch][lead:], drive.volts[0]):
            start = truth.began(record)
            times = start + (lead + np.arange(len(drive.target))) / drive.rate_hz
            seen.append(truth.velocity(drive.point, times))
        return capture

    rig.excite_each = watched  # type: ignore[method-assign]
    try:
        result = check(rig, drive, plays=plays)
    finally:
        rig.excite_each = excite  # type: ignore[method-assign]
    assert len(seen) == result.plays >= plays  # it plays on where that decides
    return result, *errors_of(np.mean(seen, axis=0), drive, result.judged_hz)


def errors_of(velocity: FloatArray, drive: Drive, top: float) -> tuple[float, float]:
    """Rms error over the target of a surface's `velocity`, (samples,) m/s on the drive's clock.

    From 20 Hz on: in all, to half of the drive's rate, and up to `top` (Hz).
    """
    f = np.fft.rfftfreq(len(drive.target), 1 / drive.rate_hz)
    target = np.fft.rfft(drive.target)
    missed = np.fft.rfft(velocity) * 2j * np.pi * f - target
    every, below = (np.linalg.norm(missed[(f >= 20) & (f < edge)]) for edge in (np.inf, top))
    return float(every / np.linalg.norm(target)), float(below / np.linalg.norm(target))


@dataclass(frozen=True)
class World:
    """A simulated rig: `plant` is a random plate, or empty for the table."""

    plant: Mapping[str, Any]
    simulation: Mapping[str, Any]

    def open(self, *faults: Mapping[str, Any], **changed: Any) -> Rig:
        """Open it with faults, and with other settings of the simulation."""
        return open_rig(
            "simulated", simulation={**self.simulation, **changed, "faults": list(faults)}, **self.plant
        )


def world(number: int, seed: str, rings: float = 1.0) -> World:
    """The world of a number: the table for even ones, else a plate. `rings` scales the damping."""
    rng = generator(seed, number)
    plant: Mapping[str, Any] = {}
    simulation: dict[str, Any] = {
        "seed": int(rng.integers(2**31)),
        "hysteresis": float(rng.uniform(0.03, 0.2)),
    }
    if number % 2:
        low = float(np.exp(rng.uniform(np.log(0.003), np.log(0.02)))) if rings == 1 else 0.008 * rings
        plant = {"plant": random_modal(rng, damping=(low, 2.5 * low))}
    elif rings == 1:
        simulation["damping_scale"] = float(np.exp(rng.uniform(np.log(0.25), np.log(1.5))))
    else:
        simulation["damping_scale"] = rings
    return World(plant, simulation)


def checked(number: int, levels: Levels, plays: int = 8, seed: str = "disturbed") -> Iterator[Row]:
    """The checks of one plant: `levels` by kind."""
    press = press_of(generator(seed, number, "press"))
    plain: Drive | None = None
    for kind, level in [(kind, level) for kind, several in levels.items() for level in several]:
        own = generator(seed, number, kind, level)
        # A third of the tables have drifted since, so that truth lies on either side of the tolerance.
        drift = level if kind == "quiet" else float(own.choice([0.0, 0.0, 1.0]) * own.normal(0, 0.006))
        here, before, after = world(number, seed), [], [{"kind": "mode-drift", "frequency": drift}]
        if kind in NOISE:
            after.append(disturbance(kind, level, own))
        elif kind == "askew":
            after.append({"kind": "laser-askew", "scale": level})
        elif kind == "even":
            shape = str(own.choice(["square", "kink", "lagging"]))
            before = [{"kind": "patch-asymmetry", "share": level, "shape": shape}]
        elif kind == "ringing":
            here = world(number, seed, level)
        try:
            drive = plain
            if drive is None or kind in ("even", "ringing"):
                with here.open(*before) as rig:
                    drive = drive_for(press, calibrate(rig), rig.limits)
            if kind not in ("even", "ringing"):
                plain = drive
            with here.open(*before, *after) as rig:
                # So that no two checks of a plant have the same noise of the laser.
                with rig.daq.stream(("laser",), 5e4, 5000, int(own.integers(1, 20_000))) as stream:
                    stream.capture()
                found, truth, below = true_error(rig, drive, plays)
        except HaploopError as error:
            yield Row(number, kind, level, "refused", *[np.nan] * 5, str(error))
            continue
        said = " ".join([*found.reasons, *found.notes])
        low, high = found.interval
        yield Row(number, kind, level, found.verdict, found.error, low, high, truth, below, said)


def table(rows: Sequence[Row]) -> Iterator[str]:
    """The lines of a table, in Markdown: by disturbance and by its level."""
    yield "| disturbed by | level | pass, fail, not shown | false pass | false fail | holds | median width |"
    yield "|---|---|---|---|---|---|---|"
    for kind in (*dict.fromkeys(row.kind for row in rows), "all"):
        for level in (*dict.fromkeys(row.level for row in rows), None):
            if (kind == "all") != (level is None):
                continue
            own = [r for r in rows if kind in (r.kind, "all") and level in (r.level, None)]
            if not own:
                continue
            verdicts = ", ".join(str(sum(r.verdict == v for r in own)) for v in VERDICTS)
            passes = sum(r.wrong and r.verdict == "pass" for r in own)
            fails = sum(r.wrong and r.verdict == "fail" for r in own)
            shown = [r for r in own if r.shown]
            width = float(np.median([r.high - r.low for r in shown])) if shown else np.nan
            yield (
                f"| {kind} | {'' if level is None else level} | {verdicts} | {passes} | {fails} "
                f"| {sum(r.holds for r in shown)} of {len(shown)} | {width:.1%} |"
            )


def main() -> None:
    """Print every check, then the table."""
    kinds = {**NOISE, **PLANTS}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--plants", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="number of the first plant")
    parser.add_argument("--kinds", nargs="+", default=list(kinds), choices=list(kinds))
    parser.add_argument("--seed", default="disturbed", help="word whose hashes all is drawn from")
    parser.add_argument("--keep", type=Path, help="add a JSON line for each check to this file")
    asked = parser.parse_args()
    rows: list[Row] = []
    for number in range(asked.first, asked.first + asked.plants):
        for row in checked(number, {kind: kinds[kind] for kind in asked.kinds}, seed=asked.seed):
            rows.append(row)
            mark = "WRONG" if row.wrong else "" if row.holds or not row.shown else "outside"
            print(
                f"{row.plant} {row.kind} {row.level}: {row.verdict} {row.error:.3f} ({row.low:.3f} to "
                f"{row.high:.3f}), true {row.truth:.3f} {mark} {row.said[:90]}",
                flush=True,
            )
            if asked.keep:
                with asked.keep.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(row)) + "\n")
    print("\n".join(table(rows)))


if __name__ == "__main__":
    main()
