"""Devices, exports of NI MAX, and the wire as a program of its own."""

import signal
import subprocess
import sys

import grpc
import nidaqmx
import pytest
from nidaqmx.constants import (
    BusType,
    ProductCategory,
    SampleTimingType,
    TaskMode,
    TerminalConfiguration,
    UsageTypeAI,
)
from nidaqmx.error_codes import DAQmxErrors as Error
from nidaqmx.system import Device, PhysicalChannel, System

from haploop.nidaqmx_twin import devices_from_ini
from tests.nidaqmx_twin.ni_client import EXPORT, code, fails


def test_the_devices_of_an_export_report_themselves(options):
    inventory, system = devices_from_ini(EXPORT), System.remote(options)
    assert list(inventory.devices) == ["Sim", "Card", "Old", "Frame", "FrameMod1", "FrameMod2"]
    assert [sentence.split()[0] for sentence in inventory.left_out] == ["Bridge", "StrayMod1"]
    devices = system.devices
    assert devices.device_names == list(inventory.devices)
    assert [d.name for d in devices["Frame"].chassis_module_devices] == ["FrameMod1", "FrameMod2"]
    device = devices["Card"]
    assert (device.product_type, device.product_category) == ("PCIe-6363", ProductCategory.X_SERIES_DAQ)
    assert (device.serial_num, device.is_simulated, device.bus_type) == (0x1A2B, False, BusType.PCIE)
    assert len(device.ai_physical_chans) == 32 and len(device.ao_physical_chans) == 4
    assert len(device.di_lines) == len(device.do_lines) == 48
    assert device.di_ports.channel_names == ["Card/port0", "Card/port1", "Card/port2"]
    assert len(device.ci_physical_chans) == 4
    assert device.ai_max_single_chan_rate == 2e6 and device.ai_max_multi_chan_rate == 1e6
    assert device.ai_voltage_rngs[-2:] == [-10, 10]
    assert UsageTypeAI.VOLTAGE in device.ai_meas_types
    assert not device.ai_simultaneous_sampling_supported
    device.self_test_device()
    assert Device("Sim", grpc_options=options).product_num == 0x7435C4C4
    module, old = devices["FrameMod1"], devices["Old"]
    assert module.product_category == ProductCategory.C_SERIES_MODULE
    assert module.compact_daq_chassis_device.name == "Frame" and module.compact_daq_slot_num == 1
    assert module.ai_simultaneous_sampling_supported
    assert module.ai_physical_chans["ai0"].ai_term_cfgs == [TerminalConfiguration.DIFF]
    assert old.product_category == ProductCategory.E_SERIES_DAQ
    assert old.ao_physical_chans.channel_names == []
    configurations = [TerminalConfiguration.RSE, TerminalConfiguration.NRSE, TerminalConfiguration.DIFF]
    assert PhysicalChannel("Sim/ai0", grpc_options=options).ai_term_cfgs == configurations
    assert PhysicalChannel("Sim/ai8", grpc_options=options).ai_term_cfgs == configurations[:2]
    assert PhysicalChannel("Sim/port0", grpc_options=options).di_port_width == 32
    with fails(Error.PHYSICAL_CHAN_DOES_NOT_EXIST):
        _ = PhysicalChannel("Sim/ai1234", grpc_options=options).ai_meas_types
    assert code(lambda: Device("Nobody", grpc_options=options).product_type) == Error.INVALID_DEVICE_ID


def test_tasks_are_shared_by_name_and_cleared(options):
    with nidaqmx.Task("shared", grpc_options=options) as task:
        task.ai_channels.add_ai_voltage_chan("Sim/ai0")
        again = nidaqmx.Task("shared", grpc_options=options)
        assert again.channel_names == ["Sim/ai0"]
    assert code(again.start) == Error.INVALID_TASK


def test_program_of_its_own(tmp_path):
    export = tmp_path / "max.ini"
    export.write_text(EXPORT)
    program = (
        "import sys, pathlib, haploop.nidaqmx_twin as ni; "
        "ni.run(ni.inventory_from_file(pathlib.Path(sys.argv[1])))"
    )
    command = [sys.executable, "-c", program, str(export)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            line = process.stdout.readline()
            prefix, _, port = line.rpartition(" ")
            assert prefix == "Server listening on port"
            with grpc.insecure_channel(f"localhost:{int(port)}") as channel:
                system = System.remote(nidaqmx.GrpcSessionOptions(channel, ""))
                assert "Sim" in system.devices
        finally:
            process.send_signal(signal.SIGTERM)
            _, said = process.communicate(timeout=10)
    assert process.returncode == 0 or sys.platform == "win32"
    assert "Bridge (PXIe-9999) is not known" in said


def test_a_committed_task_keeps_its_outputs_when_it_stops_and_changes(options):
    """NI-DAQmx Key Concepts, "Transitioning the State Backwards": it is verified again when it starts."""
    with (
        nidaqmx.Task("first", grpc_options=options) as task,
        nidaqmx.Task("second", grpc_options=options) as other,
    ):
        for one in (task, other):
            one.ao_channels.add_ao_voltage_chan("Card/ao0")

        def taken():
            try:
                other.write(1.0, auto_start=True)
            except nidaqmx.DaqError as error:
                assert error.error_type is Error.PAL_RESOURCE_RESERVED
                return False
            return True

        task.write(0.0, auto_start=True)
        assert taken(), "a start that reserved is undone by the stop"
        task.control(TaskMode.TASK_COMMIT)
        assert not taken()
        task.start()
        task.write(0.0)
        task.stop()
        task.timing.cfg_samp_clk_timing(1000, samps_per_chan=10)
        assert not taken()
        task.write([0.0] * 10, auto_start=False)
        task.start()
        task.stop()
        task.timing.samp_timing_type = SampleTimingType.ON_DEMAND
        assert not taken()
        task.timing.cfg_samp_clk_timing(1e9, samps_per_chan=10)
        with pytest.raises(nidaqmx.DaqError):
            task.control(TaskMode.TASK_COMMIT)
        task.control(TaskMode.TASK_UNRESERVE)
        assert taken()
