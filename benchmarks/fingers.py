"""Error of a played press under a finger: drives made for the bare table, another's finger, one's own.

    python -m benchmarks.fingers                     # one table, four people, three panes
    python -m benchmarks.fingers --people 10 --tables 3

A table is calibrated bare and mapped with two patches; then for each pane mass and person the finger is
calibrated at 1 N, by a laser that sees the point and by one that sees the four points next to it, with the
map. Drives are made for: the bare table, another person's finger at 1 N, the own finger at 1 N, three drives
of which the force sensor chooses one, the same from the map, and the own finger at the very force of the
press by the force law. Each is played while that finger rests with 0.25, 1 or 5 N, which wanders, with
hysteresis and quantisation. The error is the plant's own: the surface's motion under the finger against its
target, 20 Hz to 2.5 kHz. For one drive of each person, a check's verdict under the finger stands beside it;
and for each calibration its error against the plant's own response beside the one that it states. Seeds are
hashes.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.fft import irfft, rfft, rfftfreq

import haploop
from haploop.acquisition import Representative
from haploop.calibration import Calibration, Drive, PressedDrives
from haploop.calibration.response import settle
from haploop.instruments import Rig
from haploop.instruments.operator import LiftFinger, RestFinger
from haploop.mocks.plant.table import FEWEST_HZ
from haploop.mocks.plant.touched import touched_velocity
from haploop.mocks.plant.touches import Fingertip

MASSES = (0.96, 0.32, 0.096)
FORCES = (0.25, 1.0, 5.0)
WHOLE = (20.0, 2500.0)
BAND = np.arange(80.0, 600.0, 0.25)


def true_error(rig: Rig, drive: Drive, person: str, force: float) -> float:
    """Error of one play under a person's finger, of the surface's own motion."""
    settle(rig, "A")
    rig.operator.confirm(RestFinger(person, "button", force))
    rig.clock.sleep(0.6)
    truth = rig.simulation.truth
    played, volts = truth.record(), np.atleast_2d(drive.volts)[0]
    rig.excite(volts, ["A"], ["laser"])
    start = truth.began(played)
    velocity = truth.velocity("button", start + np.arange(len(volts)) / drive.rate_hz)
    rig.operator.confirm(LiftFinger())
    rig.clock.sleep(0.5)
    f = rfftfreq(len(volts), 1 / drive.rate_hz)
    inside = (f >= WHOLE[0]) & (f <= WHOLE[1])
    moved = irfft(np.where(inside, rfft(velocity) * 2j * np.pi * f, 0), len(volts))
    return float(np.linalg.norm(moved - drive.target) / np.linalg.norm(drive.target))


def true_finger(rig: Rig, made: Calibration, person: str) -> float:
    """Relative error of the response that a calibration states, at the force that it states."""
    plant, finger = rig.simulation.plant, made.finger
    assert finger is not None
    modes, place = plant.surface.modes(rig.clock.now()), plant.place("button")
    tip = Fingertip.of(plant.rng(f"fingertip of {person}")).at("a finger", place, finger.force)
    bare, under = (touched_velocity(modes, bodies, place, BAND)["A"] for bodies in ((), tip))
    return float(np.linalg.norm(finger.factor(BAND) * bare - under) / np.linalg.norm(under))


@dataclass(frozen=True, eq=False)
class Found:
    """What the tables said."""

    errors: dict[tuple[float, str], list[float]]
    stated: dict[tuple[float, str], list[tuple[float, float]]]
    """True and stated relative errors of the response under a finger."""
    checks: list[str]
    """What each check said beside the truth."""


def weighed(folder: Path) -> Path:
    """The simulated rig, with its force sensor under the table."""
    path = folder / "weighed.toml"
    path.write_text('base = "simulated"\n[table]\nforce = true\n', encoding="utf-8")
    return path


def study(seed: int, people: Sequence[str], press: Representative, found: Found, folder: Path) -> None:
    """Add what one table says."""
    file = weighed(folder)
    with haploop.open_rig(file, simulation={"seed": seed, "highest_hz": FEWEST_HZ}) as rig:
        bare = haploop.calibrate(rig, "A", "button")
        haploop.measure_map(rig, folder / str(seed), haploop.map_plan(rig, patches=["A", "B"]))
        plate = haploop.calibration.VibrationMap.load(folder / str(seed)).plate_modes()
        at_rest = haploop.drive_for(press, bare, rig.limits)
    others: dict[float, Drive] = {}
    for number, person in enumerate(people):
        for mass in MASSES:
            with haploop.open_rig(
                file, simulation={"seed": seed, "pane_mass": mass, "highest_hz": FEWEST_HZ}
            ) as rig:
                if mass not in others:
                    other = haploop.calibration.calibrate_finger(rig, bare, "P99")
                    others[mass] = haploop.drive_for(press, other, rig.limits)
                try:
                    own = haploop.calibration.calibrate_finger(rig, bare, person)
                    seen = haploop.calibration.calibrate_finger(rig, bare, person, plate=plate)
                except haploop.DataError as error:
                    found.checks.append(f"{mass:g} kg, {person}: not calibrated: {error}")
                    print(found.checks[-1], flush=True)
                    continue
                for way, made in (("the point itself", own), ("four points beside, and the map", seen)):
                    assert made.finger is not None
                    pair = true_finger(rig, made, person), made.finger.uncertainty
                    found.stated[mass, way].append(pair)
                    told = f"{mass:g} kg, {person}, {way}: {pair[0]:.4f}, stated {pair[1]:.4f}"
                    print(f"{seed}, {told}", flush=True)
                pressed = [
                    haploop.calibration.pressed_drives(press, made, rig.limits) for made in (own, seen)
                ]
                for force in FORCES:
                    ways = {
                        "the bare table": at_rest,
                        "another person's finger, 1 N": others[mass],
                        "the own finger, 1 N": pressed[0].drives[1],
                        "the own finger, three drives": pressed[0].chosen(force)[0],
                        "the same, by four points and the map": pressed[1].chosen(force)[0],
                    }
                    for way, drive in ways.items():
                        found.errors[mass, way].append(true_error(rig, drive, person, force))
                        told = f"{mass:g} kg, {person}, {force:g} N, {way}: {found.errors[mass, way][-1]:.3f}"
                        print(f"{seed}, {told}", flush=True)
                drive = (at_rest, pressed[0])[number % 2]
                found.checks.append(checked(rig, drive, person, FORCES[number % 3]))
                print(found.checks[-1], flush=True)


def checked(rig: Rig, drive: Drive | PressedDrives, person: str, force: float) -> str:
    """What a check under a finger says, beside the truth."""
    result = haploop.calibration.check_under_finger(rig, drive, person, force=force, plays=4)
    true = true_error(rig, result.drive, person, force)
    low, high = result.interval
    right = {"pass": true <= result.tolerance, "fail": true > result.tolerance}
    mass = rig.simulation.plant.settings.settings["pane_mass"]
    verdict = "not shown" if result.verdict not in right else f"verdict {right[result.verdict]}"
    inside = "inside" if low - 0.01 <= true <= high + 0.01 else "outside"
    return (
        f"{mass:g} kg, {person}, {force:g} N: {result.verdict}, {result.error:.3f} ({low:.3f} to "
        f"{high:.3f}), "
        f"true {true:.3f}, {verdict}, {inside}"
    )


def main() -> None:
    """Print the errors as a table, and each check beside the truth."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--tables", type=int, default=1)
    parser.add_argument("--people", type=int, default=4)
    parser.add_argument("--seed", default="medlar jelly")
    asked = parser.parse_args()
    found = Found(defaultdict(list), defaultdict(list), [])
    people = [f"P{number:02}" for number in range(1, asked.people + 1)]
    with tempfile.TemporaryDirectory() as folder:
        os.environ["HAPLOOP_STATE"] = folder
        with haploop.open_rig("simulated") as rig:
            recording = haploop.record(rig, button="push", participant="P01", presses=3, out=folder)
        press = haploop.representative([recording])
        for number in range(asked.tables):
            own = int(hashlib.sha256(f"{asked.seed} {number}".encode()).hexdigest()[:7], 16)
            study(own, people, press, found, Path(folder))
    print("\n| mean error (worst) | " + " | ".join(f"{mass:g} kg" for mass in MASSES) + " |")
    print("|---" * (len(MASSES) + 1) + "|")
    for way in dict.fromkeys(way for _, way in found.errors):
        each = [found.errors[mass, way] for mass in MASSES]
        print(f"| {way} | " + " | ".join(f"{np.mean(one):.3f} ({max(one):.3f})" for one in each) + " |")
    for (mass, way), pairs in found.stated.items():
        true, stated = np.array(pairs).T
        over = true / stated
        print(
            f"{mass:g} kg, {way}: true {np.sqrt(np.mean(true**2)):.4f}, stated "
            f"{np.sqrt(np.mean(stated**2)):.4f}, ratio {np.sqrt(np.mean(over**2)):.2f} rms, at most "
            f"{over.max():.2f}"
        )
    print("\n" + "\n".join(found.checks))


if __name__ == "__main__":
    main()
