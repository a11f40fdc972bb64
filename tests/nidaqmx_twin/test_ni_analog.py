"""Ordinary nidaqmx programs for analog input and output, on the wire, in real time."""

import struct
import time

import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import (
    READ_ALL_AVAILABLE,
    Edge,
    LoggingMode,
    LoggingOperation,
    OverwriteMode,
    ReadRelativeTo,
    RegenerationMode,
    SampleTimingType,
    TaskMode,
    TerminalConfiguration,
    VoltageUnits,
    WaveformAttributeMode,
)
from nidaqmx.error_codes import DAQmxErrors as Error
from nidaqmx.errors import DaqReadError
from nidaqmx.stream_readers import AnalogMultiChannelReader, AnalogSingleChannelReader, AnalogUnscaledReader
from nidaqmx.stream_writers import AnalogMultiChannelWriter, AnalogUnscaledWriter
from nitypes.waveform import AnalogWaveform

from haploop.nidaqmx_twin import NiServer, inventory_of
from tests.nidaqmx_twin.ni_client import CONTINUOUS, Bench, clocked, code, connected, fails


def three_narrow(task: nidaqmx.Task) -> None:
    """Channels i that show i + 1 volts, give or take a millivolt, in a range of 10 V."""
    for i in range(3):
        channel = task.ai_channels.add_ai_voltage_chan(f"Sim/ai{i}", min_val=i + 1, max_val=i + 1.001)
        channel.ai_rng_high, channel.ai_rng_low = 10, -10


def test_undriven_input_is_a_sine_within_its_range(task):
    """NI-DAQmx help, "Reading and Writing to NI-DAQmx Simulated Devices"."""
    task.ai_channels.add_ai_voltage_chan("Sim/ai0", min_val=-2.5, max_val=2.5)
    task.timing.cfg_samp_clk_timing(10_000, samps_per_chan=1000)
    volts = np.array(task.read(1000))
    assert volts.max() <= 2.5 and volts.min() >= -2.5
    assert np.ptp(volts) > 2.5
    spectrum = np.abs(np.fft.rfft(volts))
    assert spectrum.argmax() == 10 and spectrum[10] > 20 * np.median(spectrum)


def test_each_way_to_read_gives_the_volts_or_the_codes_of_the_range(task):
    three_narrow(task)
    volts = np.array([[1], [2], [3]])
    assert task.read() == pytest.approx([1, 2, 3], abs=1e-3)
    assert np.array(task.read(4)) == pytest.approx(volts * np.ones(4), abs=1e-3)
    reader = AnalogMultiChannelReader(task.in_stream)
    one, many = np.full(3, np.inf), np.full((3, 10), np.inf)
    reader.read_one_sample(one)
    assert reader.read_many_sample(many, 10) == 10
    assert one == pytest.approx([1, 2, 3], abs=1e-3)
    assert many == pytest.approx(volts * np.ones(10), abs=1e-3)
    for kind in ("int16", "uint16", "int32", "uint32"):
        codes = np.zeros((3, 10), dtype=kind)
        assert getattr(AnalogUnscaledReader(task.in_stream), f"read_{kind}")(codes, 10) == 10
        expected = np.array([[3276], [6553], [9830]]) * np.ones(10)
        assert codes.astype(np.int64) == pytest.approx(expected, abs=3), kind
    raw = task.in_stream.read(5)
    assert raw.dtype == np.int16 and raw.shape == (15,)
    assert raw[:3] == pytest.approx([3276, 6553, 9830], abs=3)
    padded = np.full(16, -1, dtype=np.int16)
    assert task.in_stream.read_into(padded) == 5 and padded[-1] == 0
    task.in_stream.channels_to_read = task.ai_channels["Sim/ai2"]
    assert task.read() == pytest.approx(3, abs=1e-3)


def test_negative_codes_are_twos_complement_when_read_unsigned(task):
    channel = task.ai_channels.add_ai_voltage_chan("Sim/ai0", min_val=-1.001, max_val=-1)
    channel.ai_rng_high, channel.ai_rng_low = 10, -10
    codes = np.zeros((1, 4), dtype=np.uint16)
    AnalogUnscaledReader(task.in_stream).read_uint16(codes, 4)
    assert codes.view(np.int16) == pytest.approx(np.full((1, 4), -3277), abs=4)


def test_finite_over_read_is_cut_short_and_then_nothing_is_left(task):
    three_narrow(task)
    task.timing.cfg_samp_clk_timing(10_000, samps_per_chan=50)
    task.start()
    assert np.array(task.read(100)).shape == (3, 50)
    with fails(Error.SAMPLES_WILL_NEVER_BE_AVAILABLE, DaqReadError):
        task.read(1)


def test_auto_started_finite_task_frees_its_device(options):
    with nidaqmx.Task(grpc_options=options) as one, nidaqmx.Task(grpc_options=options) as two:
        for task in (one, two):
            clocked(task, "Sim/ai0", 10_000, samps_per_chan=20)
        one.read(20)
        two.start()
        assert code(one.start) == Error.PAL_RESOURCE_RESERVED
        two.stop()
        one.read(20)


def test_samples_do_not_depend_on_how_they_are_read(task):
    clocked(task, "Sim/ai0:1", 10_000, samps_per_chan=100)
    task.start()
    whole = np.array(task.read(100))
    task.in_stream.relative_to = ReadRelativeTo.FIRST_SAMPLE
    task.in_stream.offset = 30
    assert np.array_equal(np.array(task.read(20)), whole[:, 30:50])


def test_reading_what_there_is_of_a_running_acquisition(task):
    clocked(task, "Sim/ai0:1", 20_000, sample_mode=CONTINUOUS)
    task.in_stream.input_buf_size = 1_000_000  # a busy computer has 50 s for the next read
    task.start()
    total = 0
    for _ in range(20):
        # More samples come between the question how many there are and the read.
        total += task.in_stream.read_all().size // 2
        total += len(task.read(READ_ALL_AVAILABLE)[0])
    assert total == task.in_stream.curr_read_pos > 0


def test_time_out_delivers_what_there_is(task):
    clocked(task, "Sim/ai0", 1000, sample_mode=CONTINUOUS)
    task.start()
    samples = np.full((1, 5000), np.inf)
    with fails(Error.SAMPLES_NOT_YET_AVAILABLE, DaqReadError) as caught:
        AnalogMultiChannelReader(task.in_stream).read_many_sample(samples, 5000, timeout=0.1)
    assert 50 < caught.value.samps_per_chan_read < 5000
    assert np.isfinite(samples[0, : caught.value.samps_per_chan_read]).all()


@pytest.mark.parametrize("newest", [False, True])
def test_a_program_that_reads_too_late_is_told_or_gets_the_newest(task, newest):
    clocked(task, "Sim/ai0", 100_000, sample_mode=CONTINUOUS)
    task.in_stream.input_buf_size = 1000
    if newest:
        task.in_stream.overwrite = OverwriteMode.OVERWRITE_UNREAD_SAMPLES
    task.start()
    while task.in_stream.total_samp_per_chan_acquired < 3000:
        pass
    if newest:
        task.read(100)
        assert task.in_stream.curr_read_pos > 2000
    else:
        with fails(Error.SAMPLES_NO_LONGER_AVAILABLE, DaqReadError):
            task.read(100)


@pytest.mark.parametrize("mode", [LoggingMode.LOG, LoggingMode.LOG_AND_READ])
def test_what_is_acquired_is_logged_to_a_tdms_file(task, tmp_path, mode):
    path = tmp_path / "data.tdms"
    clocked(task, "Sim/ai0:1", 1000, samps_per_chan=20)
    task.in_stream.configure_logging(str(path), mode, operation=LoggingOperation.CREATE_OR_REPLACE)
    task.start()
    read = task.read(20) if mode is LoggingMode.LOG_AND_READ else None
    task.wait_until_done()
    task.stop()
    written = path.read_bytes()
    flags, version, whole, head = struct.unpack("<IIQQ", written[4:28])
    assert (written[:4], flags, version, whole) == (b"TDSm", 14, 4713, len(written) - 28)
    assert b"'Sim/ai0'" in written[: 28 + head]
    assert b"'Sim/ai1'" in written[: 28 + head]
    rows = np.frombuffer(written[28 + head :], "<f8").reshape(2, 20)
    assert np.ptp(rows) > 1
    assert read is None or np.array_equal(rows, read)


def test_a_log_replaces_no_other_file(task, tmp_path):
    other = tmp_path / "thesis.tdms"
    other.write_text("years of work")
    for path in (other, tmp_path / "data.txt", tmp_path / "none" / "data.tdms"):
        task.in_stream.configure_logging(str(path), operation=LoggingOperation.CREATE_OR_REPLACE)
        if not task.channel_names:
            clocked(task, "Sim/ai0", 1000, samps_per_chan=20)
        with pytest.raises(nidaqmx.DaqError):
            task.read(20)
        task.stop()
    assert other.read_text() == "years of work"


def test_waveform_carries_time_name_and_unit(task):
    task.ai_channels.add_ai_voltage_chan("Sim/ai0", "probe", min_val=1, max_val=1.001)
    task.timing.cfg_samp_clk_timing(1000, samps_per_chan=10)
    waveform = task.read_waveform()
    assert waveform.sample_count == 10
    assert waveform.scaled_data == pytest.approx(np.ones(10), abs=1e-3)
    assert waveform.channel_name == "probe" and waveform.units == "Volts"
    assert waveform.timing.sample_interval.total_seconds() == 1e-3
    task.in_stream.waveform_attribute_mode = WaveformAttributeMode.NONE
    bare = AnalogWaveform(10)
    AnalogSingleChannelReader(task.in_stream).read_waveform(bare)
    assert bare.channel_name == "" and not bare.timing.has_timestamp


@pytest.mark.parametrize("limit, taken", [(10, 10), (2.5, 5), (0.15, 0.2)])
def test_range_is_the_next_that_holds_the_limits(task, limit, taken):
    channel = task.ai_channels.add_ai_voltage_chan("Sim/ai0", min_val=-limit, max_val=limit)
    assert (channel.ai_min, channel.ai_max, channel.ai_rng_high) == (-taken, taken, taken)
    assert channel.ai_raw_samp_size == 16 and channel.ai_resolution == 16
    assert channel.ai_term_cfg == TerminalConfiguration.DIFF
    assert task.ai_channels.add_ai_voltage_chan("Sim/ai8").ai_term_cfg == TerminalConfiguration.RSE
    with pytest.raises(nidaqmx.DaqError):
        task.ai_channels.add_ai_voltage_chan("Sim/ai9", terminal_config=TerminalConfiguration.DIFF)
    del channel.ai_max
    assert code(lambda: channel.ai_max) == Error.AI_MAX_NOT_SPECIFIED


@pytest.mark.parametrize(
    "channel, error",
    [
        ("Sim/ai99", Error.PHYSICAL_CHAN_DOES_NOT_EXIST),
        ("Sim/ao0", Error.PHYSICAL_CHAN_DOES_NOT_EXIST),
        ("Nobody/ai0", Error.INVALID_DEVICE_ID),
        ("Sim/ai0, Sim/ai0", Error.CHAN_ALREADY_IN_TASK),
        ("Sim/ai0, Old/ai0", Error.MULTI_DEVS_IN_TASK),
    ],
)
def test_wrong_channels_are_refused(task, channel, error):
    with fails(error):
        task.ai_channels.add_ai_voltage_chan(channel)


def test_what_a_card_cannot_do_is_refused(task, other):
    task.ai_channels.add_ai_voltage_chan("Old/ai0:3", min_val=-20, max_val=20)
    task.timing.cfg_samp_clk_timing(60_000)
    assert code(lambda: task.control(TaskMode.TASK_VERIFY)) == Error.SAMP_RATE_TOO_HIGH
    task.timing.cfg_samp_clk_timing(50_000)
    assert code(lambda: task.control(TaskMode.TASK_VERIFY)) == Error.INVALID_ATTRIBUTE_VALUE
    other.ao_channels.add_ao_voltage_chan("Card/ao0", min_val=-20, max_val=20)
    assert code(lambda: other.write(0.0, auto_start=True)) == Error.INVALID_ATTRIBUTE_VALUE


def test_output_by_software_holds_after_the_task(server, options):
    with nidaqmx.Task(grpc_options=options) as task:
        task.ao_channels.add_ao_voltage_chan("Card/ao0:1", min_val=-5, max_val=5)
        task.write([1.5, -2.5])
        assert code(lambda: task.write([5.5, 0.0])) == Error.INVALID_AO_DATA_WRITE
    with nidaqmx.Task(grpc_options=options) as task:
        task.ai_channels.add_ai_voltage_chan("Card/_ao0_vs_aognd, Card/_ao1_vs_aognd")
        assert task.read() == pytest.approx([1.5, -2.5], abs=3e-3)
    nidaqmx.system.System.remote(options).devices["Card"].reset_device()
    assert server.output("Card/ao0") == 0.0


def test_output_sample_by_sample_into_input(options):
    with (
        nidaqmx.Task(grpc_options=options) as clock,
        nidaqmx.Task(grpc_options=options) as out,
        nidaqmx.Task(grpc_options=options) as into,
    ):
        clock.co_channels.add_co_pulse_chan_freq("Card/ctr0", freq=5000)
        clock.timing.cfg_implicit_timing(samps_per_chan=50)
        out.ao_channels.add_ao_voltage_chan("Card/ao0:1")
        into.ai_channels.add_ai_voltage_chan("Card/_ao0_vs_aognd, Card/_ao1_vs_aognd")
        for task, edge in ((out, Edge.RISING), (into, Edge.FALLING)):
            edges = ("/Card/Ctr0InternalOutput", edge)
            task.timing.cfg_samp_clk_timing(5000, *edges, samps_per_chan=50)
        ramp = np.array([np.linspace(-4, 4, 50), np.linspace(1, 0, 50)])
        AnalogMultiChannelWriter(out.out_stream).write_many_sample(ramp)
        out.start()
        into.start()
        clock.start()
        assert np.array(into.read(50, timeout=5)) == pytest.approx(ramp, abs=3e-3)
        out.wait_until_done(timeout=1)


def test_regenerated_output_goes_round(options):
    with nidaqmx.Task(grpc_options=options) as out, nidaqmx.Task(grpc_options=options) as into:
        clocked(out, "Card/ao0", 5000, sample_mode=CONTINUOUS)
        out.triggers.start_trigger.cfg_dig_edge_start_trig("/Card/ai/StartTrigger")
        out.write(np.arange(10.0) - 5)
        clocked(into, "Card/_ao0_vs_aognd", 5000, samps_per_chan=35)
        out.start()
        assert out.out_stream.total_samp_per_chan_generated == 0
        into.start()
        assert into.read(35, timeout=5) == pytest.approx(np.arange(35) % 10 - 5, abs=3e-3)


def test_output_without_regeneration_paces_its_writer_and_reports_a_late_one(task):
    clocked(task, "Card/ao0", 2000, sample_mode=CONTINUOUS)
    task.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
    task.out_stream.output_buf_size = 1000
    task.write(np.zeros(1000))
    task.start()
    for _ in range(11):
        task.write(np.zeros(1000), timeout=60)
    # Host buffer and the card's 8,191 samples were full, so that the rest had to wait. At this rate, a busy
    # computer has 4.6 s for the next write.
    assert task.out_stream.total_samp_per_chan_generated >= 12_000 - 1000 - 8191
    with pytest.raises(nidaqmx.DaqWriteError) as short:
        task.write(np.zeros(100_000), timeout=0.05)
    assert short.value.error_code == Error.SAMPLES_CAN_NOT_YET_BE_WRITTEN
    written = task.out_stream.curr_write_pos
    assert written == 12_000 + short.value.samps_per_chan_written
    assert 0 < short.value.samps_per_chan_written < 100_000
    while task.out_stream.total_samp_per_chan_generated <= written:
        time.sleep(0.1)
    assert code(lambda: task.write(np.zeros(10))) == Error.GEN_STOPPED_TO_PREVENT_REGEN_OF_OLD_SAMPLES
    with pytest.raises(nidaqmx.DaqError):
        task.stop()


def test_more_than_a_buffer_that_does_not_play_can_hold_is_refused(task):
    clocked(task, "Card/ao0", 1000, sample_mode=CONTINUOUS)
    task.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
    task.out_stream.output_buf_size = 100
    with fails(Error.NO_MORE_SPACE, nidaqmx.DaqWriteError) as caught:
        task.write(np.zeros(10_000))
    assert caught.value.samps_per_chan_written == 0


@pytest.mark.parametrize("kind", ["int16", "uint16", "int32", "uint32"])
def test_unscaled_writer(server, task, other, kind):
    task.ao_channels.add_ao_voltage_chan("Card/ao0:1")
    task.start()
    codes = np.array([[0, 3277], [0, 6554]], dtype=kind)
    assert getattr(AnalogUnscaledWriter(task.out_stream), f"write_{kind}")(codes) == 2
    assert [server.output("Card/ao0"), server.output("Card/ao1")] == pytest.approx([1, 2], abs=0.01)
    waveform = AnalogWaveform.from_array_1d(np.linspace(0, 1, 5))
    assert task.write_waveform([waveform, waveform]) == 5
    with pytest.raises(nidaqmx.DaqError, match="number of channels in the data does not match"):
        task.write_waveform([waveform])
    other.ao_channels.add_ao_voltage_chan("Sim/ao0:1")
    other.out_stream.auto_start = True
    assert other.out_stream.write(np.full(19, 0x1234, dtype=np.int16)) == 9, "whole samples"
    other.stop()
    other.timing.cfg_samp_clk_timing(1000, samps_per_chan=10)
    assert code(other.start) == Error.OUTPUT_BUFFER_EMPTY


def test_custom_scales(server, options):
    scaled = VoltageUnits.FROM_CUSTOM_SCALE
    nidaqmx.Scale.create_lin_scale("tenfold", 10.0, grpc_options=options)
    with nidaqmx.Task(grpc_options=options) as out:
        out.ao_channels.add_ao_voltage_chan(
            "Card/ao0", min_val=-9, max_val=9, units=scaled, custom_scale_name="double"
        )
        out.write(7.0)
    assert server.output("Card/ao0") == pytest.approx(3, abs=1e-3)
    for name, expected in (("double", 7), ("tenfold", 30), ("same", 3)):
        with nidaqmx.Task(grpc_options=options) as into:
            into.ai_channels.add_ai_voltage_chan(
                "Card/_ao0_vs_aognd", min_val=-40, max_val=40, units=scaled, custom_scale_name=name
            ).ai_rng_high = 10
            assert into.read() == pytest.approx(expected, abs=0.03)
    with nidaqmx.Task(grpc_options=options) as task, pytest.raises(nidaqmx.DaqError) as caught:
        task.ai_channels.add_ai_voltage_chan("Card/ai0", units=scaled, custom_scale_name="nobody")
    assert caught.value.error_code == Error.CUSTOM_SCALE_DOES_NOT_EXIST


def test_buffers_belong_to_their_direction(task):
    task.ai_channels.add_ai_voltage_chan("Sim/ai0")
    task.timing.samp_timing_type = SampleTimingType.SAMPLE_CLOCK
    default = task.in_stream.input_buf_size
    task.in_stream.input_buf_size = 2_000_000_000
    assert task.in_stream.input_buf_size == 2_000_000_000
    del task.in_stream.input_buf_size
    assert task.in_stream.input_buf_size == default
    with fails(Error.ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT):
        task.out_stream.output_buf_size = 2000


def test_output_without_regeneration_is_gapless():
    bench = Bench()
    with (
        NiServer(inventory_of({"A": "PCIe-6363"}), bench, {"A/ao0": "out", "A/ai0": "loop"}) as server,
        connected(server) as options,
        nidaqmx.Task(grpc_options=options) as out,
        nidaqmx.Task(grpc_options=options) as into,
    ):
        out.ao_channels.add_ao_voltage_chan("A/ao0")
        out.timing.cfg_samp_clk_timing(1000, source="/A/ai/SampleClock", sample_mode=CONTINUOUS)
        out.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
        into.ai_channels.add_ai_voltage_chan("A/ai0", min_val=-10, max_val=10)
        into.timing.cfg_samp_clk_timing(1000, sample_mode=CONTINUOUS)
        ramp = np.linspace(-5, 5, 1000)
        out.write(ramp[:200])
        out.start()
        into.start()
        heard = []
        for part in range(1, 5):
            heard += into.read(120)
            out.write(ramp[200 * part : 200 * part + 200])
        heard += into.read(400)
    assert np.abs(np.array(heard) - ramp[: len(heard)]).max() < 3e-3
