"""A map that is killed anywhere and gone on with is the map that nothing had interrupted."""

import os
import random
import shutil
import time

import numpy as np
import pytest

from haploop.calibration.map.folder import MapFolder
from haploop.calibration.map.map import BAND, VibrationMap
from tests.calibration.map.killing import Victims

pytestmark = pytest.mark.many_plays

MAP = """
from pathlib import Path
from haploop.calibration.map.map import VibrationMap
from haploop.calibration.map.measuring import map_plan, measure_map
from haploop.instruments import open_rig
from tests.calibration.map.killing import serve

def run(folder):
    with open_rig("simulated", simulate="twin", simulation={{"seed": 147}}) as rig:
        plan = map_plan(rig, points={points}, patches={patches}, period={period})
        measure_map(rig, Path(folder), plan)
    if {full}:
        VibrationMap.load(folder)

# What a rig loads is loaded once.
open_rig("simulated", simulate="twin").close()
serve(run)
"""


def velocity(found: VibrationMap) -> np.ndarray:
    f = np.arange(*BAND, 0.5)
    return np.array([found.velocity(name, f) for name in found.configurations])


def measured(folder: MapFolder) -> dict[str, np.ndarray]:
    measurements = {step.name: folder.read(step) for step in folder.plan.steps if folder.file(step).exists()}
    return {name: point.velocity for name, point in measurements.items() if point is not None}


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.skipif(os.name == "nt", reason="Windows has no fork, which makes many kills cheap")
def test_killed_anywhere_and_gone_on_with_it_is_the_same_map(tmp_path, mode, full):
    """What was measured before the kill is the same to the last bit, and is not measured again.

    What comes after is measured on a table that has come to rest, by a plant whose noise begins anew: there
    is as much between the two maps as between two that nothing interrupted. Only --full fits them.
    """
    if mode != "twin":
        pytest.skip("kills a twin")
    rng = random.Random(5)
    size = {"points": (14, 45, 76), "patches": ("A", "B") if full else ("A",), "period": 1.0 if full else 0.5}
    ends = {"begun": 0, "measuring": 0, "fitting": 0}
    apart = []
    with Victims(MAP.format(**size, full=full)) as victims:
        began = time.monotonic()
        victims.begin(str(tmp_path / "whole"))
        assert victims.end() == 0
        took = time.monotonic() - began
        whole = MapFolder.open(tmp_path / "whole")
        uninterrupted = measured(whole)
        for number in range(20 if full else 2):
            path = tmp_path / f"{number}"
            victim = victims.begin(str(path))
            # Every step in turn, and the fit; anywhere within.
            while len(list(path.glob("*.h5"))) < (number + 1) % (1 + len(uninterrupted)):
                time.sleep(0.001)
            time.sleep(rng.uniform(0, 0.5 * took / len(uninterrupted)))
            victims.kill(victim)
            before = measured(MapFolder.open(path)) if (path / "map.json").exists() else {}
            for name, found in before.items():
                np.testing.assert_array_equal(found, uninterrupted[name])
            victims.begin(str(path))
            assert victims.end() == 0
            folder = MapFolder.open(path)
            after = measured(folder)
            assert folder.plan == whole.plan and after.keys() == uninterrupted.keys()
            for name in before:
                np.testing.assert_array_equal(after[name], uninterrupted[name])
            done = before.keys() == after.keys()
            ends["fitting" if done else "measuring" if before else "begun"] += 1
            if full:
                found, expected = velocity(VibrationMap.load(path)), velocity(VibrationMap.load(whole.path))
                apart.append(float(np.linalg.norm(found - expected) / np.linalg.norm(expected)))
                assert not done or apart[-1] == 0
            shutil.rmtree(path)
    print(ends, f"apart {max(apart, default=0):.3%}")
    assert max(apart, default=0) < 0.002
    assert not full or all(ends.values())
