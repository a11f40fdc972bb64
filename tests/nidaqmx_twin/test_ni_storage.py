"""What the simulated NI system keeps: sensors, calibration, channels and tasks, states after power-on."""

from collections.abc import Iterator

import nidaqmx
import numpy as np
import pytest
from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx.constants import READ_ALL_AVAILABLE, PowerUpChannelType, TEDSUnits, UsageTypeAI, VoltageUnits
from nidaqmx.error_codes import DAQmxErrors as Error
from nidaqmx.stream_readers import PowerBinaryReader, PowerSingleChannelReader
from nidaqmx.system import System
from nidaqmx.system.storage import PersistedChannel, PersistedTask
from nidaqmx.types import AOPowerUpState

from haploop.nidaqmx_twin import NiTwin

EXPORT = """
[DAQmx]
MajorVersion = 21

[DAQmxDevice Dev1]
ProductType = PCIe-6363

[DAQmxDevice Out]
ProductType = PXIe-4322

[DAQmxCDAQChassis TS1]
ProductType = TS-15000

[DAQmxCDAQModule TS1Mod1]
ProductType = TS-15200
CompactDAQ.ChassisDevName = TS1
CompactDAQ.SlotNum = 1

[DAQmxChannel Pressure]
AI.MeasType = Voltage
AI.TermCfg = Differential
AI.Max = 5
AI.Min = -5
ChanType = Analog Input
PhysicalChanName = Dev1/ai3
Author = "A Person"
AllowInteractiveEditing = True

[DAQmxChannel Slow/Level]
AI.MeasType = Voltage
AI.TermCfg = RSE
AI.Max = 10
AI.Min = -10
ChanType = Analog Input
PhysicalChanName = Dev1/ai4

[DAQmxTask Slow]
Channels = Slow/Level
SampQuant.SampMode = Finite Samples
SampQuant.SampPerChan = 20
SampClk.Rate = 500
SampTimingType = Sample Clock
Author = A Person
"""
SENSOR = (17, 64, 0, 32, 4, 57, 48, 0, 120, 0, 0, 0, 200, 194, 0, 0, 200, 66)
"""Maker 17, model 1, version A1, serial number 12345; template 30, Kelvin, from -100 to 100."""


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[System]:
    export = tmp_path_factory.mktemp("max") / "max.ini"
    export.write_text(EXPORT)
    with NiTwin(export):
        yield System.local()


def _fails(code: Error, *calls: object) -> None:
    for call in calls:
        assert callable(call)
        with pytest.raises(nidaqmx.DaqError) as caught:
            call()
        assert caught.value.error_type is code
        assert str(code.value) in str(caught.value)


def test_a_sensor_describes_itself(system, tmp_path):
    file = tmp_path / "sensor.ted"
    file.write_bytes(bytes(40) + bytes(octet >> place & 1 for octet in SENSOR for place in range(8)))
    channel = system.devices["Dev1"].ai_physical_chans["ai2"]
    _fails(Error.TEDS_SENSOR_NOT_DETECTED, lambda: channel.teds_mfg_id, lambda: channel.configure_teds(""))
    channel.configure_teds(str(file))
    assert (channel.teds_mfg_id, channel.teds_model_num, channel.teds_serial_num) == (17, 1, 12345)
    assert (channel.teds_version_letter, channel.teds_version_num) == ("A", 1)
    assert channel.teds_template_ids == [30]
    assert bytes(channel.teds_bit_stream) == bytes(SENSOR)
    with nidaqmx.Task() as task:
        made = task.ai_channels.add_teds_ai_voltage_chan(
            "Dev1/ai2", min_val=-300.0, max_val=100.0, units=TEDSUnits.FROM_TEDS
        )
        assert made.ai_teds_is_teds
        assert made.ai_teds_units == "Kelvin"
        assert made.ai_voltage_units is VoltageUnits.FROM_TEDS
        assert (made.ai_min, made.ai_max) == (-300, 100)
    channel.clear_teds()
    _fails(Error.TEDS_SENSOR_NOT_DETECTED, lambda: channel.teds_bit_stream)
    _fails(Error.TEDS_SENSOR_DATA_ERROR, lambda: channel.write_to_teds_from_array([1, 2, 3]))
    file.write_bytes(b"no sensor at all")
    _fails(Error.VIRTUAL_TEDS_DATA_FILE_ERROR, lambda: channel.configure_teds(str(file)))


def test_what_max_has_saved_is_there_and_more_is_saved_and_deleted(system):
    assert system.driver_version >= (25, 8, 0), "new enough for NI's own tests"
    assert system.global_channels.global_channel_names == ["Pressure"]
    assert system.tasks.task_names == ["Slow"]
    assert PersistedChannel("Pressure").author == "A Person"
    with PersistedTask("Slow").load() as task:
        assert task.channel_names == ["Level"]
        assert (task.timing.samp_clk_rate, task.timing.samp_quant_samp_per_chan) == (500, 20)
        assert len(task.read(READ_ALL_AVAILABLE)) == 20
    with nidaqmx.Task() as task:
        task.add_global_channels([PersistedChannel("Pressure")])
        assert task.ai_channels[0].physical_channel.name == "Dev1/ai3"
        assert abs(task.read()) <= 5
    with nidaqmx.Task() as task:
        own = task.ai_channels.add_ai_voltage_chan("Dev1/ai0", "own")
        own.save(save_as="Kept", author="B")
        _fails(Error.CANT_SAVE_CHAN_WITHOUT_REPLACE, lambda: own.save("Kept", author="C"))
        own.save("Kept", author="C", overwrite_existing_channel=True)
    kept = PersistedChannel("Kept")
    assert kept.author == "C"
    kept.delete()
    _fails(Error.INVALID_GLOBAL_CHAN, lambda: kept.author)


def test_states_after_power_on_are_kept_within_the_range(system):
    names = ["Out/ao0", "Out/ao1"]
    high = PowerUpChannelType.CHANNEL_HIGH_IMPEDANCE
    read = system.get_analog_power_up_states_with_output_type(names)
    assert [(state.power_up_state, state.channel_type) for state in read] == [(0.0, high)] * 2
    kind = PowerUpChannelType.CHANNEL_VOLTAGE
    system.set_analog_power_up_states_with_output_type([AOPowerUpState(names[0], -1.0, kind)])
    read = system.get_analog_power_up_states_with_output_type(names)
    assert [(s.power_up_state, s.channel_type) for s in read] == [(-1.0, kind), (0.0, high)]
    beyond = [AOPowerUpState(names[0], 20.0, kind)]
    _fails(Error.INVALID_ATTRIBUTE_VALUE, lambda: system.set_analog_power_up_states_with_output_type(beyond))


def test_a_supply_gives_what_it_is_set_to(system):
    for enabled, volts, codes in ((True, 2.0, 8192), (False, np.nan, 0)):
        with nidaqmx.Task() as task:
            channel = task.ai_channels.add_ai_power_chan("TS1Mod1/power", 2.0, 1.0, enabled)
            assert channel.ai_meas_type is UsageTypeAI.POWER
            read = PowerSingleChannelReader(task.in_stream).read_one_sample()
            assert (read.voltage, read.current) == pytest.approx((volts, volts / 2), nan_ok=True)
            raw = [np.full((1, 4), -1, np.int16) for _ in range(2)]
            assert PowerBinaryReader(task.in_stream).read_many_sample(*raw, 4) == 4
            assert raw[0].tolist() == raw[1].tolist() == [[codes] * 4]


def test_calibration_is_told_and_a_users_words_are_kept(system):
    asked, told = system._interpreter, pb.CalibrationInfoStringAttribute
    assert asked.device_supports_cal("Dev1")
    words = told.CALIBRATIONINFO_ATTRIBUTE_CAL_USER_DEFINED_INFO
    assert asked.get_cal_info_attribute_string("Dev1", words) == ""
    asked.set_cal_info_attribute_string("Dev1", words, "mine")
    assert asked.get_cal_info_attribute_string("Dev1", words) == "mine"
    _fails(
        Error.INVALID_ATTRIBUTE_VALUE, lambda: asked.set_cal_info_attribute_string("Dev1", words, "too long")
    )
    year, month, *_ = asked.get_self_cal_last_date_and_time("Dev1")
    assert year >= 2024
    assert 1 <= month <= 12
