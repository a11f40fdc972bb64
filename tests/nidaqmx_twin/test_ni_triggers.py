"""What triggers, filters, clocks between cards and watchdogs do: each row names the statement it is from."""

from collections.abc import Callable, Iterator

import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import (
    AcquisitionType,
    CountDirection,
    DigitalWidthUnits,
    Level,
    LineGrouping,
    Signal,
    TerminalConfiguration,
    TimeUnits,
)
from nidaqmx.system import System
from nidaqmx.system.watchdog import DOExpirationState, WatchdogTask

from haploop.base.arrays import FloatArray
from haploop.nidaqmx_twin import NiTwin
from tests.nidaqmx_twin.ni_client import CONTINUOUS, FINITE, Make, clocked, code

CARDS = {"Dev1": "PCIe-6363", "Dev2": "PCIe-6363", "M": "PCI-6221", "E": "PCI-6034E", "Dsa": "USB-4431"}


@pytest.fixture
def twin() -> Iterator[NiTwin]:
    with NiTwin(CARDS) as twin:
        for device in CARDS:
            twin.set(f"{device}/ai0", lambda times: times)
        yield twin


@pytest.fixture
def task(twin: NiTwin) -> Iterator[nidaqmx.Task]:
    with nidaqmx.Task() as task:
        yield task


def pulses(period: float, high: float) -> Callable[[FloatArray], FloatArray]:
    """A signal that is high at the beginning of each period (s)."""
    return lambda times: ((times + 1e-9) % period < high).astype(float)


def bouncing(times: FloatArray) -> FloatArray:
    """High from 10 to 30 ms of every 50 ms, with a glitch of 0.1 ms in either level."""
    phase = (times + 1e-9) % 0.05
    high = (phase >= 0.01) & (phase < 0.03)
    glitch = ((phase >= 0.005) & (phase < 0.0051)) | ((phase >= 0.015) & (phase < 0.0151))
    return np.asarray((high ^ glitch).astype(float))


# Digital filters: X Series manual 370784 and M Series manual 371022, table "Filters"


@pytest.mark.parametrize(
    ("device", "width", "right"),
    [
        ("Dev1", None, [0.0001, 0.005, 0.0149]),
        ("Dev1", 1e-3, [0.02, 0.02, 0.02]),
        ("Dev1", 50e-6, [0.0001, 0.005, 0.0149]),
        ("M", 1e-3, [0.02, 0.02, 0.02]),  # its next longer one, 2.56 ms
        ("M", 2.6e-3, -200077),  # its longest is 2.56 ms; inferred code
        ("Dev1", 0.0, -200771),  # NI's name of the code, DIG_FILTER_ENABLED_MIN_PULSE_WIDTH_NOT_CFG
    ],
)
def test_a_filter_lets_long_pulses_pass(twin, task, device, width, right):
    twin.set(f"{device}/PFI9", bouncing)
    channel = task.ci_channels.add_ci_pulse_width_chan(f"{device}/ctr0", min_val=1e-6, max_val=1.0)
    if width is not None:
        channel.ci_pulse_width_dig_fltr_enable = True
        channel.ci_pulse_width_dig_fltr_min_pulse_width = width
    task.timing.cfg_implicit_timing(samps_per_chan=3)
    found = code(task.start)
    if isinstance(right, int):
        assert found == right
    else:
        assert found is None
        assert sorted(task.read(3)) == pytest.approx(sorted(right), abs=2e-5)


@pytest.mark.usefixtures("twin")
def test_filters_that_a_card_has_not():
    """NI's names of the codes; that an E Series card has none is inferred."""
    with nidaqmx.Task() as task:
        channel = task.ci_channels.add_ci_count_edges_chan("E/ctr0")
        channel.ci_count_edges_dig_fltr_enable = True
        channel.ci_count_edges_dig_fltr_min_pulse_width = 1e-3
        assert code(task.start) == -200772
    with nidaqmx.Task() as task:
        channel = task.ci_channels.add_ci_count_edges_chan("Dev1/ctr0")
        channel.ci_count_edges_dig_fltr_enable = channel.ci_count_edges_dig_sync_enable = True
        channel.ci_count_edges_dig_fltr_min_pulse_width = 1e-3
        assert code(task.start) == -200770


def test_a_filter_delays_a_start_trigger(twin, task):
    """X Series manual, "Filter Example": the level passes once it was seen N times."""
    twin.set("Dev1/PFI0", bouncing)
    clocked(task, "Dev1/ai0", 1000, samps_per_chan=10)
    start = task.triggers.start_trigger
    start.cfg_dig_edge_start_trig("/Dev1/PFI0")
    assert task.read(10)[0] == pytest.approx(0.005, abs=5e-4)
    start.dig_edge_dig_fltr_enable, start.dig_edge_dig_fltr_min_pulse_width = True, 2e-3
    assert task.read(10)[0] % 0.05 == pytest.approx(0.012, abs=5e-4)


def test_a_filter_of_lines_whose_changes_are_detected(twin, task):
    twin.set("Dev1/port0/line0", bouncing)
    line = task.di_channels.add_di_chan("Dev1/port0/line0")
    line.di_dig_fltr_enable, line.di_dig_fltr_min_pulse_width = True, 1e-3
    task.timing.cfg_change_detection_timing("Dev1/port0/line0", "Dev1/port0/line0", CONTINUOUS, 100)
    task.start()
    twin.sleep(0.1)
    assert task.read(task.in_stream.avail_samp_per_chan) == [True, False, True, False]


# A task that each trigger starts again: X Series manual 370784, "Retriggerable Analog Input"


def test_samples_of_each_trigger(twin):
    """A trigger in a burst is ignored; NI's example cont_voltage_acq_int_clk_dig_start_retrig.py."""
    twin.set("Dev1/PFI0", pulses(0.015, 0.001))
    with nidaqmx.Task() as task:
        clocked(task, "Dev1/ai0", 1000, sample_mode=FINITE, samps_per_chan=20)
        start = task.triggers.start_trigger
        start.cfg_dig_edge_start_trig("/Dev1/PFI0")
        start.retriggerable = True
        task.start()
        read = np.array([*task.read(20), *task.read(5), *task.read(35)])
        assert not task.is_task_done()
    bursts = np.array([0.015, 0.045, 0.075])[:, np.newaxis] + np.arange(20) / 1000
    assert read == pytest.approx(bursts.ravel(), abs=5e-4)


def test_a_task_is_started_again_by_a_counter_that_runs_later(twin):
    with nidaqmx.Task() as co, nidaqmx.Task() as ai:
        pulse = co.co_channels.add_co_pulse_chan_time("Dev1/ctr0", low_time=0.095, high_time=0.005)
        co.timing.cfg_implicit_timing(sample_mode=CONTINUOUS)
        clocked(ai, "Dev1/ai0", 1000, sample_mode=FINITE, samps_per_chan=100)
        ai.triggers.start_trigger.cfg_dig_edge_start_trig(pulse.co_pulse_term)
        ai.triggers.start_trigger.retriggerable = True
        ai.start()
        twin.sleep(0.5)
        assert ai.in_stream.avail_samp_per_chan == 0
        began = twin.now
        co.start()
        firsts = [ai.read(100)[0] - began for _ in range(3)]
    assert firsts == pytest.approx([0.0, 0.1, 0.2], abs=5e-4)


@pytest.mark.parametrize(
    ("device", "many", "right"),
    [
        ("Dev1", 0, [0, 0.1]),
        ("Dev1", 3, [0, 0.003, 0.006, 0.1, 0.103, 0.106]),
        ("M", 0, [0, 0.1]),
        ("M", 3, None),
    ],
)
def test_pulses_of_each_trigger(twin, device, many, right):
    """Trains of an M Series counter: NI's name of the code, RETRIGGERING_FINITE_CO_NOT_ALLOWED."""
    twin.set(f"{device}/PFI1", pulses(0.1, 0.01))
    with nidaqmx.Task() as task:
        task.co_channels.add_co_pulse_chan_time(f"{device}/ctr0", low_time=0.002, high_time=0.001)
        if many:
            task.timing.cfg_implicit_timing(samps_per_chan=many)
        task.triggers.start_trigger.cfg_dig_edge_start_trig(f"/{device}/PFI1")
        task.triggers.start_trigger.retriggerable = True
        if right is None:
            assert code(task.start) == -201439
            return
        task.start()
        twin.sleep(0.25)
        put = twin.put(f"{device}/ctr0")
        assert not task.is_task_done()
    assert put.times[put.values > 0] - 0.1 == pytest.approx(right, abs=1e-4)


def _ao(task: nidaqmx.Task) -> None:
    clocked(task, "Dev1/ao0", 1000, sample_mode=FINITE, samps_per_chan=10)
    task.write(np.arange(10) / 10)


def _ai(device: str, mode: AcquisitionType = FINITE) -> Make:
    def make(task: nidaqmx.Task) -> None:
        clocked(task, f"{device}/ai0", 1000, sample_mode=mode, samps_per_chan=10)

    return make


def _pretriggered(task: nidaqmx.Task) -> None:
    _ai("Dev1")(task)
    task.triggers.reference_trigger.cfg_dig_edge_ref_trig("/Dev1/PFI2", 5)


@pytest.mark.parametrize(
    ("make", "right"),
    [
        (_ai("Dev1"), None),
        (_ao, -200197),  # not simulated: it put out samples without end after the first trigger
        (_ai("M"), -200452),  # inferred: "Retriggerable Analog Input" is of the X Series manual
        # NI's name of the code, RETRIGGERING_INVALID_FOR_GIVEN_SETTINGS
        (_ai("Dev1", CONTINUOUS), -201320),
        (_pretriggered, -201320),
    ],
)
def test_what_no_trigger_starts_again(twin, task, make, right):
    for device in ("Dev1", "M"):
        twin.set(f"{device}/PFI1", pulses(0.1, 0.01))
    make(task)
    task.triggers.start_trigger.cfg_dig_edge_start_trig(f"/{task.devices[0].name}/PFI1")
    task.triggers.start_trigger.retriggerable = True
    assert code(task.start) == right


def test_a_reference_trigger_comes_once(task):
    """X Series manual 370784: "Reference triggers are not retriggerable"; inferred code."""
    _pretriggered(task)
    task.triggers.reference_trigger.retriggerable = True
    assert code(task.start) == -200452


# Delays: nidaqmx, `StartTrigger.delay`: "an amount of time to wait after the Start Trigger is received"


@pytest.mark.parametrize(
    ("device", "source", "delay", "units", "right"),
    [
        ("Dev1", "", 5.0, DigitalWidthUnits.SAMPLE_CLOCK_PERIODS, 0.105),
        ("Dev1", "", 0.02, DigitalWidthUnits.SECONDS, 0.12),
        ("Dev1", "", 1e6, DigitalWidthUnits.TICKS, 0.11),
        # NI's names of the codes
        ("Dev1", "", 1.0, DigitalWidthUnits.TICKS, -200333),
        ("Dev1", "/Dev1/PFI5", 5.0, DigitalWidthUnits.SECONDS, -200436),
        ("Dsa", "", 5.0, DigitalWidthUnits.SECONDS, -201429),
    ],
)
def test_a_delay_from_the_start_trigger(twin, task, device, source, delay, units, right):
    twin.set("Dev1/PFI1", lambda times: (times >= 0.1) * 1.0)
    clocked(task, f"{device}/ai0", 1000, source, samps_per_chan=10)
    start = task.triggers.start_trigger
    if device == "Dev1":
        start.cfg_dig_edge_start_trig("/Dev1/PFI1")
    start.delay, start.delay_units = delay, units
    if right < 0:
        assert code(task.start) == right
    else:
        assert task.read(10)[0] == pytest.approx(right, abs=5e-4)


def test_a_counter_has_no_delay_from_its_start_trigger(task):
    task.co_channels.add_co_pulse_chan_freq("Dev1/ctr0")
    task.triggers.start_trigger.delay = 1.0
    assert code(task.start) == -200452


def test_a_delay_from_the_reference_trigger(twin, task):
    """nidaqmx, `ReferenceTrigger.delay`: "before switching from pretrigger to posttrigger samples"."""
    twin.set("Dev1/PFI2", lambda times: (times >= 0.1) * 1.0)
    _pretriggered(task)
    task.triggers.reference_trigger.delay = 0.03
    assert task.read(10)[5] == pytest.approx(0.13, abs=1.1e-3)


# Clocks and triggers between cards


@pytest.mark.parametrize("what", ["clock", "trigger", "names"])
def test_two_cards_in_step(twin, what):
    """A line of the RTSI cable is one line, whatever card names it; the one that waits is started first."""
    with nidaqmx.Task() as first, nidaqmx.Task() as second:
        for task, device in ((first, "Dev1"), (second, "Dev2")):
            clocked(task, f"{device}/ai0", 1000, samps_per_chan=20)
        if what == "clock":
            first.export_signals.export_signal(Signal.SAMPLE_CLOCK, "/Dev1/RTSI0")
            second.timing.samp_clk_src = "/Dev2/RTSI0"
        elif what == "trigger":
            first.export_signals.start_trig_output_term = "/Dev1/RTSI1"
            second.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev2/RTSI1")
        else:
            second.timing.samp_clk_src = "/Dev1/ai/SampleClock"
        second.start()
        twin.sleep(0.2)
        assert second.in_stream.avail_samp_per_chan == 0
        first.start()
        assert first.read(20) == pytest.approx(second.read(20), abs=1e-3)


def test_a_clock_that_is_no_even_one_is_shared(twin):
    """It ticked at the rate that was asked for."""
    twin.set("Dev1/PFI3", pulses(0.007, 0.001))
    twin.set("Dev1/port0/line0", pulses(0.014, 0.007))
    with nidaqmx.Task() as ai, nidaqmx.Task() as di:
        clocked(ai, "Dev1/ai0", 1000, "/Dev1/PFI3", samps_per_chan=10)
        clocked(di, "Dev1/port0/line0", 1000, "/Dev1/ai/SampleClock", samps_per_chan=10)
        di.start()
        ai.start()
        assert np.diff(ai.read(10)) == pytest.approx(np.full(9, 0.007), abs=1e-3)
        assert di.read(10) in ([True, False] * 5, [False, True] * 5)


def test_lines_that_are_inverted(twin):
    """nidaqmx, `do_invert_lines`: "the lines are at high logic when off"."""
    twin.wire("Dev1/port0/line0", "Dev1/port0/line4")
    with nidaqmx.Task() as do, nidaqmx.Task() as di:
        do.do_channels.add_do_chan("Dev1/port0/line0").do_invert_lines = True
        line = di.di_channels.add_di_chan("Dev1/port0/line4")
        do.write(True)
        assert (di.read(), twin.put("Dev1/port0/line0").values[-1], do.read()) == (False, 0.0, True)
        line.di_invert_lines = True
        assert di.read()


def test_a_read_of_more_than_the_buffer_holds(twin, task):
    """A PCI-6133 gave 100,000 counts of a buffer of 10,000 (juliancabaleiro/nidaqmx-python-examples,
    ci_tick_external.py); it was -200279.
    """
    twin.set("Dev1/PFI0", pulses(1e-4, 5e-5))
    task.ci_channels.add_ci_count_edges_chan("Dev1/ctr0").ci_count_edges_term = "/Dev1/PFI0"
    task.timing.cfg_samp_clk_timing(1000, "/Dev1/PFI0", sample_mode=CONTINUOUS, samps_per_chan=1000)
    assert len(task.read(12_000)) == 12_000
    twin.sleep(1.5)
    assert code(lambda: task.read(10)) == -200279


def test_a_differential_input_reads_the_difference(twin):
    """The negative end of AI 0 is AI 8: products.toml, `ai_bank`."""
    twin.set("Dev1/ai0", 3.0)
    twin.set("Dev1/ai8", 1.0)
    for how, right in ((TerminalConfiguration.DIFF, 2.0), (TerminalConfiguration.RSE, 3.0)):
        with nidaqmx.Task() as task:
            task.ai_channels.add_ai_voltage_chan("Dev1/ai0", terminal_config=how)
            assert task.read() == pytest.approx(right, abs=2e-3)


def test_a_timebase_that_is_exported(twin):
    with nidaqmx.Task() as ai, nidaqmx.Task() as ci:
        clocked(ai, "Dev1/ai0", 1000, sample_mode=CONTINUOUS)
        ai.export_signals.export_signal(Signal.TWENTY_MHZ_TIMEBASE_CLOCK, "/Dev1/PFI5")
        ci.ci_channels.add_ci_count_edges_chan("Dev1/ctr3").ci_count_edges_term = "/Dev1/PFI5"
        ai.start()
        ci.start()
        twin.sleep(0.01)
        assert ci.read() == pytest.approx(200_000, rel=0.05)


@pytest.mark.parametrize(("level", "right"), [(1, 110), (0, 90)])
def test_a_direction_that_does_not_change(twin, task, level, right):
    """High counts up (inferred), also where it is steady: then it counted down."""
    twin.set("Dev1/PFI8", pulses(0.01, 0.005))
    twin.set("Dev1/PFI10", level)
    task.ci_channels.add_ci_count_edges_chan(
        "Dev1/ctr0", initial_count=100, count_direction=CountDirection.EXTERNAL_SOURCE
    )
    task.start()
    twin.sleep(0.1045)
    assert task.read() == right


@pytest.mark.parametrize(("device", "asked", "right"), [("Dev1", 7e6, 100e6 / 14), ("M", 7e6, 80e6 / 11)])
def test_pulses_have_whole_ticks(twin, device, asked, right):
    """NI-DAQmx Key Concepts, "Counter Frequency Coercion": the nearest that the timebase divides into."""
    with nidaqmx.Task() as task:
        task.co_channels.add_co_pulse_chan_freq(f"{device}/ctr0", freq=asked)
        task.timing.cfg_implicit_timing(samps_per_chan=100)
        task.start()
        task.wait_until_done()
    put = twin.put(f"{device}/ctr0")
    rising = put.times[put.values > 0]
    assert (len(rising) - 1) / (rising[-1] - rising[0]) == pytest.approx(right, rel=1e-6)


def test_a_timebase_from_outside_is_refused_where_something_comes(twin):
    """Not simulated: its ticks were those of the card's own."""
    twin.set("Dev1/PFI0", pulses(1e-3, 5e-4))
    with nidaqmx.Task() as task:
        task.co_channels.add_co_pulse_chan_ticks("Dev1/ctr0", "/Dev1/PFI0", low_ticks=2, high_ticks=2)
        assert code(task.start) == -200197
    with nidaqmx.Task() as task:
        channel = task.ci_channels.add_ci_pulse_width_chan("Dev1/ctr0", units=TimeUnits.TICKS)
        channel.ci_ctr_timebase_src = "/Dev1/PFI0"
        assert code(task.start) == -200197


def test_conversions_that_are_too_fast(task):
    """NI's name of the code, AI_CONV_RATE_TOO_HIGH."""
    clocked(task, "Dev1/ai0:1", 1000, samps_per_chan=10)
    task.timing.ai_conv_rate = 5e6
    assert code(task.start) == -200335


def test_an_index_of_an_encoder_is_refused_where_something_comes(twin, task):
    """Not simulated: the position went on."""
    task.ci_channels.add_ci_ang_encoder_chan("Dev1/ctr0", zidx_enable=True)
    assert code(task.start) is None
    task.stop()
    twin.set("Dev1/PFI9", 0)
    assert code(task.start) == -200197


# Watchdogs: X Series manual 370784, "Watchdog Timer"


def test_outputs_of_an_expired_watchdog(twin):
    """They "remain in that state until the watchdog timer is disarmed" and "new values are written"; the name
    of the code is WRITE_FAILED_BECAUSE_WATCHDOG_EXPIRED.
    """
    with nidaqmx.Task() as do, WatchdogTask("Dev1", timeout=0.5) as watchdog:
        do.do_channels.add_do_chan("Dev1/port0/line0:1", line_grouping=LineGrouping.CHAN_PER_LINE)
        watchdog.cfg_watchdog_do_expir_states([DOExpirationState("Dev1/port0/line0", Level.LOW)])
        watchdog.start()
        began = twin.now
        for _ in range(3):
            assert do.write([True, True]) == 1
            twin.sleep(0.4)
            watchdog.reset_timer()
        twin.sleep(1.0)
        first, second = twin.put("Dev1/port0/line0"), twin.put("Dev1/port0/line1")
        assert (first.values[-1], second.values[-1]) == (0.0, 1.0)
        assert first.times[-1] - began == pytest.approx(1.7, abs=0.01)
        assert code(lambda: do.write([True, True])) == -200678
        watchdog.clear_expiration()
        assert twin.put("Dev1/port0/line0").values[-1] == 0
        assert do.write([True, True]) == 1
        assert twin.put("Dev1/port0/line0").values[-1] == 1


@pytest.mark.parametrize(
    ("device", "timeout", "right"),
    [
        ("Dev1", 34.0, None),
        ("Dev1", 35.0, -200668),  # (2^32 - 1) x 8 ns
        ("Dev1", 0.0, -200668),
        ("Dev1", -1.0, None),  # grpc-device, "Watchdog Attributes": "never expires"
        ("M", 1.0,
         -200662),  # NI's name of the code, WATCHDOG_TIMER_NOT_SUPPORTED; that it has none is inferred
    ],
)  # fmt: skip
def test_time_outs_of_watchdogs(twin, device, timeout, right):
    def expires():
        with WatchdogTask(device, timeout=timeout) as watchdog:
            watchdog.start()
            twin.sleep(33.0)
            assert not watchdog.expired

    assert code(expires) == right
    assert System.local().devices[device].name == device


# What is not simulated is refused where something is connected: it would come at once


@pytest.mark.parametrize(
    "configure",
    [
        lambda task: task.triggers.start_trigger.cfg_anlg_window_start_trig(1.0, 0.5, "force"),
        lambda task: task.triggers.reference_trigger.cfg_anlg_window_ref_trig("force", 1.0, 0.5, 5),
        lambda task: task.triggers.start_trigger.cfg_dig_pattern_start_trig("Dev1/port0/line0", "1"),
        lambda task: setattr(task.ai_channels[0], "ai_lowpass_enable", True),
        lambda task: setattr(task.ai_channels[0], "ai_dig_fltr_enable", True),
    ],
)
def test_what_would_be_passed_over(twin, task, configure):
    twin.set("Dev1/port0/line0", 0)
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0", "force")
    task.timing.cfg_samp_clk_timing(1000, samps_per_chan=10)
    assert code(task.start) is None
    task.stop()
    configure(task)
    assert code(task.start) == -200197
