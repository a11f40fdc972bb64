"""The paper's way: the generator sweeps the patches, and the DAQ and the laser measure."""

import pytest

from haploop.calibration.map.map import VibrationMap
from haploop.calibration.map.measuring import map_plan, measure_map
from tests.calibration.map.test_map import Mapped, error, simulated
from tests.calibration.response.test_generated import GENERATOR

pytestmark = pytest.mark.many_plays


@pytest.mark.long
def test_a_map_by_the_generator_is_the_plates_own(rigs, open, tmp_path):
    """Of a pane with modes far above the sweep: a pole of what it does not ring made 17 % between lines."""
    simulated(rigs)
    file = tmp_path / "generator.toml"
    file.write_text(GENERATOR)
    rig = open(str(file), seed=11, highest_hz=10_000.0)
    plan = map_plan(rig, points=(0, 14, 45), patches=("A", "B"), period=1.0)
    assert plan.swept and not plan.together
    measure_map(rig, tmp_path / "map", plan)
    found = VibrationMap.load(tmp_path / "map")
    assert error(Mapped(rig, found, tmp_path)) < 0.004
    assert max(dict(found.superposition).values()) < 0.02
    assert found.skipped == ()
