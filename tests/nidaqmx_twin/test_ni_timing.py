"""Timing, triggers, events, and what several tasks share, on the wire."""

import threading
from datetime import UTC, datetime
from typing import Any

import grpc
import nidaqmx
import numpy as np
import pytest
from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx._stubs.nidaqmx_pb2_grpc import NiDAQmxStub
from nidaqmx.constants import (
    Edge,
    EveryNSamplesEventType,
    Level,
    Polarity,
    SampleTimingType,
    Signal,
    Slope,
    TaskMode,
    TimestampEvent,
    TriggerType,
)
from nidaqmx.error_codes import DAQmxErrors as Error

from haploop.nidaqmx_twin import NiServer, inventory_of
from tests.nidaqmx_twin.ni_client import CONTINUOUS, FINITE, Bench, clocked, code, connected


@pytest.fixture
def ai(task: nidaqmx.Task) -> nidaqmx.Task:
    task.ai_channels.add_ai_voltage_chan("Sim/ai0")
    return task


def test_sample_clock(ai):
    timing = ai.timing
    default = timing.samp_clk_rate
    timing.cfg_samp_clk_timing(1000, samps_per_chan=100)
    assert timing.samp_timing_type == SampleTimingType.SAMPLE_CLOCK
    assert timing.samp_clk_rate == 1000 and timing.samp_clk_timebase_div == 100_000
    assert timing.samp_clk_src == "/Sim/ai/SampleClockTimebase"
    assert timing.samp_quant_samp_per_chan == 100
    timing.samp_clk_timebase_div = 200_000
    assert timing.samp_clk_rate == 500
    timing.samp_clk_rate = 7e3
    assert timing.samp_clk_rate == 100e6 / 14285  # rounded down
    timing.samp_clk_src = "PFI0"
    assert timing.samp_clk_src == "/Sim/PFI0"
    del timing.samp_clk_src
    assert timing.samp_clk_src == "/Sim/ai/SampleClockTimebase"
    del timing.samp_clk_rate
    assert timing.samp_clk_rate == default
    del timing.samp_quant_samp_mode
    assert timing.samp_quant_samp_mode == CONTINUOUS


def test_wrong_timing_is_refused(ai):
    ai.timing.cfg_samp_clk_timing(1000, source="nowhere")
    assert code(lambda: ai.timing.samp_clk_src) == Error.INVALID_ROUTING_SOURCE_TERMINAL_NAME_ROUTING
    ai.timing.cfg_samp_clk_timing(1000, samps_per_chan=1)
    assert code(lambda: ai.timing.samp_quant_samp_per_chan) == Error.INVALID_ATTRIBUTE_VALUE
    ai.timing.cfg_samp_clk_timing(1000)
    ai.start()
    assert code(lambda: ai.timing.cfg_samp_clk_timing(10)) == Error.CAN_NOT_PERFORM_OP_WHILE_TASK_RUNNING
    found = code(lambda: setattr(ai.timing, "samp_clk_rate", 10))
    assert found == Error.CANNOT_SET_PROPERTY_WHEN_TASK_RUNNING


def test_conversion_clock_has_padding_and_a_module_device_context(options, ai, other):
    with nidaqmx.Task(grpc_options=options) as old:
        clocked(old, "Old/ai0:5", 5000)
        # docs/hardware.md, "Conversion timing": 15 us on a 6034E.
        assert old.timing.ai_conv_rate == pytest.approx(1 / 15e-6)
        old.timing.ai_conv_rate = 100e3
        assert old.timing.ai_conv_rate == 100e3
    device = nidaqmx.system.Device("Sim", grpc_options=options)
    found = code(lambda: ai.timing[device].samp_clk_rate)
    assert found == Error.M_STUDIO_OPERATION_DOES_NOT_SUPPORT_DEVICE_CONTEXT
    other.ai_channels.add_ai_voltage_chan("FrameMod2/ai0")
    timing = other.timing[nidaqmx.system.Device("FrameMod2", grpc_options=options)]
    assert timing.ai_conv_max_rate == 250e3 and timing.ai_conv_timebase_div == 1121
    assert timing.ai_conv_active_edge == Edge.RISING
    timing.ai_conv_active_edge = Edge.FALLING
    assert timing.ai_conv_active_edge == Edge.FALLING
    del timing.ai_conv_active_edge
    assert timing.ai_conv_active_edge == Edge.RISING


def test_other_timing_types(task):
    task.di_channels.add_di_chan("Sim/port0/line0")
    timing = task.timing
    timing.cfg_handshaking_timing(FINITE, 2000)
    assert timing.samp_timing_type == SampleTimingType.HANDSHAKE
    timing.cfg_change_detection_timing("port0/line0:1", "port0/line3:5", samps_per_chan=2000)
    assert timing.change_detect_di_rising_edge_physical_chans.name == "port0/line0, port0/line1"
    timing.cfg_pipelined_samp_clk_timing(32e3, "/Sim/PFI1", Edge.FALLING, samps_per_chan=2000)
    assert timing.samp_clk_src == "/Sim/PFI1" and timing.samp_clk_active_edge == Edge.FALLING
    timing.cfg_burst_handshaking_timing_export_clock(
        32e3, "/Sim/PFI0", samps_per_chan=2000, sample_clk_pulse_polarity=Polarity.ACTIVE_LOW,
        pause_when=Level.LOW, ready_event_active_level=Polarity.ACTIVE_LOW,
    )  # fmt: skip
    assert timing.samp_timing_type == SampleTimingType.BURST_HANDSHAKE and timing.samp_clk_rate == 32e3
    assert task.triggers.pause_trigger.dig_lvl_when == Level.LOW
    assert task.export_signals.samp_clk_pulse_polarity == Polarity.ACTIVE_LOW
    assert task.export_signals.rdy_for_xfer_event_lvl_active_lvl == Polarity.ACTIVE_LOW


def test_triggers_are_remembered(ai):
    start, reference = ai.triggers.start_trigger, ai.triggers.reference_trigger
    assert start.trig_type == TriggerType.NONE and reference.pretrig_samples == 2
    ai.timing.cfg_samp_clk_timing(1000)
    start.cfg_anlg_edge_start_trig("APFI0", Slope.FALLING, 3.0)
    assert (start.anlg_edge_src, start.anlg_edge_slope, start.anlg_edge_lvl) == (
        "/Sim/APFI0", Slope.FALLING, 3.0
    )  # fmt: skip
    reference.cfg_anlg_edge_ref_trig("APFI1", 10, Slope.RISING, 2.0)
    assert reference.anlg_edge_src == "/Sim/APFI1" and reference.pretrig_samples == 10
    start.cfg_dig_edge_start_trig("PFI3", Edge.FALLING)
    assert start.dig_edge_src == "/Sim/PFI3" and start.dig_edge_edge == Edge.FALLING
    start.dig_edge_dig_fltr_timebase_rate = 2.5
    assert start.dig_edge_dig_fltr_timebase_rate == 2.5
    del start.dig_edge_dig_fltr_timebase_rate
    assert start.dig_edge_dig_fltr_timebase_rate == 0.0
    start.disable_start_trig()
    assert start.trig_type == TriggerType.NONE
    ai.timing.samp_timing_type = SampleTimingType.ON_DEMAND
    start.trig_type = TriggerType.ANALOG_EDGE
    assert code(lambda: ai.control(TaskMode.TASK_VERIFY)) == Error.TRIG_WHEN_ON_DEMAND_SAMP_TIMING


def test_time_stamps(task):
    clocked(task, "FrameMod1/ai0", 1000)
    assert task.triggers.start_trigger.time_when.year == 1904
    task.start()
    stamp = task.wait_for_valid_timestamp(TimestampEvent.FIRST_SAMPLE)
    assert abs((datetime.now(UTC) - stamp).total_seconds()) < 2
    found = code(lambda: task.wait_for_valid_timestamp(TimestampEvent.START_TRIGGER))
    assert found == Error.TIMESTAMP_NOT_ENABLED


class Heard:
    """What an event's callback was told, and a way to wait for it."""

    def __init__(self) -> None:
        self.events: list[tuple[Any, ...]] = []
        self._semaphore = threading.Semaphore(0)

    def __call__(self, _task: object, *event: Any) -> int:
        self.events.append(event[:-1])
        self._semaphore.release()
        return 0

    def wait(self, count: int) -> None:
        for _ in range(count):
            assert self._semaphore.acquire(timeout=5)

    def nothing_more(self) -> bool:
        return not self._semaphore.acquire(timeout=0.1)


def test_events_of_several_acquisitions(ai, other):
    done, samples, unheard, sent = Heard(), Heard(), Heard(), Heard()
    for _ in range(3):  # registered, and not any more
        ai.register_done_event(unheard)
        ai.register_done_event(None)
        ai.register_every_n_samples_acquired_into_buffer_event(100, unheard)
        ai.register_every_n_samples_acquired_into_buffer_event(100, None)
        ai.register_signal_event(Signal.SAMPLE_COMPLETE, unheard)
        ai.register_signal_event(Signal.SAMPLE_COMPLETE, None)
    ai.register_done_event(done)
    ai.register_every_n_samples_acquired_into_buffer_event(100, samples)
    ai.timing.cfg_samp_clk_timing(10_000, samps_per_chan=1000)
    for _ in range(3):
        ai.start()
        done.wait(1)
        samples.wait(10)
        ai.stop()
    clocked(other, "Sim/ao0", 10_000, sample_mode=CONTINUOUS)
    other.register_every_n_samples_transferred_from_buffer_event(500, sent)
    other.write(np.zeros(1000))
    other.start()
    sent.wait(4)
    assert done.nothing_more() and samples.nothing_more() and unheard.nothing_more()
    assert done.events == [(0,)] * 3
    assert samples.events == [(EveryNSamplesEventType.ACQUIRED_INTO_BUFFER.value, 100)] * 30


def test_events_are_registered_once_and_of_the_right_kind(ai, other):
    heard, signals = Heard(), Heard()
    ai.register_done_event(heard)
    assert code(lambda: ai.register_done_event(heard)) == Error.DONE_EVENT_ALREADY_REGISTERED
    assert (
        code(lambda: ai.register_every_n_samples_transferred_from_buffer_event(10, heard))
        == Error.EVERY_N_SAMPS_TRANSFERRED_FROM_BUFFER_EVENT_NOT_SUPPORTED_BY_DEVICE
    )
    other.ao_channels.add_ao_voltage_chan("Sim/ao0")
    assert (
        code(lambda: other.register_every_n_samples_acquired_into_buffer_event(10, heard))
        == Error.EVERY_N_SAMPLES_ACQ_INTO_BUFFER_EVENT_NOT_SUPPORTED_BY_DEVICE
    )
    ai.register_signal_event(Signal.SAMPLE_COMPLETE, signals)
    ai.timing.cfg_samp_clk_timing(100, samps_per_chan=10)
    ai.start()
    signals.wait(10)
    assert signals.nothing_more()
    assert signals.events == [(Signal.SAMPLE_COMPLETE.value,)] * 10


def test_slave_waits_for_its_masters_clock():
    cards = inventory_of({"A": "PCIe-6321", "B": "PCI-6034E"})
    for rtsi, source, error in (
        (False, "/A/ai/SampleClock", Error.TRIG_LINE_NOT_FOUND_ROUTING),  # no cable
        (True, "/Elsewhere/PFI0", Error.INVALID_ROUTING_SOURCE_TERMINAL_NAME_ROUTING),
    ):
        with (
            NiServer(cards, rtsi=rtsi) as server,
            connected(server) as options,
            nidaqmx.Task(grpc_options=options) as slave,
        ):
            clocked(slave, "B/ai0", 1000, source=source)
            assert slave.timing.samp_clk_src == source
            assert code(slave.start) == error
    with (
        NiServer(cards, rtsi=True) as server,
        connected(server) as options,
        nidaqmx.Task(grpc_options=options) as master,
        nidaqmx.Task(grpc_options=options) as slave,
    ):
        master.ai_channels.add_ai_voltage_chan("A/ai0")
        slave.ai_channels.add_ai_voltage_chan("B/ai0")
        master.timing.cfg_samp_clk_timing(1000, samps_per_chan=100)
        slave.timing.cfg_samp_clk_timing(1000, source="/A/ai/SampleClock", sample_mode=CONTINUOUS)
        slave.start()
        assert code(lambda: slave.read(1, timeout=0.05)) == Error.SAMPLES_NOT_YET_AVAILABLE
        master.start()
        assert len(slave.read(100, timeout=2)) == 100
        # The master's clock has stopped after its 100 samples.
        assert slave.is_task_done()
        assert slave.in_stream.total_samp_per_chan_acquired == 100


def test_slave_that_comes_late_joins_at_the_next_edge():
    bench = Bench()
    wiring = {"A/ai0": "tone", "B/ai0": "tone"}
    with (
        NiServer(inventory_of({"A": "PCIe-6321", "B": "PCI-6034E"}), bench, wiring, rtsi=True) as server,
        connected(server) as options,
        nidaqmx.Task(grpc_options=options) as master,
        nidaqmx.Task(grpc_options=options) as slave,
    ):
        master.ai_channels.add_ai_voltage_chan("A/ai0")
        slave.ai_channels.add_ai_voltage_chan("B/ai0")
        master.timing.cfg_samp_clk_timing(1000, sample_mode=CONTINUOUS)
        slave.timing.cfg_samp_clk_timing(1000, source="/A/ai/SampleClock", samps_per_chan=40)
        master.start()
        first = master.read(25)
        slave.start()
        both = np.array([slave.read(40), master.read(40)])
    assert len(first) == 25
    # 3 V at 10 Hz changes by 0.19 V from sample to sample: one sample apart would show.
    assert np.abs(both[0] - both[1]).max() < 3e-3


def test_what_is_not_served_fails_loudly_and_is_counted():
    with (
        NiServer(inventory_of({"A": "PCIe-6321"})) as server,
        connected(server) as options,
        nidaqmx.Task(grpc_options=options) as task,
    ):
        stub = NiDAQmxStub(options.grpc_channel)
        with pytest.raises(grpc.RpcError) as caught:
            stub.WaitForNextSampleClock(pb.WaitForNextSampleClockRequest())
        assert caught.value.code() == grpc.StatusCode.UNIMPLEMENTED
        task.ai_channels.add_ai_voltage_chan("A/ai0")
        assert code(lambda: task.timing.samp_clk_overrun_behavior) == Error.ATTR_NOT_SUPPORTED
        assert server.unserved == {"WaitForNextSampleClock": 1, "Timing SAMP_CLK_OVERRUN_BEHAVIOR": 1}


def test_counter_outputs_have_no_reference_trigger_and_inputs_that_nothing_drives_count_nothing():
    with (
        NiServer(inventory_of({"A": "PCIe-6321"})) as server,
        connected(server) as options,
        nidaqmx.Task(grpc_options=options) as pulses,
        nidaqmx.Task(grpc_options=options) as edges,
    ):
        pulses.co_channels.add_co_pulse_chan_freq("A/ctr0")

        def set_reference():
            pulses.triggers.reference_trigger.trig_type = TriggerType.NONE

        assert code(set_reference) == Error.ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT
        edges.ci_channels.add_ci_count_edges_chan("A/ctr1").ci_count_edges_term = "/A/PFI3"
        edges.start()
        assert edges.read() == 0
