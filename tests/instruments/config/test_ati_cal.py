"""ATI `.cal` files, made up here with the structure of a real one and another matrix."""

from pathlib import Path

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError
from haploop.instruments import load_rig_file
from haploop.instruments.config.ati_cal import read_ati_cal
from haploop.instruments.sensors import ForceTable, LinearSensor
from tests.raising import raises

CHANNELS = tuple(f"gauge{i}" for i in range(6))
MATRIX = np.round(np.eye(6) * [3, 3, 5, 80, 80, 40] + 0.01 * np.arange(36).reshape(6, 6), 4)
RATINGS = (40, 40, 120, 2000, 2000, 2000)
NAMES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")


HEAD = '<?xml version="1.0" encoding="utf-8"?>'


def cal(torque="N-mm", force="N", bipolar="True", axis="UserAxis", version="1.1", head=HEAD) -> str:
    rows = "\n".join(
        f'<{axis} Name="{n}" values="  {"   ".join(f"{v:.6f}" for v in row)}" max="{rating}"/>'
        for n, row, rating in zip(NAMES, MATRIX, RATINGS, strict=True)
    )
    return f"""{head}
<!-- NOTE: use the UserAxis rows -->
<FTSensor Serial="FT99999" BodyStyle="Mini40" Family="DAQ" NumGages="6" CalFileVersion="{version}">
  <Calibration PartNumber="SI-40-2" CalDate="1/2/2020" ForceUnits="{force}" TorqueUnits="{torque}"
   DistUnits="m" OutputMode="Ground Referenced Differential" OutputRange="20" HWTempComp="True"
   GainMultiplier="1" CableLossDetection="False" OutputBipolar="{bipolar}">
    <Axis Name="Fx" values="1 2 3 4 5 6" max="40" scale="7"/>
    <BasicTransform Dx="0" Dy="0" Dz="0.004" Rx="0" Ry="0" Rz="0"/>
    {rows}
  </Calibration>
</FTSensor>"""


def load_ati_cal(path: Path, channels: tuple[str, ...]) -> LinearSensor:
    """The sensor that a rig file describes by this file."""
    return ForceTable.model_validate({"channels": channels, **read_ati_cal(path).table}).sensor()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "FT99999.cal"


def test_reads_the_user_axes_in_si(path):
    path.write_text(cal(), encoding="utf-8")
    sensor = load_ati_cal(path, CHANNELS)
    assert sensor.channels == CHANNELS
    np.testing.assert_allclose(np.array(sensor.matrix)[:3], MATRIX[:3])
    np.testing.assert_allclose(np.array(sensor.matrix)[3:], MATRIX[3:] / 1000)
    assert sensor.range == pytest.approx((40, 40, 120, 2, 2, 2))
    assert sensor.output == 10
    assert sensor.to_si(np.eye(6))[2, 2] == pytest.approx(MATRIX[2, 2])
    own = read_ati_cal(path)
    assert (own.serial, own.part_number, own.date) == ("FT99999", "SI-40-2", "1/2/2020")


@pytest.mark.parametrize(
    ("torque", "scale"), [("N-m", 1.0), ("N-mm", 1e-3), ("lbf-in", 0.1129848), ("in-lb", 0.1129848)]
)
def test_torque_units(path, torque, scale):
    path.write_text(cal(torque=torque), encoding="utf-8")
    matrix = np.array(load_ati_cal(path, CHANNELS).matrix)
    np.testing.assert_allclose(matrix[3:], MATRIX[3:] * scale, rtol=1e-6)
    np.testing.assert_allclose(matrix[:3], MATRIX[:3])


def test_force_units_and_a_unipolar_output(path):
    path.write_text(cal(force="lbf", bipolar="False"), encoding="utf-8")
    sensor = load_ati_cal(path, CHANNELS)
    assert sensor.range is not None and sensor.range[0] == pytest.approx(177.929)
    assert sensor.output == 20


@pytest.mark.parametrize(("text", "sentence"), [
    (cal(axis="Axis", version="1.0"), r"version 1.0 and has no UserAxis rows; ask ATI"),
    (cal(torque="furlong"), r"TorqueUnits are 'furlong'"),
    (cal(force="dyn"), r"ForceUnits are 'dyn'"),
    (cal().replace(f"{MATRIX[1, 1]:.6f}", "nan"), r"values of UserAxis Fy"),
    (cal().replace(f"{MATRIX[1, 1]:.6f}", ""), r"values of UserAxis Fy .* 6 numbers are expected"),
    (cal().replace('<UserAxis Name="Tz"', '<UserAxis Name="Tq"'), r"no UserAxis row Tz"),
    (cal().replace('max="120"', 'max="0"'), r"max of UserAxis Fz is 0"),
    (cal().replace('NumGages="6"', 'NumGages="7"'), r"7 gauges"),
    (cal()[:400], r"is no XML"),
    ("", r"is no XML"),
    ("<html/>", r"holds 0 calibrations"),
    (cal(head='<!DOCTYPE FTSensor [<!ENTITY x SYSTEM "file:///etc/hostname">]>'), r"document type"),
])  # fmt: skip
def test_what_is_wrong_is_one_sentence(path, text, sentence):
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=rf"FT99999.cal cannot be used: .*{sentence}") as caught:
        load_ati_cal(path, CHANNELS)
    assert "\n" not in str(caught.value)


def test_a_missing_file_and_too_few_channels(path):
    raises(ConfigurationError, r"No such file or directory; correct the path", load_ati_cal, path, CHANNELS)
    path.write_text(cal(), encoding="utf-8")
    raises(ValueError, r"row 1 of matrix has 6 numbers for 2 channels", load_ati_cal, path, CHANNELS[:2])


def test_a_rig_file_names_the_sensors_own_file(path):
    path.write_text(cal(), encoding="utf-8")
    rig = path.parent / "rig.toml"
    gauges = ", ".join(f'"{name}"' for name in CHANNELS)
    table = f'[sensors.force]\nchannels = [{gauges}]\ncalibration = "FT99999.cal"\n'
    rig.write_text(f'base = "haptable"\nname = "mine"\n{table}', encoding="utf-8")
    force = load_rig_file(rig).sensors.force
    assert (force.stated["serial"], force.stated["calibration"]) == ("FT99999", "FT99999.cal")
    np.testing.assert_allclose(np.array(force.matrix)[2], MATRIX[2])
    for more, says in (("matrix = []\n", "either matrix or calibration"), ("", "FT99999")):
        rig.write_text(f'base = "haptable"\n{table}{more}', encoding="utf-8")
        raises(ConfigurationError, says, load_rig_file, rig)
        path.unlink(missing_ok=True)
