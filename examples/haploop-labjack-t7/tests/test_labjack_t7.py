"""The T7 on its twin, and the driver on an imitation of LabJack's package, whose calls are the real one's."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fake_ljm import FakeLjm
from haploop_labjack_t7.driver import LabJackT7
from haploop_labjack_t7.twin import T7Twin

import haploop
from haploop.base.clock import VirtualClock
from haploop.base.errors import ConfigurationError, InstrumentError, LimitError
from haploop.base.validation import validate
from haploop.instruments import Daq, Rig, load_rig_file
from haploop.instruments.conformance import DaqConformance, Fired, bypass_interlock
from haploop.mocks.plant import Faults, Plant

RIG = load_rig_file(Path(__file__).parents[1] / "t7.toml")
SETTINGS = LabJackT7.Settings.model_validate(RIG.daq.settings)


class TestTwin(DaqConformance):
    """Amplifier, patch A and the divider lie between output and input."""

    capabilities = ("outputs", "loop")
    channels = ("drive", "laser")
    outputs = ("amplifier",)
    output_range = 2.0
    loop = ("amplifier", "drive")
    loop_gain = 0.5
    faults = ("daq-overrun", "daq-overflow")

    @pytest.fixture
    def daq(self) -> Daq:
        self.plant = Plant(RIG, VirtualClock())
        self.plant.switch("A", True, 0.0)
        return T7Twin(SETTINGS, self.plant)

    @contextmanager
    def fault(self, kind: str) -> Iterator[Fired]:
        world = RIG.simulation.model_copy(update={"faults": ({"kind": kind},)})
        self.plant.faults = Faults.of_file(RIG.model_copy(update={"simulation": world}))
        yield self.plant.faults[0]


class TestDriver(DaqConformance):
    """The real driver, on an imitation of the package: both DACs against the input `drive`."""

    capabilities = ("outputs", "loop", "reopen")
    channels = ("drive", "laser", "gauge0")
    outputs = ("amplifier",)
    output_range = 2.0
    loop = ("amplifier", "drive")
    faults = ("lost", "gone")

    @pytest.fixture
    def daq(self) -> Daq:
        self.ljm = FakeLjm()
        return self.reopen()

    def reopen(self) -> Daq:
        return LabJackT7(SETTINGS, self.ljm)

    @contextmanager
    def fault(self, kind: str) -> Iterator[Fired]:
        self.ljm.lose_at = 100 if kind == "lost" else None
        self.ljm.dies_at = 100 if kind == "gone" else None
        yield SimpleNamespace(fired=1)


def test_each_call_is_one_of_the_real_package() -> None:
    """The imitation has the names and parameters of labjack-ljm, which loads without LabJack's library."""
    ljm = pytest.importorskip("labjack.ljm")
    for name, function in inspect.getmembers(FakeLjm, inspect.isfunction):
        if not name.startswith("_"):
            ours = [p for p in inspect.signature(function).parameters if p != "self"]
            assert ours == list(inspect.signature(getattr(ljm, name)).parameters), name
    assert issubclass(ljm.LJMError, Exception)


def test_without_labjacks_library_the_sentence_says_what_to_install() -> None:
    ljm = pytest.importorskip("labjack.ljm")
    if getattr(ljm.ljm, "_staticLib", None) is not None:
        pytest.skip("LabJack's library is installed here")
    with pytest.raises(ConfigurationError, match="LJM library does not load"):
        LabJackT7.open(SETTINGS, VirtualClock())


def opened() -> tuple[LabJackT7, FakeLjm]:
    ljm = FakeLjm()
    daq = LabJackT7(SETTINGS, ljm)
    bypass_interlock(daq)
    return daq, ljm


def test_the_t7_is_set_as_the_file_says() -> None:
    daq, ljm = opened()
    with daq.stream(["drive", "gauge0"], 5000, 100, 100):
        assert ljm.streaming is not None and ljm.streaming["list"] == [20, 0]
    assert ljm.registers["AIN10_RANGE"] == 1.0 and ljm.registers["AIN10_NEGATIVE_CH"] == 199.0
    assert daq.identity == "LabJack T7, serial 470012345"


def test_one_dac_carries_what_is_positive_and_the_other_what_is_not() -> None:
    daq, ljm = opened()
    wave = np.linspace(-1, 1, 201)
    with daq.stream(["drive"], 5000, 67, 201, {"amplifier": wave}) as stream:
        assert ljm.streaming is not None and ljm.streaming["list"] == [4800, 4801, 20]
        assert stream.capture().volts[0] == pytest.approx(wave, abs=1e-9)
        assert (ljm.registers["DAC0"], ljm.registers["DAC1"]) == (1.0, 0.0)
        assert daq.outputs_read() == {}
    assert daq.outputs_read() == {"amplifier": 0.0}


def test_more_than_it_streams_is_refused() -> None:
    for daq in (opened()[0], T7Twin(SETTINGS, Plant(RIG, VirtualClock()))):
        bypass_interlock(daq)
        with pytest.raises(ConfigurationError, match="2 inputs and 2 DACs at 25001 Hz need 100004"):
            daq.stream(["drive", "laser"], 25_001, 100, 100, {"amplifier": np.zeros(100)})
        with pytest.raises(LimitError, match="range of -2 to 2 V"):
            daq.stream(["drive"], 5000, 100, 100, {"amplifier": np.full(100, 2.1)})


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"channels": {}}, "channels must have 1 or more entries"),
        ({"channels": {"a": {"ain": 14}}}, "must be 13 or less"),
        ({"channels": {"a": {"ain": 1, "negative": 2}}}, "an even input and the next one"),
        ({"channels": {"a": {"ain": 1, "range": 5}}}, "range must be"),
        ({"outputs": {"a": {"plus": 0, "highest": 6}}}, "highest must be 5 or less"),
        ({"outputs": {"a": {"plus": 0, "minus": 1}, "b": {"plus": 1}}}, "DAC1 is used twice, by 'a' and 'b'"),
        ({"connection": "SERIAL"}, "connection must be"),
        ({"terminal": "Dev1/ai0"}, "unknown key 'terminal'"),
    ],
)
def test_a_wrong_table_is_one_sentence(table: dict[str, Any], says: str) -> None:
    with pytest.raises(ConfigurationError, match=says) as refused:
        validate(LabJackT7.Settings, {**RIG.daq.settings, **table}, "[daq] of lab.toml")
    assert "\n" not in str(refused.value)


def test_a_rig_on_it_goes_all_the_way(tmp_path: Path) -> None:
    """doctor, record, represent, calibrate, drive and check, as on NI's cards."""
    with haploop.open_rig(RIG, simulate="twin") as rig:
        red = [finding for finding in haploop.examine(rig) if finding.status == "red"]
        assert not red
        recording = haploop.record(rig, "latch", "P01", 3, tmp_path)
        press = haploop.representative([recording])
        calibration = haploop.calibrate(rig, patch="A", point="button")
        drive = haploop.drive_for(press, calibration, limits=rig.limits)
        check = haploop.check(rig, drive)
    assert "LabJack T7" in recording.header.daq
    assert check.verdict == "pass" and check.error < 0.2, (check.verdict, check.error)


def test_a_device_that_is_gone_is_one_sentence() -> None:
    daq, ljm = opened()
    with daq.stream(["drive"], 5000, 100) as stream:
        next(iter(stream))
        ljm.dies_at = 0
        with pytest.raises(InstrumentError, match=r"The T7 refused \(LJM library error code 1239"):
            next(iter(stream))


@pytest.mark.requires("table", "drive")
def test_a_drive_reaches_the_patch_on_any_rig(rig: Rig) -> None:
    t = np.arange(5000) / rig.table.rate_hz
    drive = 20 * np.sin(2 * np.pi * 200 * t) * np.hanning(len(t))
    capture = rig.excite(drive, ["A"], ["drive"])
    assert np.abs(capture.volts[0] * 100).max() == pytest.approx(20, rel=0.05)
