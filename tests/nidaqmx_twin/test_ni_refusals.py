"""What a card refuses when a task is verified or started: each row names the statement it is from."""

from __future__ import annotations

import operator
import struct
from collections.abc import Callable, Iterator
from typing import Any

import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import (
    AcquisitionType,
    CJCSource,
    LoggingMode,
    ReadRelativeTo,
    RegenerationMode,
    RTDType,
    TemperatureUnits,
    ThermocoupleType,
    TriggerType,
)
from nidaqmx.system import System
from nidaqmx.types import CtrFreq

from haploop.nidaqmx_twin import NiTwin
from tests.nidaqmx_twin.test_ni_as_a_card import code

CARDS = {
    "Dev1": "PCIe-6363", "M": "PCI-6221", "Ao": "PCI-6713", "Old": "PCI-6034E", "Bus": "USB-6211",
    "Low": "USB-6009", "Hs": "PCIe-6535", "cDAQ1": "cDAQ-9178", "cDAQ1Mod1": "NI 9213",
    "cDAQ1Mod2": "NI 9361", "cDAQ1Mod3": "NI 9234", "Dsa": "USB-4431",
}  # fmt: skip
K, T, J = ThermocoupleType.K, ThermocoupleType.T, ThermocoupleType.J


@pytest.fixture(scope="module")
def twin() -> Iterator[NiTwin]:
    with NiTwin(CARDS) as twin:
        yield twin


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize(
    ("words", "right"),
    [
        # Temperatures of the types' reference functions: NIST Monograph 175
        ({"thermocouple_type": K, "max_val": 1372.0}, None),
        ({"thermocouple_type": K, "max_val": 1400.0}, -200077),
        ({"thermocouple_type": K, "min_val": -300.0}, -200077),
        ({"thermocouple_type": T, "max_val": 2000.0}, -200077),
        ({"thermocouple_type": T, "units": TemperatureUnits.DEG_F, "min_val": 32.0, "max_val": 752.0}, None),
        ({"thermocouple_type": T, "units": TemperatureUnits.DEG_F, "max_val": 800.0}, -200077),
        ({"thermocouple_type": J, "units": TemperatureUnits.K, "min_val": 273.0, "max_val": 373.0}, None),
        ({"thermocouple_type": J, "units": TemperatureUnits.K}, -200077),  # from 0 K on, by default
        # NI's name of the code, CJC_CHAN_NAME_MUST_BE_SET_WHEN_CJC_SRC_IS_SCANNABLE_CHAN
        ({"cjc_source": CJCSource.SCANNABLE_CHANNEL}, -201085),
        ({"cjc_source": CJCSource.SCANNABLE_CHANNEL, "cjc_channel": "junction"}, None),
    ],
)
def test_a_thermocouple(words, right):
    with nidaqmx.Task() as task:
        task.ai_channels.add_ai_thrmcpl_chan("cDAQ1Mod1/ai0", **words)
        assert code(task.start) == right


@pytest.mark.usefixtures("twin")
def test_what_a_module_does_not_measure():
    """NI's name of the code, PHYS_CHAN_MEAS_TYPE; what a 9213 measures: products.toml."""
    with nidaqmx.Task() as task:
        add = task.ai_channels
        assert code(lambda: add.add_ai_rtd_chan("cDAQ1Mod1/ai0", rtd_type=RTDType.PT_3750)) == -200431
        assert code(lambda: add.add_ai_rtd_chan("Dev1/ai0", rtd_type=RTDType.PT_3750)) is None


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize(
    ("add", "channel", "words", "right"),
    [
        # A limit over the sensitivity, or times the shunt, is volts, which must fit a range: products.toml
        ("accel", "cDAQ1Mod3/ai0", {"sensitivity": 100.0, "max_val": 50.0, "min_val": -50.0}, None),
        ("accel", "cDAQ1Mod3/ai0", {"sensitivity": 100.0, "max_val": 500.0, "min_val": -500.0}, -200077),
        ("accel", "cDAQ1Mod3/ai0", {"sensitivity": 102.3, "max_val": 50.0, "min_val": -50.0}, None),
        ("current", "Dev1/ai0", {"max_val": 0.02, "min_val": 0.004, "ext_shunt_resistor_val": 249.0}, None),
        ("current", "Dev1/ai0", {"max_val": 0.1, "min_val": 0.0, "ext_shunt_resistor_val": 249.0}, -200077),
    ],
)
def test_limits_of_a_sensor(add, channel, words, right):
    with nidaqmx.Task() as task:
        getattr(task.ai_channels, f"add_ai_{add}_chan")(channel, **words)
        task.timing.cfg_samp_clk_timing(5120, samps_per_chan=10)
        assert code(task.start) == right


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize(("timed", "right"), [(False, -200300), (True, None)])
def test_a_dynamic_signal_card_has_a_sample_clock(timed, right):
    """daqmx, issue 3: "Sample Timing Type is set to On Demand which is not supported"; inferred code."""
    with nidaqmx.Task() as task:
        task.ai_channels.add_ai_voltage_chan("Dsa/ai0")
        if timed:
            task.timing.cfg_samp_clk_timing(1000, samps_per_chan=10)
        assert code(task.read) == right


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize(
    ("kind", "lines", "source", "right"),
    [
        ("di", "Dev1/port0/line0", "", None),
        ("do", "Dev1/port0/line0", "", -200462),  # clocked, and nothing written
        # pylibnidaqmx, issues 43 and 11: DAQmx_Val_SampClk, and "You Can Select: DAQmx_Val_OnDemand"
        ("di", "Dev1/port1/line0", "", -200077),
        ("di", "Bus/port0/line0", "", -200077),
        ("di", "Low/port0/line0", "", -200077),
        ("di", "Old/port0/line0", "/Old/ai/SampleClock", -200077),
        # acq4, issue 128: the largest rate of a 6229's lines is 0; M Series manual: no clock of their own
        ("di", "M/port0/line0", "", -200303),
        ("di", "M/port0/line0", "OnboardClock", -200303),
        ("di", "M/port0/line0", "/M/ai/SampleClock", None),
        ("di", "Hs/port2/line0", "", None),
        # labscript-devices, capabilities.json: `supports_buffered` of a PCI-6713's port 0 is false
        ("di", "Ao/port0/line0", "", -200077),
    ],
)
def test_clocked_lines(kind, lines, source, right):
    with nidaqmx.Task() as task:
        getattr(getattr(task, f"{kind}_channels"), f"add_{kind}_chan")(lines)
        task.timing.cfg_samp_clk_timing(1000, source, samps_per_chan=10)
        assert code(task.start) == right


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize(
    ("counters", "source", "right"),
    [
        # MathWorks, answer 41144: "an external clock must be supplied"
        ("Dev1/ctr0", "", -200303),
        ("Dev1/ctr0", "OnboardClock", -200303),
        ("Dev1/ctr0", "/Dev1/PFI1", None),
        ("cDAQ1Mod2/ctr0", "", None),
        # nidaqmx, `add_ci_count_edges_chan`: "a task can contain only one counter input channel"
        ("M/ctr0:1", "/M/PFI1", -200147),
        ("cDAQ1Mod2/ctr0:1", "", None),
    ],
)
def test_buffered_counts(counters, source, right):
    with nidaqmx.Task() as task:
        task.ci_channels.add_ci_count_edges_chan(counters)
        task.timing.cfg_samp_clk_timing(1000, source, samps_per_chan=10)
        assert code(task.start) == right


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize(
    ("device", "words", "right"),
    [
        # NI-DAQmx Base, text of -200745: timebase / maximum count <= frequency <= timebase / 4
        ("Dev1", {"freq": 25e6}, None),
        ("Dev1", {"freq": 26e6}, -200745),
        ("M", {"freq": 20e6}, None),
        ("M", {"freq": 21e6}, -200745),
        ("Dev1", {"freq": 1e-5}, -200745),
        ("Dev1", {"freq": 0.0}, -200077),
        ("Dev1", {"freq": 100.0, "duty_cycle": 0.0}, -200077),
        ("Dev1", {"freq": 100.0, "duty_cycle": 1.0}, -200077),
    ],
)
def test_pulses(device, words, right):
    with nidaqmx.Task() as task:
        task.co_channels.add_co_pulse_chan_freq(f"{device}/ctr0", **words)
        assert code(task.start) == right


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize(
    ("low", "high", "right"), [(20e-9, 20e-9, None), (1e-9, 1e-9, -200746), (0.0, 1e-3, -200077)]
)
def test_times_of_pulses(low, high, right):
    """As of the frequency; NI's name of the code, SUITABLE_TIMEBASE_NOT_FOUND_TIME_COMBO_2."""
    with nidaqmx.Task() as task:
        task.co_channels.add_co_pulse_chan_time("Dev1/ctr0", low_time=low, high_time=high)
        assert code(task.start) == right


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize(
    ("source", "right"),
    [("/Dev1/PFI0", None), ("OnboardClock", None), ("/Dev1/20MHzTimebase", None), ("/Dev1/nosuch", -89120)],
)
def test_a_timebase_is_a_terminal(source, right):
    """NI-DAQmx Base, text of -89120."""
    with nidaqmx.Task() as task:
        task.co_channels.add_co_pulse_chan_ticks("Dev1/ctr0", source, low_ticks=10, high_ticks=10)
        assert code(task.start) == right


@pytest.mark.usefixtures("twin")
def test_a_pulse_of_an_encoder_is_worth_something():
    """The code is NI's for a value out of range; it was a traceback of the server's."""
    with nidaqmx.Task() as task:
        task.ci_channels.add_ci_ang_encoder_chan("Dev1/ctr0", pulses_per_rev=0)
        assert code(task.start) == -200077


@pytest.mark.usefixtures("twin")
def test_a_counter_that_counts_edges_does_nothing_else():
    """USB-6008/6009 user guide, "Event Counter"."""
    with nidaqmx.Task() as task:
        assert code(lambda: task.ci_channels.add_ci_freq_chan("Low/ctr0")) == -200431
        assert code(lambda: task.co_channels.add_co_pulse_chan_freq("Low/ctr0")) == -200170
    device = System.local().devices["Low"]
    assert (len(device.ci_physical_chans), len(device.co_physical_chans)) == (1, 0)


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize(("rate", "right"), [(10e6, -200462), (11e6, -200332)])
def test_how_fast_lines_are(rate, right):
    """labscript-devices, capabilities.json, measured: 10 MHz of a PCIe-6363, here with nothing to put out."""
    with nidaqmx.Task() as task:
        task.do_channels.add_do_chan("Dev1/port0/line0")
        task.timing.cfg_samp_clk_timing(rate, samps_per_chan=10)
        if right != -200462:
            task.write([True] * 10)
        assert code(task.start) == right


@pytest.mark.usefixtures("twin")
def test_limits_of_a_frequency():
    """NI's sentence of -200082: "Minimum is greater than or equal to the maximum"."""
    with nidaqmx.Task() as task:
        task.ci_channels.add_ci_freq_chan("Dev1/ctr0", min_val=200.0, max_val=100.0)
        assert code(task.start) == -200082


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize(
    ("mode", "add", "timed", "start", "read"),
    [
        # nidaqmx, `LoggingMode.LOG`: "You cannot read data using an NI-DAQmx Read function"
        (LoggingMode.LOG, "ai_channels.add_ai_voltage_chan Dev1/ai0", True, None, -201301),
        (LoggingMode.LOG_AND_READ, "ai_channels.add_ai_voltage_chan Dev1/ai0", True, None, None),
        # NI's names of the codes
        (LoggingMode.LOG_AND_READ, "ai_channels.add_ai_voltage_chan Dev1/ai0", False, -201299, -201299),
        (LoggingMode.LOG, "di_channels.add_di_chan Dev1/port0", True, -200197, -201301),
    ],
)
def test_logging(mode, add, timed, start, read, tmp_path):
    call, channel = add.split()
    with nidaqmx.Task() as task:
        operator.attrgetter(call)(task)(channel)
        if timed:
            task.timing.cfg_samp_clk_timing(1000, samps_per_chan=10)
        task.in_stream.configure_logging(str(tmp_path / "run.tdms"), mode)
        assert (code(task.start), code(task.read)) == (start, read)


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize(("mode", "samples"), [(LoggingMode.LOG, 100), (LoggingMode.LOG_AND_READ, 30)])
def test_what_is_not_read_is_not_logged(mode, samples, tmp_path):
    """nidaqmx, `LoggingMode.LOG_AND_READ`: "You must use an NI-DAQmx Read function"."""
    path = tmp_path / "run.tdms"
    with nidaqmx.Task() as task:
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
        task.timing.cfg_samp_clk_timing(1000, samps_per_chan=100)
        task.in_stream.configure_logging(str(path), mode)
        task.start()
        if mode is LoggingMode.LOG_AND_READ:
            task.read(10), task.read(20)
        task.wait_until_done()
        task.stop()
    written, found, at = path.read_bytes(), 0, 0
    while at < len(written):  # the segments of the file
        length, head = struct.unpack("<QQ", written[at + 12 : at + 28])
        found, at = found + (length - head) // 8, at + 28 + length
    assert found == samples


def test_what_is_not_followed_is_refused_where_something_is_connected(twin):
    """Not simulated: a count that should stand still went on, and an analog trigger came at once."""
    with nidaqmx.Task() as task, pytest.warns(UserWarning, match="without effect"):
        task.ci_channels.add_ci_count_edges_chan("Dev1/ctr0")
        pause = task.triggers.pause_trigger
        pause.trig_type, pause.dig_lvl_src = TriggerType.DIGITAL_LEVEL, "/Dev1/PFI6"
        assert code(task.start) is None
        task.stop()
        twin.set("Dev1/PFI6", 0)
        assert code(task.start) == -200197
    with nidaqmx.Task() as task:
        counter = task.ci_channels.add_ci_count_edges_chan("Dev1/ctr0")
        counter.ci_count_edges_count_reset_enable = True
        counter.ci_count_edges_count_reset_term = "/Dev1/PFI6"
        assert code(task.start) == -200197
    with nidaqmx.Task() as task, pytest.warns(UserWarning, match="without effect"):
        task.ai_channels.add_ai_voltage_chan("Dev1/ai3", "force")
        task.timing.cfg_samp_clk_timing(1000, samps_per_chan=10)
        task.triggers.start_trigger.cfg_anlg_edge_start_trig("force", trigger_level=0.5)
        assert code(task.start) is None
        task.stop()
        twin.set("Dev1/ai3", 0.0)
        assert code(task.start) == -200197


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize("kind", ["ai", "ao"])
def test_a_task_does_not_trigger_itself(kind):
    """NI-DAQmx Base, text of -89131: "the source and the destination are the same terminal"."""
    with nidaqmx.Task() as task:
        getattr(getattr(task, f"{kind}_channels"), f"add_{kind}_voltage_chan")(f"Dev1/{kind}0")
        task.timing.cfg_samp_clk_timing(1000, samps_per_chan=10, sample_mode=AcquisitionType.FINITE)
        task.triggers.start_trigger.cfg_dig_edge_start_trig(f"/Dev1/{kind}/StartTrigger")
        if kind == "ao":
            task.write([0.0] * 10)
        assert code(task.start) == -89131


# Combinations: by NI's names of the codes, unless a row says otherwise

FINITE, CONTINUOUS = AcquisitionType.FINITE, AcquisitionType.CONTINUOUS
ONE_BY_ONE = AcquisitionType.HW_TIMED_SINGLE_POINT


def _ai(task: nidaqmx.Task, device: str = "Dev1", mode: AcquisitionType = FINITE) -> None:
    task.ai_channels.add_ai_voltage_chan(f"{device}/ai0")
    task.timing.cfg_samp_clk_timing(1000, sample_mode=mode, samps_per_chan=10)


def _triggered(before: int, mode: AcquisitionType = FINITE) -> Callable[[nidaqmx.Task], None]:
    def make(task: nidaqmx.Task) -> None:
        _ai(task, mode=mode)
        task.triggers.reference_trigger.cfg_dig_edge_ref_trig("/Dev1/PFI1", before)
        task.start()

    return make


def _paused(task: nidaqmx.Task) -> None:
    _ai(task)
    pause = task.triggers.pause_trigger
    pause.trig_type, pause.dig_lvl_src = TriggerType.DIGITAL_LEVEL, "/Dev1/PFI7"
    task.triggers.reference_trigger.cfg_dig_edge_ref_trig("/Dev1/PFI1", 5)
    task.start()


def _read_from_the_trigger(task: nidaqmx.Task) -> None:
    _ai(task)
    task.in_stream.relative_to = ReadRelativeTo.REFERENCE_TRIGGER
    task.read(2)


def _twice(kind: str, physical: str) -> Callable[[nidaqmx.Task], None]:
    def make(task: nidaqmx.Task) -> None:
        channels = getattr(task, f"{kind}_channels")
        add = getattr(channels, f"add_{kind}_voltage_chan" if kind[0] == "a" else f"add_{kind}_chan")
        add(physical, "one"), add(physical, "two")
        task.start()

    return make


def _beyond(task: nidaqmx.Task) -> None:
    task.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    task.timing.cfg_samp_clk_timing(1000, samps_per_chan=10)
    task.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
    task.write(np.zeros(10))
    task.start()
    task.write(np.zeros(5))


def _pulses(timed: bool, start: bool) -> Callable[[nidaqmx.Task], None]:
    def make(task: nidaqmx.Task) -> None:
        task.co_channels.add_co_pulse_chan_freq("Dev1/ctr0")
        if timed:
            task.timing.cfg_implicit_timing(samps_per_chan=10)
        if start:
            task.start()
        task.write(CtrFreq(10.0, 0.5), auto_start=False)

    return make


def _timed(add: str, terminal: str, timing: str, *how: Any) -> Callable[[nidaqmx.Task], None]:
    def make(task: nidaqmx.Task) -> None:
        operator.attrgetter(add)(task)(terminal)
        getattr(task.timing, timing)(*how)
        task.start()

    return make


def _heard(auto: bool | None) -> Callable[[nidaqmx.Task], None]:
    def make(task: nidaqmx.Task) -> None:
        _ai(task)
        task.register_done_event(lambda *_: 0)
        if auto is not None:
            task.in_stream.auto_start = auto
        task.read(10)

    return make


CHANGES = "cfg_change_detection_timing"
AI, DI, CI, CO = (
    "ai_channels.add_ai_voltage_chan", "di_channels.add_di_chan", "ci_channels.add_ci_freq_chan",
    "co_channels.add_co_pulse_chan_freq",
)  # fmt: skip


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize(
    ("make", "right"),
    [
        (_triggered(8), None),
        (_triggered(9), -200213),
        (_triggered(1), -200077),  # NI's default is 2; that there is no less is inferred
        (_triggered(5, CONTINUOUS), -200358),
        (_paused, -200628),
        (_read_from_the_trigger, -200282),
        (_twice("ai", "Dev1/ai0"), None),
        (_twice("ao", "Dev1/ao0"), -200072),
        (_twice("do", "Dev1/port0/line0"), -200072),
        (lambda task: (_ai(task, "Dev1", ONE_BY_ONE), task.start()), None),
        (lambda task: (_ai(task, "Bus", ONE_BY_ONE), task.start()), -209857),  # of USB cards: inferred
        (_beyond, -201132),
        (_pulses(timed=True, start=True), -201291),
        (_pulses(timed=False, start=False), -200875),
        (_pulses(timed=True, start=False), None),
        # nidaqmx-python, issues 191 and 205: nobody there has set auto start, and it is false
        (_heard(None), -200473),
        (_heard(auto=True), -200984),
        (lambda task: task.ao_channels.add_ao_func_gen_chan("Dev1/ao0"), -200432),
        (lambda task: task.ao_channels.add_ao_current_chan("Dev1/ao0", min_val=0.0, max_val=0.02), -200432),
        (lambda task: task.ai_channels.add_ai_charge_chan("Dev1/ai0"), -200431),
        # The sentence of pylibnidaqmx, issue 43, for other timings that a card has not: inferred
        (_timed(AI, "Dev1/ai0", "cfg_implicit_timing"), -200077),
        (_timed(AI, "Dev1/ai0", CHANGES, "Dev1/port0/line0"), -200077),
        (_timed(DI, "Dev1/port0/line0", "cfg_handshaking_timing"), -200077),
        (_timed(CI, "M/ctr0", "cfg_samp_clk_timing", 1000.0, "/M/PFI1"), -200077),
        (_timed(CO, "M/ctr0", "cfg_samp_clk_timing", 1000.0, "/M/PFI1"), -200077),
        (_timed(CO, "Dev1/ctr0", "cfg_samp_clk_timing", 1000.0), -200303),
        (_timed(DI, "Dev1/port0/line0", CHANGES, "Dev1/port0/line5"), -200926),
        (_timed(DI, "Dev1/port0", CHANGES, "Dev1/port0/line5"), None),
        (_timed(DI, "Dev1/port0", CHANGES, "port0/line0:1", "port0/line5"), None),  # NI's own test_timing.py
        (_timed(DI, "Dev1/port0/line0", CHANGES), -200751),
    ],
)
def test_what_does_not_go_together(make, right):
    with nidaqmx.Task() as task:
        assert code(lambda: make(task)) == right
