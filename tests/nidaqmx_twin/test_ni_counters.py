"""Counters on the wire: pulses put out, and what other counters measure of them."""

from collections.abc import Iterator

import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import CountDirection, CounterFrequencyMethod, Edge, FrequencyUnits, Level, TimeUnits
from nidaqmx.error_codes import DAQmxErrors as Error
from nidaqmx.stream_writers import CounterWriter
from nidaqmx.types import CtrFreq, CtrTick, CtrTime

from haploop.nidaqmx_twin import NiTwin
from haploop.nidaqmx_twin.pulses import PulseTrain
from tests.nidaqmx_twin.ni_client import CONTINUOUS, clocked

OUT = "/Dev1/Ctr0InternalOutput"


@pytest.fixture
def twin() -> Iterator[NiTwin]:
    with NiTwin({"Dev1": "PCIe-6363"}) as twin:
        yield twin


@pytest.fixture
def task(twin: NiTwin) -> Iterator[nidaqmx.Task]:
    with nidaqmx.Task() as task:
        yield task


@pytest.fixture
def pulses(twin: NiTwin) -> Iterator[nidaqmx.Task]:
    """Pulses of 1 kHz, a quarter of the time high, on counter 0."""
    with nidaqmx.Task() as task:
        task.co_channels.add_co_pulse_chan_freq("Dev1/ctr0", freq=1000.0, duty_cycle=0.25)
        task.timing.cfg_implicit_timing(sample_mode=CONTINUOUS)
        yield task


@pytest.fixture
def meter(twin: NiTwin) -> Iterator[nidaqmx.Task]:
    with nidaqmx.Task() as task:
        yield task


@pytest.mark.parametrize(("way", "counted"), [(CountDirection.COUNT_UP, 25), (CountDirection.COUNT_DOWN, 15)])
def test_edges_of_a_finite_train_are_counted_each_once(meter, way, counted):
    with nidaqmx.Task() as train:
        train.co_channels.add_co_pulse_chan_time("Dev1/ctr0", low_time=0.002, high_time=0.001)
        train.timing.cfg_implicit_timing(samps_per_chan=5)
        channel = meter.ci_channels.add_ci_count_edges_chan(
            "Dev1/ctr1", initial_count=20, count_direction=way
        )
        channel.ci_count_edges_term = OUT
        meter.start()
        train.start()
        train.wait_until_done()
        assert meter.read() == channel.ci_count == counted


@pytest.mark.parametrize("method", list(CounterFrequencyMethod)[:3])
def test_a_frequency_is_measured_by_each_method(pulses, meter, method):
    channel = meter.ci_channels.add_ci_freq_chan(
        "Dev1/ctr1", min_val=100, max_val=10000, meas_method=method, meas_time=0.01
    )
    channel.ci_freq_term = OUT
    meter.start()
    pulses.start()
    assert meter.read() == pytest.approx(1000, rel=0.1)


def test_periods_widths_and_halves_come_one_after_the_other(twin, pulses):
    asked = {
        "period": ("add_ci_period_chan", "ci_period_term", [1e-3] * 4),
        "width": ("add_ci_pulse_width_chan", "ci_pulse_width_term", [0.25e-3] * 4),
        "halves": ("add_ci_semi_period_chan", "ci_semi_period_term", [0.25e-3, 0.75e-3] * 2),
    }
    for call, term, expected in asked.values():
        with nidaqmx.Task() as meter:
            setattr(getattr(meter.ci_channels, call)("Dev1/ctr1", min_val=1e-6, max_val=0.1), term, OUT)
            meter.timing.cfg_implicit_timing(samps_per_chan=4)
            meter.start()
            pulses.start()
            assert meter.read(4) == pytest.approx(expected, abs=2e-8)
        pulses.stop()
    with nidaqmx.Task() as meter:
        channel = meter.ci_channels.add_ci_period_chan("Dev1/ctr1", units=TimeUnits.TICKS)
        channel.ci_period_term = OUT
        assert channel.ci_period_units is TimeUnits.TICKS
        meter.start()
        pulses.start()
        assert meter.read() == 100_000, "of the time base"
    pulses.stop()
    with nidaqmx.Task() as single, nidaqmx.Task() as meter:
        channel = single.co_channels.add_co_pulse_chan_time("Dev1/ctr2", low_time=0.5, high_time=1.0)
        edges = meter.ci_channels.add_ci_count_edges_chan("Dev1/ctr1")
        edges.ci_count_edges_term = "/Dev1/Ctr2InternalOutput"
        meter.start()
        single.start()
        assert not single.is_task_done()
        assert channel.co_output_state is Level.HIGH
        single.wait_until_done()
        assert single.is_task_done()
        assert meter.read() == 1, "without timing, it puts out one pulse"


def test_two_edges_are_timed_from_the_first_to_the_second(twin, meter):
    twin.set("Dev1/PFI0", lambda times: (times % 0.01 < 0.005).astype(float))
    twin.set("Dev1/PFI1", lambda times: ((times - 0.002) % 0.01 < 0.005).astype(float))
    edges = {"first_edge": Edge.RISING, "second_edge": Edge.RISING}
    channel = meter.ci_channels.add_ci_two_edge_sep_chan("Dev1/ctr0", **edges)
    channel.ci_two_edge_sep_first_term, channel.ci_two_edge_sep_second_term = "/Dev1/PFI0", "/Dev1/PFI1"
    meter.timing.cfg_implicit_timing(samps_per_chan=3)
    assert meter.read(3) == pytest.approx([0.002] * 3, abs=3e-5)


def test_pulses_are_read_as_frequency_time_and_ticks(twin, pulses):
    kinds = {
        "freq": CtrFreq(1000.0, 0.25), "time": CtrTime(0.25e-3, 0.75e-3), "ticks": CtrTick(25_000, 75_000)
    }  # fmt: skip
    for kind, expected in kinds.items():
        with nidaqmx.Task() as meter:
            given = {"source_terminal": "OnboardClock"} if kind == "ticks" else {}
            channel = getattr(meter.ci_channels, f"add_ci_pulse_chan_{kind}")("Dev1/ctr1", **given)
            setattr(channel, f"ci_pulse_{kind}_term", OUT)
            meter.start()
            pulses.start()
            read = meter.read()
            assert type(read) is type(expected)
            assert tuple(read) == pytest.approx(tuple(expected), rel=1e-3)
        pulses.stop()


def test_written_pulses_follow_one_another_and_are_measured_so(twin, meter):
    hertz, duties = np.array([500.0, 1000.0, 2000.0]), np.array([0.5, 0.25, 0.75])
    with nidaqmx.Task() as train:
        train.co_channels.add_co_pulse_chan_freq("Dev1/ctr0")
        train.timing.cfg_implicit_timing(samps_per_chan=3)
        CounterWriter(train.out_stream, auto_start=False).write_many_sample_pulse_frequency(hertz, duties)
        channel = meter.ci_channels.add_ci_pulse_chan_freq("Dev1/ctr1")
        channel.ci_pulse_freq_term = OUT
        meter.timing.cfg_implicit_timing(samps_per_chan=2)
        meter.start()
        train.start()
        read = meter.read(2)
    assert [pulse.freq for pulse in read] == pytest.approx([500, 1000], rel=1e-3)
    assert [pulse.duty_cycle for pulse in read] == pytest.approx([0.5, 0.25], rel=1e-3)


def test_a_clocked_count_is_taken_at_each_edge_of_the_clock(twin, pulses):
    """A count on the sample clock of analog inputs: ten pulses of 1 kHz in each sample of 100 Hz."""
    with nidaqmx.Task() as analog, nidaqmx.Task() as meter:
        clocked(analog, "Dev1/ai0", 100, sample_mode=CONTINUOUS)
        meter.ci_channels.add_ci_count_edges_chan("Dev1/ctr1").ci_count_edges_term = OUT
        meter.timing.cfg_samp_clk_timing(100, "/Dev1/ai/SampleClock", samps_per_chan=6)
        pulses.start()
        meter.start()
        analog.start()
        counts = meter.read(6)
    assert np.diff(counts).tolist() == pytest.approx([10] * 5, abs=1)


def test_a_measurement_that_gets_no_edges_ends_at_its_time_out(twin, meter):
    twin.set("Dev1/PFI0", 0.0)
    channel = meter.ci_channels.add_ci_freq_chan("Dev1/ctr1", units=FrequencyUnits.HZ)
    channel.ci_freq_term = "/Dev1/PFI0"
    began = twin.now
    with pytest.raises(nidaqmx.DaqError) as caught:
        meter.read(timeout=2.0)
    assert caught.value.error_type is Error.SAMPLES_NOT_YET_AVAILABLE
    assert 2.0 <= twin.now - began < 2.1


def test_a_reference_trigger_is_waited_for(twin, task):
    """The trigger comes 50 ms after the start: what is read lies around it; without it nothing is read."""
    start = 0.0
    twin.set("Dev1/ai0", lambda times: times - start)
    twin.set("Dev1/PFI0", lambda times: (times - start > 0.05).astype(float))
    clocked(task, "Dev1/ai0", 1000, samps_per_chan=30)
    task.triggers.reference_trigger.cfg_dig_edge_ref_trig("/Dev1/PFI0", 10)
    start = twin.now
    read = np.array(task.read(30))
    assert np.argmax(read > 0.05) == pytest.approx(10, abs=1)
    assert read == pytest.approx(read[0] + np.arange(30) / 1000, abs=2e-3)
    twin.set("Dev1/PFI0", 0.0)
    with pytest.raises(nidaqmx.DaqError) as caught:
        task.read(30, timeout=1.0)
    assert caught.value.error_type is Error.SAMPLES_NOT_YET_AVAILABLE


@pytest.mark.parametrize("idle", [False, True])
def test_a_train_asked_in_pieces_is_the_train_asked_at_once(idle):
    train = PulseTrain(1.0, np.array([0.3, 0.1]), np.array([0.2, 0.4]), 7, idle)
    whole = train.transitions(0.0, 10.0)
    ends = np.sort(np.random.default_rng(3).uniform(0, 10, 40))
    parts = [train.transitions(a, b) for a, b in zip([0.0, *ends], [*ends, 10.0], strict=True)]
    assert np.array_equal(np.concatenate([part.times for part in parts]), whole.times)
    assert len(whole.to(True)) == 7
    assert train.end == pytest.approx(1.0 + 3 * 1.0 + 0.5)
