"""A hand on the table, told from a drift: what `recalibrate` says of tables that somebody leans on.

    python -m benchmarks.hands                        # eight tables
    python -m benchmarks.hands --tables 20 --seed abc

Each table is calibrated bare, with noise, hysteresis and quantisation. It is then looked at, as `recalibrate`
looks at it, on panes of the whole, a third and a tenth of the mass: under fingertips of 0.25 to 5 N and under
palms, of people and at places drawn at random, on the table as it was and on a drifted one; and with drifts
alone. A hand that is not named matters by how much it changes the response, which is shown. Seeds are hashes.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

import haploop
from haploop.calibration.upkeep.look import look_at
from haploop.instruments.progress import silent

MASSES = (0.96, 0.32, 0.096)
FORCES = (0.25, 1.0, 5.0)
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
    yield "all modes by 1 to 3 %", False, {"mode_drift": float(rng.choice([-0.03, -0.01, 0.01, 0.03]))}
    yield "each mode by 1 %", False, {"faults": [drift(frequency_each=0.01)]}
    yield "each mode by 3 %", False, {"faults": [drift(frequency_each=0.03)]}
    yield "all dampings by 20 to 30 %", False, {"damping_scale": float(rng.choice([0.7, 0.8, 1.2, 1.3]))}
    yield "each damping by 20 %", False, {"faults": [drift(damping_each=0.2)]}
    yield (
        "patch weaker, hysteresis of another law",
        False,
        {"faults": [{"kind": "patch-gain", "gain": 0.9}, {"kind": "patch-hysteresis", "width": 0.15}]},
    )


def run(tables: int, seed: str) -> Mapping[str, list[tuple[bool, bool, float, str]]]:
    """By condition: whether a hand was there, whether it was named, the response's change, the verdict."""
    found: dict[str, list[tuple[bool, bool, float, str]]] = defaultdict(list)
    for number in range(tables):
        own = int(hashlib.sha256(f"{seed} {number}".encode()).hexdigest()[:7], 16)
        rng = np.random.default_rng(own)
        with haploop.open_rig("simulated", simulation={"seed": own}) as rig:
            active = haploop.calibrate(rig, "A", "button")
            f = active.response.frequencies
            bare = rig.simulation.truth.velocity_response("A", "button", f)
        for name, there, simulation in conditions(rng):
            with haploop.open_rig("simulated", simulation={"seed": own, **simulation}) as rig:
                rig.clock.sleep(1.0)
                look = look_at(rig, [active], {}, None, silent)
                now = rig.simulation.truth.velocity_response("A", "button", f)
            change = float(np.linalg.norm(now - bare) / np.linalg.norm(bare))
            found[name].append((there, look.touched, change, look.kind))
            print(f"table {own}, {name}: {look.kind}, {'named' if look.touched else 'no hand'}", flush=True)
    return found


def main() -> None:
    """Print a table of what was named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--tables", type=int, default=8)
    parser.add_argument("--seed", default="hands35")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as state:
        os.environ["HAPLOOP_STATE"] = state
        found = run(asked.tables, asked.seed)
    print(
        "\n| table | hand named | verdicts | largest change of a response whose hand was not named |\n"
        "|---|---|---|---|"
    )
    for name, results in found.items():
        named = sum(touched for _, touched, _, _ in results)
        kinds = ", ".join(
            f"{kind} {sum(one[3] == kind for one in results)}" for kind in sorted({o[3] for o in results})
        )
        missed = [change for there, touched, change, _ in results if there and not touched]
        print(f"| {name} | {named} of {len(results)} | {kinds} | {f'{max(missed):.1%}' if missed else ''} |")


if __name__ == "__main__":
    main()
