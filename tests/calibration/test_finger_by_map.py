"""What a finger does at its own point, from points beside it and the modes of a map."""

from dataclasses import replace

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError, DataError
from haploop.calibration import Calibration, VibrationMap, map_plan, measure_map
from haploop.calibration.model import PlateModes, calibrate_finger
from haploop.instruments import Rig
from haploop.mocks.plant.touched import touched_velocity
from haploop.mocks.plant.touches import Fingertip
from tests.raising import raises

pytestmark = [pytest.mark.many_plays, pytest.mark.requires("simulation"), pytest.mark.long]

BAND = np.arange(80.0, 600.0, 0.25)


def missed(rig: Rig, made: Calibration, who: str = "P07") -> float:
    """Error of the response under the finger at exactly the force that the calibration states, from the
    plant."""
    plant, finger = rig.simulation.plant, made.finger
    modes, place = plant.surface.modes(rig.clock.now()), plant.place("button")
    tip = Fingertip.of(plant.rng(f"fingertip of {who}")).at("a finger", place, finger.force)
    bare, under = (touched_velocity(modes, bodies, place, BAND)["A"] for bodies in ((), tip))
    return float(np.linalg.norm(finger.factor(BAND) * bare - under) / np.linalg.norm(under))


def true_modes(rig: Rig) -> PlateModes:
    """The modes of the plant itself, as a perfect map has them."""
    plant = rig.simulation.plant
    modes = plant.surface.modes(0.0)
    w = 2 * np.pi * modes.natural_hz
    points = tuple(str(number) for number in range(rig.table.rows * rig.table.columns))
    shapes = np.array([modes.shape(plant.place(point)) for point in points]).T
    shapes /= np.sqrt(np.mean(shapes**2, axis=1))[:, None]
    poles = w * (-modes.damping + 1j * np.sqrt(1 - modes.damping**2))
    return PlateModes(points, str(rig.table.button_point), poles, shapes, np.full(len(points), 0.002))


@pytest.mark.parametrize("mass", [0.96, pytest.param(0.2, marks=pytest.mark.night)])
def test_neighbours_and_modes_tell_unseen_fingers(calibrated, open, mass):
    rig = open(pane_mass=mass)
    made = calibrate_finger(rig, calibrated.calibration, "P07", plate=true_modes(rig))
    assert made.finger is not None and made.finger.beside == ("19", "21", "8", "32") and made.finger.mapped
    assert missed(rig, made) < 0.05 * made.finger.changed + 0.003
    assert missed(rig, made) < 3 * made.finger.uncertainty < 0.06


@pytest.mark.night
def test_a_pane_that_drifted_since_its_map_is_the_same_pane(calibrated, open):
    rig = open(pane_mass=0.3)
    plate = true_modes(rig)
    drifted = replace(plate, poles=1.01 * plate.poles)
    made = calibrate_finger(rig, calibrated.calibration, "P07", plate=drifted, beside="21")
    assert made.finger is not None and made.finger.beside == ("21",)
    assert missed(rig, made) < 0.05 * made.finger.changed
    with pytest.raises(DataError, match="different tables"):
        calibrate_finger(rig, calibrated.calibration, "P07", plate=replace(plate, poles=30 * plate.poles))


def test_points_that_are_not_beside_the_finger_are_refused(calibrated, open):
    rig, bare = open(), calibrated.calibration
    plate = true_modes(rig)
    for wrong, told in (("20", "is the one under the finger"), ("84", "from 0 to 83"), ("x", "no point 'x'")):
        raises(ConfigurationError, told, calibrate_finger, rig, bare, "P07", beside=wrong)
    few = replace(plate, points=("20", "83"), shapes=plate.shapes[:, [20, 83]])
    raises(ConfigurationError, "no point next to", calibrate_finger, rig, bare, "P07", plate=few)
    raises(DataError, "The map has no point 21", calibrate_finger, rig, bare, "P07", plate=few, beside="21")


@pytest.mark.night
def test_a_map_gives_the_modes_of_its_pane_and_each_once(open, tmp_path):
    """Of a grid of 24 points. A map of too few of them is refused."""
    coarse = tmp_path / "coarse.toml"
    coarse.write_text('base = "simulated"\n[table]\nrows = 4\ncolumns = 6\nbutton_point = 9\n')
    rig = open(str(coarse))
    measure_map(rig, tmp_path / "map", map_plan(rig, patches=("A", "B")))
    found, true = VibrationMap.load(tmp_path / "map").plate_modes(), true_modes(rig)
    assert found.button == "9" and found.points == true.points
    for frequency in (np.abs(found.poles) / (2 * np.pi))[np.abs(found.poles) < 2 * np.pi * 600]:
        number = int(np.argmin(np.abs(np.abs(true.poles) / (2 * np.pi) - frequency)))
        mine = found.shapes[int(np.argmin(np.abs(np.abs(found.poles) / (2 * np.pi) - frequency)))]
        assert abs(np.abs(true.poles[number]) / (2 * np.pi * frequency) - 1) < 1e-3
        assert abs(np.mean(mine * true.shapes[number])) > 0.999
    assert np.sum(np.abs(found.poles) < 2 * np.pi * 600) == np.sum(np.abs(true.poles) < 2 * np.pi * 600)

    measure_map(rig, tmp_path / "few", map_plan(rig, points=range(6), patches=("A",)))
    with pytest.raises(DataError, match="6 of 24 points"):
        VibrationMap.load(tmp_path / "few").plate_modes()
