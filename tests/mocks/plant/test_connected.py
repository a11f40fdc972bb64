"""A twin from outside puts a signal on a channel of the DAQ."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.instruments import Press, Rig, Scale, Sensors, open_rig
from haploop.instruments.rig.opening import compare_scales
from tests.raising import raises

WASHER = """
base = "simulated"
name = "washer"
daq = { channels = { washer = { terminal = "Dev2/ai6", range = 5, config = "rse" } } }
sensors = { extra = { washer = { channel = "washer", scale = 20, unit = "N" } } }
"""


@pytest.fixture(params=["twin", "wire"])
def rig(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Rig]:
    path = tmp_path / "washer.toml"
    path.write_text(WASHER)
    with open_rig(path, simulate=request.param) as rig:
        yield rig


def read(rig: Rig, channels: list[str], seconds: float) -> np.ndarray:
    samples = round(seconds * rig.file.rate_hz)
    with rig.daq.stream(channels, rig.file.rate_hz, 250, samples) as stream:
        return stream.capture().volts


def test_the_finger_is_read_through_an_amplifier_of_another_package(rig):
    plant = rig.simulation.plant
    plant.connect("washer", lambda times: plant.force(times) / 20)
    plant.press(Press("push", "P01", 1, 1))
    volts = read(rig, ["washer"], 3.0)
    (press,) = plant.truth.presses
    strongest = press.force(np.linspace(press.start, press.stop, 20_001)).max()
    assert 20 * volts.max() == pytest.approx(strongest, rel=0.02)
    assert abs(20 * volts[0, :100].mean()) < 0.02


def test_a_signal_takes_the_place_of_a_sensor_and_leaves_its_neighbours(rig):
    rig.simulation.plant.connect("acceleration_y", lambda times: np.full(len(times), 0.25))
    volts = read(rig, ["acceleration_x", "acceleration_y", "acceleration_z"], 0.2).mean(axis=1)
    assert volts[1] == pytest.approx(0.25, abs=0.01)
    assert volts[0] == pytest.approx(1.65, abs=0.15) and volts[2] == pytest.approx(1.98, abs=0.15)
    with pytest.raises(ConfigurationError, match=r"channel 'wascher'.*washer"):
        rig.simulation.plant.connect("wascher", np.zeros_like)


@pytest.mark.parametrize(
    ("signal", "told"),
    [
        (lambda times: times[:-1], "shape"),
        (lambda times: np.full(len(times), np.nan), "not finite"),
        (lambda times: 1 / 0, "ZeroDivisionError"),
    ],
)
def test_a_signal_that_fails_is_one_sentence(tmp_path, signal, told):
    path = tmp_path / "washer.toml"
    path.write_text(WASHER)
    with open_rig(path) as rig:
        rig.simulation.plant.connect("washer", signal)
        raises(InstrumentError, f"signal.*failed.*{told}.*ask its author", read, rig, ["washer"], 0.1)


class Amplifier:
    def __init__(self, **scales: Scale) -> None:
        self.scales = scales


@pytest.mark.parametrize("scales", [None, [Scale(1, "N")], {"washer": 20.0}])
def test_scales_of_another_kind_are_one_sentence(scales):
    amplifier = Amplifier()
    amplifier.scales = scales
    with pytest.raises(ConfigurationError, match=r"'scales' of the charge .* ask the author"):
        compare_scales("charge", amplifier, SENSORS, "lab")


SENSORS = Sensors.model_validate(
    {
        "acceleration": {"channels": ("x", "y", "z"), "sensitivity": 0.01, "low_pass_hz": 500},
        "drive": {"channels": ("monitor",), "ratio": 100},
        "activation": {"channels": ("switch",)},
        "extra": {"washer": {"channel": "force", "scale": 20, "unit": "N"}},
    }
)


def test_scales_as_filed_are_accepted():
    as_filed = Amplifier(x=Scale(100, "m/s^2"), monitor=Scale(100.05, "V"), force=Scale(20, "N"))
    compare_scales("charge", as_filed, SENSORS, "lab")
    compare_scales("charge", object(), SENSORS, "lab")


@pytest.mark.parametrize(
    ("scales", "told"),
    [
        ({"z": Scale(10, "m/s^2")}, r"reports 10 m/s\^2 per V.*'z'.*\[sensors.acceleration\] says 100 m/s"),
        ({"monitor": Scale(1000, "V")}, r"1000 V per V.*\[sensors.drive\] says 100 V per V"),
        ({"force": Scale(20, "mN")}, r"20 mN per V.*\[sensors.extra.washer\] says 20 N per V"),
        ({"force": Scale(20.1, "N")}, r"20.1 N per V"),
        ({"force": Scale(-20, "N")}, r"-20 N per V"),
        ({"force": Scale(float("nan"), "N")}, r"nan N per V"),
        ({"switch": Scale(1, "V")}, r"'switch', and \[sensors\] has none"),
        ({"nowhere": Scale(1, "V")}, r"correct \[charge\]"),
    ],
)
def test_a_scale_unlike_the_rig_files_is_refused(scales, told):
    raises(ConfigurationError, told, compare_scales, "charge", Amplifier(**scales), SENSORS, "lab")
