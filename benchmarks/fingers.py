"""Error of a played press under a finger: drives made for the bare table, another's finger, one's own.

    python -m benchmarks.fingers                     # one table, four people, three panes
    python -m benchmarks.fingers --people 10 --tables 3

A table is calibrated bare; then for each pane mass and person the finger is calibrated at 1 N, and drives are
made for: the bare table, another person's finger at 1 N, the own finger at 1 N, and the own finger at the
force of the press by the force law (one of three drives). Each is played while that finger rests with 0.25,
1 or 5 N, which wanders, with hysteresis and quantisation. The error is the plant's own: the surface's motion
under the finger against its target, 20 Hz to 2.5 kHz. For one drive of each person, a check's verdict
under the finger stands beside it. Seeds are hashes.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import tempfile
from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from scipy.fft import irfft, rfft, rfftfreq

import haploop
from haploop.acquisition import Representative
from haploop.calibration import Calibration, Drive
from haploop.calibration.response import settle
from haploop.instruments import Rig
from haploop.instruments.operator import LiftFinger, RestFinger

MASSES = (0.96, 0.32, 0.096)
FORCES = (0.25, 1.0, 5.0)
WHOLE = (20.0, 2500.0)
Errors = dict[tuple[float, str], list[float]]


def true_error(rig: Rig, drive: Drive, person: str, force: float) -> float:
    """Error of one play under a person's finger, of the surface's own motion."""
    settle(rig, "A")
    rig.operator.confirm(RestFinger(person, "button", force))
    rig.clock.sleep(0.6)
    truth = rig.simulation.truth
    played, volts = truth.record(), np.atleast_2d(drive.volts)[0]
    rig.excite(volts, ["A"], ["laser"])
    start = next(part.start for part in played if part.closed and np.isfinite(part.period))
    velocity = truth.velocity("button", start + np.arange(len(volts)) / drive.rate_hz)
    rig.operator.confirm(LiftFinger())
    rig.clock.sleep(0.5)
    f = rfftfreq(len(volts), 1 / drive.rate_hz)
    inside = (f >= WHOLE[0]) & (f <= WHOLE[1])
    moved = irfft(np.where(inside, rfft(velocity) * 2j * np.pi * f, 0), len(volts))
    return float(np.linalg.norm(moved - drive.target) / np.linalg.norm(drive.target))


def study(seed: int, people: Sequence[str], press: Representative, errors: Errors) -> list[str]:
    """Add the errors of one table; return what the check said beside the truth."""
    said = []
    with haploop.open_rig("simulated", simulation={"seed": seed}) as rig:
        bare = haploop.calibrate(rig, "A", "button")
    for mass in MASSES:
        with haploop.open_rig("simulated", simulation={"seed": seed, "pane_mass": mass}) as rig:

            def made(calibration: Calibration, rig: Rig = rig) -> Drive:
                return haploop.drive_for(press, calibration, rig.limits)

            at_rest = made(bare)
            other = made(haploop.calibrate_finger(rig, bare, "P99"))
            for person in people:
                finger = haploop.calibrate_finger(rig, bare, person)
                assert finger.finger is not None
                own = made(finger)
                by_force = {F: made(haploop.under_finger(bare, finger.finger, F)) for F in FORCES}
                for force in FORCES:
                    ways = {
                        "made bare": at_rest,
                        "another's finger, 1 N": other,
                        "own finger, 1 N": own,
                        "own finger, three drives by force": by_force[force],
                    }
                    for way, drive in ways.items():
                        errors[mass, way].append(true_error(rig, drive, person, force))
                        told = f"{mass:g} kg, {person}, {force:g} N, {way}: {errors[mass, way][-1]:.3f}"
                        print(f"table {seed}, {told}", flush=True)
                number = people.index(person)
                checked = (at_rest, own)[number % 2]
                force = FORCES[number % 3]
                result = haploop.check_under_finger(rig, checked, person, force=force, plays=4)
                true = true_error(rig, checked, person, force)
                low, high = result.interval
                said.append(
                    f"{mass:g} kg, {person}, {force:g} N: {result.verdict}, {result.error:.3f} "
                    f"({low:.3f} to {high:.3f}), true {true:.3f}"
                )
                print(said[-1], flush=True)
    return said


def main() -> None:
    """Print the errors as a table, and each check beside the truth."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--tables", type=int, default=1)
    parser.add_argument("--people", type=int, default=4)
    parser.add_argument("--seed", default="fingers35")
    asked = parser.parse_args()
    errors: Errors = defaultdict(list)
    said: list[str] = []
    people = [f"P{number:02}" for number in range(1, asked.people + 1)]
    with tempfile.TemporaryDirectory() as folder:
        os.environ["HAPLOOP_STATE"] = folder
        with haploop.open_rig("simulated") as rig:
            recording = haploop.record(rig, button="push", participant="P01", presses=3, out=folder)
        press = haploop.representative([recording])
        for number in range(asked.tables):
            own = int(hashlib.sha256(f"{asked.seed} {number}".encode()).hexdigest()[:7], 16)
            said += study(own, people, press, errors)
    print("\n| mean error (worst) | " + " | ".join(f"{mass:g} kg" for mass in MASSES) + " |")
    print("|---" * (len(MASSES) + 1) + "|")
    for way in dict.fromkeys(way for _, way in errors):
        cells = [f"{np.mean(errors[mass, way]):.3f} ({max(errors[mass, way]):.3f})" for mass in MASSES]
        print(f"| {way} | {' | '.join(cells)} |")
    print("\n" + "\n".join(said))


if __name__ == "__main__":
    main()
