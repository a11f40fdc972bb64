"""Every kind of channel that nidaqmx can make exists, and has the properties that its call gives."""

import inspect
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import nidaqmx
import pytest
from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx._stubs.nidaqmx_pb2_grpc import NiDAQmxStub
from nidaqmx.constants import (
    AccelSensitivityUnits,
    CurrentShuntResistorLocation,
    EncoderType,
    ExcitationSource,
    PowerIdleOutputBehavior,
    PowerOutputState,
    RTDType,
    StrainGageRosetteMeasurementType,
    StrainGageRosetteType,
    SyncType,
    TemperatureUnits,
    TerminalConfiguration,
    UsageTypeAI,
    WaitMode,
)
from nidaqmx.error_codes import DAQmxErrors as Error
from nidaqmx.task.collections import AIChannelCollection, CIChannelCollection, COChannelCollection

from haploop.nidaqmx_twin import NiServer, NiTwin, inventory_of
from haploop.nidaqmx_twin.counters import COUNTERS
from haploop.nidaqmx_twin.measurements import FIELDS, MEASUREMENTS
from tests.nidaqmx_twin.ni_client import connected

DEVICES = {
    "X": "PCIe-6363", "Bridge": "PXIe-4331", "Dsa": "PXIe-4466", "Charge": "PXIe-4480",
    "Position": "PXIe-4340", "Meter": "NI myDAQ", "Supply": "TS-15200", "Velocity": "NI 9361",
    "Watts": "PXIe-4311",
}  # fmt: skip
_ON = {
    "charge": "Charge/ai0", "bridge": "Bridge/ai0", "strain_gage": "Bridge/ai0", "accel": "Dsa/ai0",
    "iepe": "Dsa/ai0", "microphone": "Dsa/ai0", "eddy": "Dsa/ai0", "lvdt": "Position/ai0",
    "rvdt": "Position/ai0", "_rms": "Meter/dmm", "calculated": "Watts/ai0", "power": "Supply/power",
    "rosette": "Bridge/ai0:1", "velocity_chan": "Velocity/ctr0",
    "temp_built_in": "X/_boardTempSensor_vs_aignd",
}  # fmt: skip
_GIVEN: dict[str, dict[str, Any]] = {
    "add_ai_rosette_strain_gage_chan": {
        "rosette_type": StrainGageRosetteType.TEE,
        "gage_orientation": 0.0,
        "rosette_meas_types": [StrainGageRosetteMeasurementType.PRINCIPAL_STRAIN_1],
    },
    "add_ai_calculated_power_chan": {"current_physical_channel": "Watts/ai1"},
    "add_ai_power_chan": {"voltage_setpoint": 2.0, "current_setpoint": 1.0, "output_enable": True},
    "add_ai_voltage_chan_with_excit": {
        "voltage_excit_source": ExcitationSource.EXTERNAL, "voltage_excit_val": 5.0
    },
}  # fmt: skip


@pytest.fixture(scope="module")
def options() -> Iterator[nidaqmx.GrpcSessionOptions]:
    with NiServer(inventory_of(DEVICES)) as server, connected(server) as options:
        yield options


def _calls(collection: type, mark: str) -> list[str]:
    return [name for name in dir(collection) if name.startswith(mark)]


def _where(name: str) -> str:
    return next((place for mark, place in _ON.items() if mark in name), "X/ai0")


@pytest.mark.parametrize("name", _calls(AIChannelCollection, "add_ai_"))
def test_each_kind_of_analog_input_has_what_its_call_gives(options, name):
    with nidaqmx.Task(grpc_options=options) as task:
        add = getattr(task.ai_channels, name)
        given = {"min_val": 0.0, "max_val": 1.0} if "rms" in name else {}
        channel = add(_where(name), **_GIVEN.get(name, {}), **given)
        if "rosette" in name:
            channel = task.ai_channels["rosette0_principalStrain1"]
        key = name.removeprefix("add_ai_").removesuffix("_chan").replace("_", "").replace("chan", "")
        row = next(row for known, row in MEASUREMENTS.items() if known.lower() == key)
        assert channel.ai_meas_type == UsageTypeAI(row.usage)
        for parameter in inspect.signature(add).parameters.values():
            told = FIELDS.get(parameter.name)
            if (
                told is None
                or parameter.default in (inspect.Parameter.empty, None, "")
                or "rosette" in told.lower()
            ):
                continue
            shown = getattr(channel, told.lower(), None)
            if shown is not None and parameter.default is not CurrentShuntResistorLocation.LET_DRIVER_CHOOSE:
                assert shown == _GIVEN.get(name, {}).get(parameter.name, parameter.default), parameter.name


@pytest.mark.parametrize(
    "name", _calls(CIChannelCollection, "add_ci_") + _calls(COChannelCollection, "add_co_")
)
def test_each_kind_of_counter_channel_can_be_made(options, name):
    with nidaqmx.Task(grpc_options=options) as task:
        add = getattr(task.ci_channels if "_ci_" in name else task.co_channels, name)
        source = {"source_terminal": "PFI0"} if "ticks" in name else {}
        channel = add(_where(name).replace("ai0", "ctr0"), **source)
        shown = channel.ci_meas_type if "_ci_" in name else channel.co_output_type
        assert shown in {row.usage for row in COUNTERS.values()}
        if source:
            assert "PFI0" in (channel.ci_ctr_timebase_src if "_ci_" in name else channel.co_ctr_timebase_src)


def test_every_property_that_a_call_gives_is_one_of_nis():
    known = {
        value.name.partition("ATTRIBUTE_")[2]
        for name, enum in pb.DESCRIPTOR.enum_types_by_name.items()
        if name.startswith("Channel") and name.endswith("Attribute")
        for value in enum.values
    }
    told = {row.units for row in MEASUREMENTS.values()} | set(FIELDS.values())
    told |= {f"{row.sensor}_SENSITIVITY" for row in MEASUREMENTS.values() if row.sensor}
    told |= {name for row in COUNTERS.values() for name in row.properties.values()}
    assert told <= known


def test_a_sensor_on_a_wired_input_is_scaled_to_its_own_units():
    with NiTwin({"Dsa": "PXIe-4466", "Bridge": "PXIe-4331"}) as twin:
        twin.set("Dsa/ai0", 0.2)
        twin.set("Bridge/ai0", 2.5e-3)
        with nidaqmx.Task() as task:
            task.ai_channels.add_ai_accel_chan(
                "Dsa/ai0", sensitivity=100.0, sensitivity_units=AccelSensitivityUnits.MILLIVOLTS_PER_G
            )
            task.timing.cfg_samp_clk_timing(1000, samps_per_chan=2)
            assert task.read() == pytest.approx(2.0, abs=0.01)
        with nidaqmx.Task() as task:
            task.ai_channels.add_ai_force_bridge_two_point_lin_chan(
                "Bridge/ai0", min_val=-100, max_val=100, voltage_excit_val=2.5,
                first_electrical_val=0, second_electrical_val=2,
                first_physical_val=0, second_physical_val=100,
            )  # fmt: skip
            assert task.read() == pytest.approx(50.0, abs=5)


def test_a_product_refuses_a_terminal_configuration_and_a_supply_that_it_has_not():
    with NiTwin({"Low": "USB-6009", "Dsa": "USB-4431", "X": "PCIe-6321"}):
        with nidaqmx.Task() as task:
            made = task.ai_channels.add_ai_voltage_chan("Dsa/ai0")
            assert made.ai_term_cfg is TerminalConfiguration.PSEUDO_DIFF
        for terminal, config in (("Dsa/ai0", TerminalConfiguration.RSE),
            ("Low/ai0", TerminalConfiguration.NRSE), ("Low/ai4", TerminalConfiguration.DIFF)):  # fmt: skip
            with nidaqmx.Task() as task, pytest.raises(nidaqmx.DaqError) as caught:
                task.ai_channels.add_ai_voltage_chan(terminal, terminal_config=config)
            assert caught.value.error_type is Error.INVALID_ATTRIBUTE_VALUE
        with nidaqmx.Task() as task, pytest.raises(nidaqmx.DaqError, match="does not supply"):
            task.ai_channels.add_ai_accel_chan("X/ai0", current_excit_source=ExcitationSource.INTERNAL)


def test_encoder_counts_by_its_decoding():
    """A quarter of a period between A and B: one pulse is 1, 2 or 4 counts, and the place is the same."""
    with NiTwin({"Dev1": "PCIe-6363"}) as twin:
        twin.set("Dev1/PFI8", lambda times: ((times * 1000) % 1 < 0.5).astype(float))
        twin.set("Dev1/PFI10", lambda times: (((times - 0.00025) * 1000) % 1 < 0.5).astype(float))
        for decoding in (EncoderType.X_1, EncoderType.X_2, EncoderType.X_4):
            with nidaqmx.Task() as task:
                task.ci_channels.add_ci_lin_encoder_chan(
                    "Dev1/ctr0", decoding_type=decoding, dist_per_pulse=1e-3
                )
                task.start()
                began = twin.now
                twin.sleep(0.1)
                assert task.read() == pytest.approx((twin.now - began), abs=2e-3)


@pytest.mark.parametrize(
    ("units", "shown"),
    [(TemperatureUnits.DEG_C, 100.0), (TemperatureUnits.K, 373.15), (TemperatureUnits.DEG_F, 212.0)],
)
def test_a_resistance_thermometer_shows_its_temperature(units, shown):
    """100 Ohm of platinum (alpha 3851) have 138.51 Ohm at 100 degrees: the table of IEC 60751."""
    with NiTwin({"X": "PCIe-6363"}) as twin, nidaqmx.Task() as task:
        twin.set("X/ai0", 138.51 * 1e-3)
        task.ai_channels.add_ai_rtd_chan(
            "X/ai0", min_val=0.0, max_val=400.0, units=units, rtd_type=RTDType.PT_3851, current_excit_val=1e-3
        )
        assert task.read() == pytest.approx(shown, abs=0.5)


def test_ohms_follow_from_the_current_and_a_range_is_told_in_degrees():
    with NiTwin({"X": "PCIe-6363"}) as twin:
        twin.set("X/ai0", 0.35)
        with nidaqmx.Task() as task:
            task.ai_channels.add_ai_resistance_chan("X/ai0", max_val=1000.0, current_excit_val=1e-3)
            assert task.read() == pytest.approx(350.0, abs=1.0)
        with nidaqmx.Task() as task:
            kelvin = task.ai_channels.add_ai_rtd_chan(
                "X/ai0", min_val=28.0, max_val=130.0, units=TemperatureUnits.K, rtd_type=RTDType.PT_3750,
                current_excit_val=0.0025,
            )  # fmt: skip
            # What +-0.2 V are to 100 Ohm at 2.5 mA.
            assert (kelvin.ai_min, kelvin.ai_max) == (28.0, pytest.approx(221.0, abs=1.0))


def test_calculated_power_is_that_of_volts_and_of_a_shunt():
    with NiTwin({"Watts": "PXIe-4311"}) as twin:
        twin.set("Watts/ai0", 5.0)
        twin.set("Watts/ai1", 2.49)
        with nidaqmx.Task() as task:
            made = task.ai_channels.add_ai_calculated_power_chan(
                "Watts/ai0", "Watts/ai1", voltage_min_val=0.0, voltage_max_val=5.0, current_min_val=0.0,
                current_max_val=0.02, ext_shunt_resistor_val=249.0,
            )  # fmt: skip
            assert made.ai_meas_type == UsageTypeAI.CALCULATED_POWER
            assert (made.ai_max, made.ai_calculated_power_current_max) == (pytest.approx(0.1), 0.02)
            task.timing.cfg_samp_clk_timing(1000, samps_per_chan=20)
            assert task.read(20) == pytest.approx([0.05] * 20, abs=1e-5)
        with nidaqmx.Task() as task, pytest.raises(nidaqmx.DaqError, match="not one analog input of Watts"):
            task.ai_channels.add_ai_calculated_power_chan("Watts/ai0", "Watts/ai1:2")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize(
    ("collection", "call", "physical"),
    [
        ("ai_channels", "add_ai_voltage_chan", "X/ai0"),
        ("ai_channels", "add_ai_power_chan", "Supply/power"),
        ("ai_channels", "add_ai_bridge_chan", "Bridge/ai0"),
        ("ao_channels", "add_ao_voltage_chan", "X/ao0"),
        ("di_channels", "add_di_chan", "X/port0"),
        ("ci_channels", "add_ci_count_edges_chan", "X/ctr0"),
        ("co_channels", "add_co_pulse_chan_freq", "X/ctr0"),
    ],
)
def test_a_property_that_nobody_set_has_one_of_its_values_or_is_refused(options, collection, call, physical):
    """Never a value that the property cannot have, from which the client makes a ValueError."""
    with nidaqmx.Task(grpc_options=options) as task:
        made = getattr(getattr(task, collection), call)(physical, **_GIVEN.get(call, {}))
        trigger = task.triggers
        owners = (
            made, task.timing, task.export_signals, trigger, trigger.start_trigger, trigger.pause_trigger,
            trigger.reference_trigger, trigger.arm_start_trigger, trigger.handshake_trigger,
            made.physical_channel,
        )  # fmt: skip
        for owner in owners:
            for name, kind in inspect.getmembers(type(owner), lambda kind: isinstance(kind, property)):
                assert kind.fget is not None
                with suppress(nidaqmx.DaqError):
                    try:
                        kind.fget(owner)
                    except (ValueError, nidaqmx.errors.RpcError) as error:
                        pytest.fail(f"{name}: {error}")


def test_properties_of_a_task_at_its_start(options):
    with nidaqmx.Task(grpc_options=options) as task:
        power = task.ai_channels.add_ai_power_chan("Supply/power", 1.0, 1.0, True)
        assert power.pwr_idle_output_behavior == PowerIdleOutputBehavior.MAINTAIN_EXISTING_VALUE
        assert power.pwr_output_state == PowerOutputState.CONSTANT_VOLTAGE
        assert task.triggers.sync_type == SyncType.NONE
    with nidaqmx.Task(grpc_options=options) as task:
        width = task.ci_channels.add_ci_pulse_width_chan("X/ctr0")
        assert width.ci_ctr_timebase_dig_fltr_timebase_src == "100MHzTimebase"


def test_hardware_timed_single_point_has_its_properties():
    """By the calls themselves: nidaqmx 1.7 has no class for them yet."""
    with NiServer(inventory_of({"Watts": "PXIe-4311"})) as server, connected(server) as options:
        stub = NiDAQmxStub(options.grpc_channel)
        task = stub.CreateTask(pb.CreateTaskRequest(session_name="one")).task
        mode = pb.REALTIME_ATTRIBUTE_WAIT_FOR_NEXT_SAMP_CLK_WAIT_MODE
        asked = pb.GetRealTimeAttributeInt32Request(task=task, attribute=mode)
        assert stub.GetRealTimeAttributeInt32(asked).value_raw == WaitMode.WAIT_FOR_INTERRUPT.value
        stub.SetRealTimeAttributeInt32(
            pb.SetRealTimeAttributeInt32Request(task=task, attribute=mode, value_raw=WaitMode.SLEEP.value)
        )
        assert stub.GetRealTimeAttributeInt32(asked).value_raw == WaitMode.SLEEP.value
