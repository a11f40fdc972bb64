import numpy as np
import pytest

from haploop.instruments import LinearSensor, load_rig_file
from haploop.instruments.sensors import AccelerationTable, loss


def accelerometer(rig: str) -> LinearSensor:
    sensor = load_rig_file(rig).sensors.acceleration
    assert sensor is not None
    return sensor


def test_a_stock_board_says_what_it_costs():
    said = loss(accelerometer("stock-accelerometer"), 263.5)
    assert "passes 50 Hz" in said and "19%" in said and "-14.6 dB" in said and "79 degrees" in said
    assert loss(accelerometer("simulated"), 263.5) is None


def test_one_vertical_axis_needs_no_letter():
    assert accelerometer("usb-6211").labels == (("acceleration", "m/s^2"),)
    assert [name for name, _ in accelerometer("simulated").labels] == [f"acceleration {a}" for a in "xyz"]


def test_supply_and_capacitor_give_what_was_not_measured():
    stated = {"channels": ("x", "y", "z"), "supply": 3.3, "capacitor": 0.1e-6}
    board = AccelerationTable.model_validate(stated).sensor()
    assert 9.80665 / board.matrix[2][2] == pytest.approx(0.33)
    assert board.zero == pytest.approx((1.65,) * 3)
    assert board.range == pytest.approx((29.42,) * 3, abs=0.01)
    assert board.bandwidth_hz == pytest.approx(49.7, abs=0.1)
    measured = AccelerationTable.model_validate({**stated, "zero": 1.62, "low_pass_hz": 48}).sensor()
    assert measured.zero == (1.62,) * 3 and measured.matrix == board.matrix and measured.bandwidth_hz == 48


def test_volts_become_metres_per_second_squared():
    sensor = accelerometer("simulated")
    g = np.array(sensor.zero)[:, None] + np.array([[0.0, 9.80665, 40.0]] * 3) / sensor.matrix[0][0]
    assert sensor.to_si(g)[2] == pytest.approx([0, 9.80665, 40])
    assert sensor.along(g) == pytest.approx([0, 9.80665, 40])
    assert sensor.saturated(g).tolist() == [False, False, True]


def test_the_matrix_gives_newtons_and_saturation():
    force = load_rig_file("simulated").sensors.force
    wanted = np.array([1.0, -2.0, 10.0, 0.1, 0.2, -0.1])
    volts = np.linalg.solve(np.array(force.matrix), wanted)[:, None]
    assert force.to_si(volts)[:, 0] == pytest.approx(wanted)
    assert force.along(volts) == pytest.approx([10.0])
    assert not force.saturated(volts)[0]
    assert force.saturated(13 * volts)[0]  # Fz beyond 120 N
