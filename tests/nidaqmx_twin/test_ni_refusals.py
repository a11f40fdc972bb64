"""What a card refuses when a task is verified or started: each row names the statement it is from."""

import operator
import struct
from collections.abc import Iterator
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
from tests.nidaqmx_twin.ni_client import CONTINUOUS, FINITE, Make, clocked, code, on

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


@pytest.fixture
def task(twin: NiTwin) -> Iterator[nidaqmx.Task]:
    with nidaqmx.Task() as task:
        yield task


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
def test_logging(task, mode, add, timed, start, read, tmp_path):
    call, channel = add.split()
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
        clocked(task, "Dev1/ai0", 1000, samps_per_chan=100)
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


ONE_BY_ONE = AcquisitionType.HW_TIMED_SINGLE_POINT


def _ai(task: nidaqmx.Task, device: str = "Dev1", mode: AcquisitionType = FINITE) -> None:
    clocked(task, f"{device}/ai0", 1000, sample_mode=mode, samps_per_chan=10)


def _triggered(before: int, mode: AcquisitionType = FINITE) -> Make:
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


def _twice(kind: str, physical: str) -> Make:
    def make(task: nidaqmx.Task) -> None:
        channels = getattr(task, f"{kind}_channels")
        add = getattr(channels, f"add_{kind}_voltage_chan" if kind[0] == "a" else f"add_{kind}_chan")
        add(physical, "one"), add(physical, "two")
        task.start()

    return make


def _beyond(task: nidaqmx.Task) -> None:
    clocked(task, "Dev1/ao0", 1000, samps_per_chan=10)
    task.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
    task.write(np.zeros(10))
    task.start()
    task.write(np.zeros(5))


def _pulses(timed: bool, start: bool) -> Make:
    def make(task: nidaqmx.Task) -> None:
        task.co_channels.add_co_pulse_chan_freq("Dev1/ctr0")
        if timed:
            task.timing.cfg_implicit_timing(samps_per_chan=10)
        if start:
            task.start()
        task.write(CtrFreq(10.0, 0.5), auto_start=False)

    return make


def _heard(auto: bool | None) -> Make:
    def make(task: nidaqmx.Task) -> None:
        _ai(task)
        task.register_done_event(lambda *_: 0)
        if auto is not None:
            task.in_stream.auto_start = auto
        task.read(10)

    return make


def _thermocouple(kind: ThermocoupleType, **words: Any) -> Make:
    return on("ai_thrmcpl_chan", "cDAQ1Mod1/ai0", thermocouple_type=kind, **words)


def _accelerometer(sensitivity: float, limit: float) -> Make:
    words = {"sensitivity": sensitivity, "max_val": limit, "min_val": -limit}
    return on("ai_accel_chan", "cDAQ1Mod3/ai0", 5120, **words)


def _ticks(source: str) -> Make:
    return on("co_pulse_chan_ticks", "Dev1/ctr0", source_terminal=source, low_ticks=10, high_ticks=10)


def _not_written(rate: float) -> Make:
    def make(task: nidaqmx.Task) -> None:
        task.do_channels.add_do_chan("Dev1/port0/line0")
        task.timing.cfg_samp_clk_timing(rate, samps_per_chan=10)
        if rate > 10e6:
            task.write([True] * 10)
        task.start()

    return make


def _triggers_itself(kind: str) -> Make:
    def make(task: nidaqmx.Task) -> None:
        getattr(getattr(task, f"{kind}_channels"), f"add_{kind}_voltage_chan")(f"Dev1/{kind}0")
        task.timing.cfg_samp_clk_timing(1000, samps_per_chan=10, sample_mode=FINITE)
        task.triggers.start_trigger.cfg_dig_edge_start_trig(f"/Dev1/{kind}/StartTrigger")
        if kind == "ao":
            task.write([0.0] * 10)
        task.start()

    return make


CHANGES = "cfg_change_detection_timing"
AI, EDGES, PULSES = "ai_voltage_chan", "ci_count_edges_chan", "co_pulse_chan_freq"
KELVIN, FAHRENHEIT = {"units": TemperatureUnits.K}, {"units": TemperatureUnits.DEG_F}
JUNCTION = {"cjc_source": CJCSource.SCANNABLE_CHANNEL}
SHUNT = {"ext_shunt_resistor_val": 249.0}


@pytest.mark.parametrize(
    ("make", "right"),
    [
        # Temperatures of the types' reference functions: NIST Monograph 175
        (_thermocouple(K, max_val=1372.0), None),
        (_thermocouple(K, max_val=1400.0), -200077),
        (_thermocouple(K, min_val=-300.0), -200077),
        (_thermocouple(T, max_val=2000.0), -200077),
        (_thermocouple(T, **FAHRENHEIT, min_val=32.0, max_val=752.0), None),
        (_thermocouple(T, **FAHRENHEIT, max_val=800.0), -200077),
        (_thermocouple(J, **KELVIN, min_val=273.0, max_val=373.0), None),
        (_thermocouple(J, **KELVIN), -200077),  # from 0 K on, by default
        # NI's name of the code, CJC_CHAN_NAME_MUST_BE_SET_WHEN_CJC_SRC_IS_SCANNABLE_CHAN
        (_thermocouple(J, **JUNCTION), -201085),
        (_thermocouple(J, **JUNCTION, cjc_channel="junction"), None),
        # NI's name of the code, PHYS_CHAN_MEAS_TYPE; what a 9213 measures: products.toml
        (lambda task: task.ai_channels.add_ai_rtd_chan("cDAQ1Mod1/ai0", rtd_type=RTDType.PT_3750), -200431),
        (lambda task: task.ai_channels.add_ai_rtd_chan("Dev1/ai0", rtd_type=RTDType.PT_3750), None),
        # A limit over the sensitivity, or times the shunt, is volts, which must fit a range: products.toml
        (_accelerometer(100.0, limit=50.0), None),
        (on("ai_accel_chan", "cDAQ1Mod3/ai0", 5120, sensitivity=100.0, max_val=500.0, min_val=-500.0),
         -200077),
        (_accelerometer(102.3, limit=50.0), None),
        (on("ai_current_chan", "Dev1/ai0", 5120, max_val=0.02, min_val=0.004, **SHUNT), None),
        (on("ai_current_chan", "Dev1/ai0", 5120, max_val=0.1, min_val=0.0, **SHUNT), -200077),
        # daqmx, issue 3: "Sample Timing Type is set to On Demand which is not supported"; inferred code
        (on(AI, "Dsa/ai0", then="read"), -200300),
        (on(AI, "Dsa/ai0", 1000, then="read"), None),
        # Clocked lines
        (on("di_chan", "Dev1/port0/line0", 1000), None),
        (on("do_chan", "Dev1/port0/line0", 1000), -200462),  # clocked, and nothing written
        # pylibnidaqmx, issues 43 and 11: DAQmx_Val_SampClk, and "You Can Select: DAQmx_Val_OnDemand"
        (on("di_chan", "Dev1/port1/line0", 1000), -200077),
        (on("di_chan", "Bus/port0/line0", 1000), -200077),
        (on("di_chan", "Low/port0/line0", 1000), -200077),
        (on("di_chan", "Old/port0/line0", 1000, "/Old/ai/SampleClock"), -200077),
        # acq4, issue 128: the largest rate of a 6229's lines is 0; M Series manual: no clock of their own
        (on("di_chan", "M/port0/line0", 1000), -200303),
        (on("di_chan", "M/port0/line0", 1000, "OnboardClock"), -200303),
        (on("di_chan", "M/port0/line0", 1000, "/M/ai/SampleClock"), None),
        (on("di_chan", "Hs/port2/line0", 1000), None),
        # labscript-devices, capabilities.json: `supports_buffered` of a PCI-6713's port 0 is false
        (on("di_chan", "Ao/port0/line0", 1000), -200077),
        # The same file, measured: 10 MHz of a PCIe-6363, here with nothing to put out
        (_not_written(10e6), -200462),
        (_not_written(11e6), -200332),
        # Buffered counts. MathWorks, answer 41144: "an external clock must be supplied"
        (on(EDGES, "Dev1/ctr0", 1000), -200303),
        (on(EDGES, "Dev1/ctr0", 1000, "OnboardClock"), -200303),
        (on(EDGES, "Dev1/ctr0", 1000, "/Dev1/PFI1"), None),
        (on(EDGES, "cDAQ1Mod2/ctr0", 1000), None),
        # nidaqmx, `add_ci_count_edges_chan`: "a task can contain only one counter input channel"
        (on(EDGES, "M/ctr0:1", 1000, "/M/PFI1"), -200147),
        (on(EDGES, "cDAQ1Mod2/ctr0:1", 1000), None),
        # NI-DAQmx Base, text of -200745: timebase / maximum count <= frequency <= timebase / 4
        (on(PULSES, "Dev1/ctr0", freq=25e6), None),
        (on(PULSES, "Dev1/ctr0", freq=26e6), -200745),
        (on(PULSES, "M/ctr0", freq=20e6), None),
        (on(PULSES, "M/ctr0", freq=21e6), -200745),
        (on(PULSES, "Dev1/ctr0", freq=1e-5), -200745),
        (on(PULSES, "Dev1/ctr0", freq=0.0), -200077),
        (on(PULSES, "Dev1/ctr0", freq=100.0, duty_cycle=0.0), -200077),
        (on(PULSES, "Dev1/ctr0", freq=100.0, duty_cycle=1.0), -200077),
        # As of the frequency; NI's name of the code, SUITABLE_TIMEBASE_NOT_FOUND_TIME_COMBO_2
        (on("co_pulse_chan_time", "Dev1/ctr0", low_time=20e-9, high_time=20e-9), None),
        (on("co_pulse_chan_time", "Dev1/ctr0", low_time=1e-9, high_time=1e-9), -200746),
        (on("co_pulse_chan_time", "Dev1/ctr0", low_time=0.0, high_time=1e-3), -200077),
        # A timebase is a terminal: NI-DAQmx Base, text of -89120
        (_ticks("/Dev1/PFI0"), None),
        (_ticks("OnboardClock"), None),
        (_ticks("/Dev1/20MHzTimebase"), None),
        (_ticks("/Dev1/nosuch"), -89120),
        # NI's code of a value out of range; it was a traceback of the server's
        (on("ci_ang_encoder_chan", "Dev1/ctr0", pulses_per_rev=0), -200077),
        # USB-6008/6009 user guide, "Event Counter": it counts edges and does nothing else
        (on("ci_freq_chan", "Low/ctr0"), -200431),
        (on(PULSES, "Low/ctr0"), -200170),
        # NI's sentence of -200082: "Minimum is greater than or equal to the maximum"
        (on("ci_freq_chan", "Dev1/ctr0", min_val=200.0, max_val=100.0), -200082),
        # NI-DAQmx Base, text of -89131: "the source and the destination are the same terminal"
        (_triggers_itself("ai"), -89131),
        (_triggers_itself("ao"), -89131),
        # Combinations: by NI's names of the codes, unless a row says otherwise
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
        (on("ao_func_gen_chan", "Dev1/ao0"), -200432),
        (on("ao_current_chan", "Dev1/ao0", min_val=0.0, max_val=0.02), -200432),
        (on("ai_charge_chan", "Dev1/ai0"), -200431),
        # The sentence of pylibnidaqmx, issue 43, for other timings that a card has not: inferred
        (on(AI, "Dev1/ai0", "cfg_implicit_timing"), -200077),
        (on(AI, "Dev1/ai0", CHANGES, "Dev1/port0/line0"), -200077),
        (on("di_chan", "Dev1/port0/line0", "cfg_handshaking_timing"), -200077),
        (on("ci_freq_chan", "M/ctr0", 1000.0, "/M/PFI1"), -200077),
        (on(PULSES, "M/ctr0", 1000.0, "/M/PFI1"), -200077),
        (on(PULSES, "Dev1/ctr0", 1000.0), -200303),
        (on("di_chan", "Dev1/port0/line0", CHANGES, "Dev1/port0/line5"), -200926),
        (on("di_chan", "Dev1/port0", CHANGES, "Dev1/port0/line5"), None),
        (on("di_chan", "Dev1/port0", CHANGES, "port0/line0:1", "port0/line5"),
         None),  # NI's own test_timing.py
        (on("di_chan", "Dev1/port0/line0", CHANGES), -200751),
    ],
)  # fmt: skip
def test_what_a_task_is_told(task, make, right):
    assert code(lambda: make(task)) == right


def test_a_usb_6009_has_one_counter_that_puts_out_nothing(twin):
    device = System.local().devices["Low"]
    assert (len(device.ci_physical_chans), len(device.co_physical_chans)) == (1, 0)
