"""A hand on the table, told from a drift: what `recalibrate` says of tables that somebody leans on.

    python -m benchmarks.hands                        # eight tables
    python -m benchmarks.hands --tables 20 --seed abc

Each table is calibrated bare, with noise, hysteresis and quantisation, and has a button. Then somebody leans
on it: fingertips of 0.25 to 5 N and palms, of people and at places drawn at random, on panes of the whole, a
third and a tenth of the mass, on the table as it was and on a drifted one. `recalibrate` runs on it, with
nobody there, on a copy of the history; nothing may be adopted. Tables with a drift alone are only looked at,
by every patch, as a rig with a channel for each is: one that takes the drift for a hand is enough.
A hand that is not named matters by how much it changes the response, which is shown. Seeds are hashes.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import haploop
from haploop.acquisition import Representative
from haploop.base.progress import silent
from haploop.calibration.recalibration import History, adopt, recalibrate
from haploop.calibration.recalibration.look import look_at
from haploop.instruments.operator.unattended import Unattended

MASSES = (0.96, 0.32, 0.096)
FORCES = (0.25, 1.0, 5.0)


@dataclass(frozen=True)
class Found:
    """What was there, and what was said of it."""

    there: bool
    named: bool
    change: float
    """Of the bare response (relative rms)."""
    kind: str
    adopted: bool


Condition = tuple[str, bool, dict[str, Any]]


def conditions(rng: np.random.Generator) -> Iterator[Condition]:
    """Name, whether a hand is on the table, and what is simulated."""

    def hand(**settings: Any) -> dict[str, Any]:
        where, who = int(rng.integers(84)), f"P{int(rng.integers(100)):02}"
        return {"kind": "hand-on-table", "point": str(where), "participant": who, **settings}

    def drift(**settings: Any) -> dict[str, Any]:
        return {"kind": "mode-drift", **settings}

    for mass in MASSES:
        for force in FORCES:
            yield (
                f"finger of {force:g} N, {mass:g} kg",
                True,
                {"pane_mass": mass, "faults": [hand(force=force)]},
            )
        moved = drift(frequency=float(rng.normal(0, 0.01)), frequency_each=0.005)
        both = [hand(force=float(rng.choice(FORCES))), moved]
        yield f"finger on a drifted table, {mass:g} kg", True, {"pane_mass": mass, "faults": both}
        yield f"palm, {mass:g} kg", True, {"pane_mass": mass, "faults": [hand(force=5.0, palm=True)]}
    yield "as it was", False, {}
    yield "all modes by 1 %", False, {"mode_drift": 0.01}
    yield "all modes by 1 to 3 %", False, {"mode_drift": float(rng.choice([-0.03, -0.01, 0.02, 0.03]))}
    yield "each mode by 1 %", False, {"faults": [drift(frequency_each=0.01)]}
    yield "each mode by 3 %", False, {"faults": [drift(frequency_each=0.03)]}
    yield "all dampings by 20 to 30 %", False, {"damping_scale": float(rng.choice([0.7, 0.8, 1.2, 1.3]))}
    yield "each damping by 20 %", False, {"faults": [drift(damping_each=0.2)]}
    yield (
        "patch weaker, hysteresis of another law",
        False,
        {"faults": [{"kind": "patch-gain", "gain": 0.9}, {"kind": "patch-hysteresis", "width": 0.15}]},
    )


def run(tables: int, seed: str, press: Representative, folder: Path) -> Mapping[str, list[Found]]:
    """What was found in each condition."""
    found: dict[str, list[Found]] = defaultdict(list)
    for number in range(tables):
        own = int(hashlib.sha256(f"{seed} {number}".encode()).hexdigest()[:7], 16)
        rng, kept = np.random.default_rng(own), folder / f"{own}"
        with haploop.open_rig("simulated", simulation={"seed": own}) as rig:
            every = [haploop.calibrate(rig, patch, "button") for patch in "ABCD"]
            active = every[0]
            button = haploop.build_button(rig, press, active, iterations=0)
            f = active.response.frequencies
            bare = rig.simulation.truth.velocity_response("A", "button", f)
        if not button.passed:
            print(f"table {own} has no button that passes, and is left out", flush=True)
            continue
        adopt(History(kept), [button], actor="benchmark", reason="it begins")
        for name, there, simulation in conditions(rng):
            with haploop.open_rig("simulated", simulation={"seed": own, **simulation}) as rig:
                rig.clock.sleep(1.0)
                now = rig.simulation.truth.velocity_response("A", "button", f)
                change = float(np.linalg.norm(now - bare) / np.linalg.norm(bare))
                if there:
                    rig.adopt("operator", Unattended())
                    history = History(shutil.copytree(kept, folder / "copy"))
                    outcome = recalibrate(rig, history, iterations=1)
                    named = any(one.dampings.touched for one in outcome.verdicts)
                    adopted = len(history.activations) > 1
                    found[name].append(
                        Found(there, named or outcome.kind == "touched", change, outcome.kind, adopted)
                    )
                    shutil.rmtree(folder / "copy")
                else:
                    look = look_at(rig, every, {}, None, silent)
                    found[name].append(Found(there, look.touched, change, look.kind, False))
            print(f"table {own}, {name}: {found[name][-1]}", flush=True)
    return found


def main() -> None:
    """Print a table of what was named, and adopted."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--tables", type=int, default=8)
    parser.add_argument("--seed", default="hands35")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as state:
        os.environ["HAPLOOP_STATE"] = state
        with haploop.open_rig("simulated") as rig:
            recording = haploop.record(rig, button="push", participant="P01", presses=3, out=state)
        found = run(asked.tables, asked.seed, haploop.representative([recording]), Path(state))
    print(
        "\n| table | hand named | outcomes | adopted | largest change of a response under a hand not named |"
    )
    print("|---|---|---|---|---|")
    for name, results in found.items():
        kinds = [one.kind for one in results]
        said = ", ".join(f"{kind} {kinds.count(kind)}" for kind in sorted(set(kinds)))
        missed = [one.change for one in results if one.there and not one.named]
        named, adopted = sum(one.named for one in results), sum(one.adopted for one in results)
        worst = f"{max(missed):.1%}" if missed else ""
        print(f"| {name} | {named} of {len(results)} | {said} | {adopted} | {worst} |")


if __name__ == "__main__":
    main()
