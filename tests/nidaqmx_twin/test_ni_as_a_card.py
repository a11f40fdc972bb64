"""What a card does, beside what the twin does: each row names NI's own statement.

K: NI knowledge base. H: NI-DAQmx help. T: a test of ni/nidaqmx-python's own suite. I: an issue or a pull
request there.
"""

import operator
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import (
    READ_ALL_AVAILABLE,
    CJCSource,
    CounterFrequencyMethod,
    Edge,
    LineGrouping,
    OverwriteMode,
    TaskMode,
    ThermocoupleType,
)
from nidaqmx.errors import DaqWarning
from nidaqmx.system import System
from nidaqmx.utils import unflatten_channel_string

from haploop.base.errors import ConfigurationError
from haploop.nidaqmx_twin import NiTwin
from tests.nidaqmx_twin.ni_client import CONTINUOUS, FINITE, clocked, code, on

CARDS = {
    "Dev1": "PCIe-6363", "M": "PCI-6221", "Old": "PCI-6034E", "cDAQ1": "cDAQ-9178", "Dsa": "PXIe-4466",
    "Bus": "USB-6211", "Low": "USB-6009", "Usb": "USB-6001",
    "Hs": "PCIe-6535", "Sup": "TS-15200", "Ieee": "NI 9234", "Eight": "PXIe-4353",
}  # fmt: skip


@pytest.fixture
def twin() -> Iterator[NiTwin]:
    with NiTwin(CARDS) as twin:
        yield twin


@pytest.fixture
def task(twin: NiTwin) -> Iterator[nidaqmx.Task]:
    with nidaqmx.Task() as task:
        yield task


# Names: H "Channel Name Generation"; I 579; T test_di_channel.py


@pytest.mark.parametrize(
    ("terminals", "assigned", "names"),
    [
        ("Dev1/ai0:7", "foo31", [f"foo{i}" for i in range(31, 39)]),
        ("Dev1/ai0:1", "foo 123", ["foo123", "foo124"]),
        ("Dev1/ai0:7", "a0:3, b", ["a0", "a1", "a2", "a3", "b0", "b1", "b2", "b3"]),
        ("Dev1/ai0:2", "fx,fy,fz", ["fx", "fy", "fz"]),
        ("Dev1/ai0:2", "force", ["force0", "force1", "force2"]),
        ("Dev1/ai0:3", "myChan09", ["myChan09", "myChan10", "myChan11", "myChan12"]),
        ("Dev1/ai0", "one", ["one"]),
        ("Dev1/ai0:1", "left hand, x", ["left hand", "x"]),
        ("Dev1/ao0:1", "patch,aux", ["patch", "aux"]),
        ("Dev1/ctr0:1", "wheel7", ["wheel7", "wheel8"]),
        ("Dev1/port0/line0:2", "d0:9", ["d0", "d1", "d2"]),
        ("Dev1/port0/line0:7", "a0:6, b, c", ["a0", "a1", "a2", "a3", "a4", "a5", "a6", "b"]),
    ],
)
def test_names_of_several_channels(task, terminals, assigned, names):
    add = {
        "ai": lambda: task.ai_channels.add_ai_voltage_chan(terminals, assigned),
        "ao": lambda: task.ao_channels.add_ao_voltage_chan(terminals, assigned),
        "ct": lambda: task.ci_channels.add_ci_count_edges_chan(terminals, assigned),
        "po": lambda: task.di_channels.add_di_chan(terminals, assigned, LineGrouping.CHAN_PER_LINE),
    }[terminals.partition("/")[2][:2]]
    channel = add()
    assert task.channel_names == names
    assert unflatten_channel_string(channel.name) == names, "the object that is made has them too (I 579)"
    if terminals.startswith("Dev1/ai"):
        task.timing.cfg_samp_clk_timing(1000, samps_per_chan=10)
        assert np.shape(task.read(10)) == ((len(names), 10) if len(names) > 1 else (10,))


@pytest.mark.parametrize("wrong", ["Dev1/ai0:", "Dev1/ai:3", "Dev1/ai0:ao3"])
def test_a_range_that_is_none(twin, wrong):
    """nidaqmx, `utils.py`."""
    with nidaqmx.Task() as task:
        assert code(lambda: task.ai_channels.add_ai_voltage_chan(wrong)) == -200498
        assert code(lambda: task.ai_channels.add_ai_voltage_chan("Dev1/ai0", wrong)) == -200498
    with pytest.raises(ConfigurationError, match="range"):
        twin.set(wrong, 1.0)


# Rates: K kA00Z000000P83OSAS (AI rounds the divisor down), K kA00Z000000P6FrSAK (delta-sigma goes up)


@pytest.mark.parametrize(
    ("terminal", "asked", "rate_hz"),
    [
        ("Dev1/ai0", 44_100, 100e6 / 2267),
        ("Dev1/ao0", 44_100, 100e6 / 2268),
        ("Dev1/ai0", 17_545, 100e6 / 5699),
        ("Dev1/port0/line0", 17_545, 100e6 / 5700),
        ("Old/ai0", 17_545, 20e6 / 1139),
        ("Dev1/ai0", 1000, 1000.0),
        ("Ieee/ai0", 500, 51_200 / 31),
        ("Ieee/ai0", 12_000, 12_800.0),
    ],
)
def test_a_rate_is_rounded_as_the_driver_rounds(task, terminal, asked, rate_hz):
    if "/ai" in terminal:
        task.ai_channels.add_ai_voltage_chan(terminal, min_val=-5, max_val=5)
    elif "/ao" in terminal:
        task.ao_channels.add_ao_voltage_chan(terminal)
    else:
        task.di_channels.add_di_chan(terminal)
    task.timing.cfg_samp_clk_timing(asked, samps_per_chan=100)
    assert task.timing.samp_clk_rate == pytest.approx(rate_hz, rel=1e-9)
    task.control(TaskMode.TASK_VERIFY)


@pytest.mark.parametrize("asked", [0, -5, float("nan"), float("inf")])
def test_a_rate_that_is_none_is_refused_at_once(task, asked):
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    assert code(lambda: task.timing.cfg_samp_clk_timing(asked)) == -200077
    task.timing.cfg_samp_clk_timing(1000)
    assert code(lambda: setattr(task.timing, "samp_clk_rate", asked)) == -200077
    assert task.timing.samp_clk_rate == 1000


@pytest.mark.parametrize(
    ("channels", "warned", "refused"), [(2, None, None), (3, 200011, None), (5, None, -200332)]
)
def test_too_fast_to_settle_is_a_warning(twin, channels, warned, refused):
    """500 kS/s a channel of a card of 1 MS/s together and 2 MS/s alone (RATE_VIOLATES_SETTLING_TIME)."""
    with nidaqmx.Task() as task, warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        clocked(task, f"Dev1/ai0:{channels - 1}", 500e3, samps_per_chan=10)
        assert code(task.start) == refused
    codes = [one.message.error_code for one in told if isinstance(one.message, DaqWarning)]
    assert codes == ([warned] if warned else [])


# Tasks


def test_two_tasks_of_one_name(twin):
    """T test_task.py and test_persisted_task.py: DUPLICATE_TASK; the first one goes on."""
    with nidaqmx.Task("press") as first:
        first.ai_channels.add_ai_voltage_chan("Dev1/ai0")
        assert code(lambda: nidaqmx.Task("press")) == -200089
        assert isinstance(first.read(), float)
        first.save("saved")
    with System.local().tasks["saved"].load() as loaded:
        assert code(System.local().tasks["saved"].load) == -200089
        assert isinstance(loaded.read(), float)
    with nidaqmx.Task("press"):
        pass


@pytest.mark.parametrize(
    ("refused", "right"),
    [
        (lambda task: task.ai_channels["nope"].ai_max, -200486),
        (lambda task: task.ao_channels.add_ao_voltage_chan("Dev1/ao0"), -200559),
        (lambda task: task.ai_channels.add_ai_voltage_chan("Dev1/ai1:2", "one, ai"), -200489),
    ],
)
def test_errors_by_name(task, refused, right):
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0", "ai")
    assert code(lambda: refused(task)) == right
    assert task.channel_names == ["ai"], "a refused call adds nothing"


@pytest.mark.parametrize(
    "configured",
    [
        lambda task: task.timing.cfg_samp_clk_timing(1000),
        lambda task: task.timing.cfg_implicit_timing(),
        lambda task: task.timing.cfg_change_detection_timing("Dev1/port0/line0"),
        lambda task: task.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/PFI0"),
    ],
)
def test_a_task_without_channels_has_no_timing(task, configured):
    """WaveSurfer's Task.m: "Attempt to get property before channels are added" is -200478."""
    assert code(lambda: configured(task)) == -200478
    task.di_channels.add_di_chan("Dev1/port0/line0")
    assert code(lambda: configured(task)) is None


@pytest.mark.parametrize(
    ("terminal", "right"),
    [
        ("/Dev1/PFI15", None),
        ("/Dev1/PFI16", -89120),
        ("/M/PFI99", -89120),
        ("/Old/PFI9", None),
        ("/Old/PFI10", -89120),
        ("/Bus/PFI7", None),
        ("/Bus/PFI8", -89120),
        ("/Low/PFI0", None),
        ("/Low/PFI1", -89120),
        ("/Usb/PFI1", None),
        ("/Usb/PFI2", -89120),
        ("/Dev1/RTSI7", None),
        ("/Dev1/RTSI8", -89120),
        ("/Bus/RTSI0", -89120),
        ("/Dev1/PXI_Trig0", -89120),
        ("/Dev1/Ctr4InternalOutput", -89120),
    ],
)
def test_a_terminal_is_one_of_the_products_own(twin, terminal, right):
    """How many PFI lines: the products' rows, each with its source."""
    device = terminal.split("/")[1]
    with nidaqmx.Task() as task:
        clocked(task, f"{device}/ai0", 1000, samps_per_chan=10)
        task.triggers.start_trigger.cfg_dig_edge_start_trig(terminal)
        assert code(task.start) == right
    known = [name for name in System.local().devices[device].terminals if "/PFI" in name]
    assert "/PFI" not in terminal or (terminal in known) == (right is None)


@pytest.mark.parametrize(
    ("add", "name", "terminal", "right"),
    [
        ("ci_channels.add_ci_count_edges_chan", "ci_count_edges_term", "/Dev1/PFI15", None),
        ("ci_channels.add_ci_count_edges_chan", "ci_count_edges_term", "/Dev1/PFI99", -89120),
        ("ci_channels.add_ci_freq_chan", "ci_freq_term", "/Dev1/PFI16", -89120),
        ("co_channels.add_co_pulse_chan_freq", "co_pulse_term", "PFI3", None),
        ("co_channels.add_co_pulse_chan_freq", "co_pulse_term", "/Dev1/PFI99", -89121),
        ("ci_channels.add_ci_count_edges_chan", "ci_count_edges_term", "/Bus/PFI3", None),
        ("ci_channels.add_ci_count_edges_chan", "ci_count_edges_term", "/Bus/PFI4", -89136),
        ("co_channels.add_co_pulse_chan_freq", "co_pulse_term", "/Bus/PFI4", None),
        ("co_channels.add_co_pulse_chan_freq", "co_pulse_term", "/Bus/PFI0", -89136),
    ],
)
def test_a_counters_terminal_too(task, add, name, terminal, right):
    """PFI 0 to 3 of a USB-6211 are inputs, 4 to 7 outputs: H "Bus-Powered M Series Physical Channels"."""
    device = terminal.split("/")[1] if "/" in terminal else "Dev1"
    setattr(operator.attrgetter(add)(task)(f"{device}/ctr0"), name, terminal)
    assert code(task.start) == right


@pytest.mark.parametrize(
    ("make", "right"),
    [
        (on("ai_voltage_chan", "Dev1/ai0", 1000, "PFI99"), -89120),
        (on("ai_voltage_chan", "Dev1/ai0", 1000, "/Dev1/PFI99"), -89120),
        # nidaqwrapper's tests on NI's simulated devices make such a channel
        (on("ai_voltage_chan", "Dev1/ai0", min_val=10.0, max_val=-10.0), -200082),
        # I 448; USB-6008/6009 user guide, "Event Counter"
        (on("ci_count_edges_chan", "Low/ctr0", edge=Edge.RISING), -200077),
        (on("ci_count_edges_chan", "Low/ctr0", edge=Edge.FALLING), None),
        # A cold junction needs a sensor
        (on("ai_thrmcpl_chan", "Dev1/ai0", cjc_source=CJCSource.BUILT_IN), -200576),
        (on("ai_thrmcpl_chan", "Eight/ai0", cjc_source=CJCSource.BUILT_IN), None),
    ],
)
def test_what_is_refused_at_the_start(task, make, right):
    assert code(lambda: make(task)) == right


TWO_COUNTERS = {"meas_method": CounterFrequencyMethod.HIGH_FREQUENCY_2_COUNTERS, "meas_time": 0.05}


@pytest.mark.parametrize(
    ("add", "counter", "words", "terminal"),
    [
        # H "Connecting Counter Signals", CompactDAQ, of modules with 8 and with 4 lines
        ("count_edges", "cDAQ1Mod1/ctr0", {}, "/cDAQ1Mod1/PFI0"),
        ("count_edges", "cDAQ1Mod1/ctr1", {}, "/cDAQ1Mod1/PFI4"),
        ("count_edges", "cDAQ1Mod1/ctr2", {}, "/cDAQ1Mod1/PFI3"),
        ("pulse_width", "cDAQ1Mod1/ctr3", {}, "/cDAQ1Mod1/PFI6"),
        ("freq", "cDAQ1Mod1/ctr1", {}, "/cDAQ1Mod1/PFI5"),
        ("freq", "cDAQ1Mod1/ctr1", TWO_COUNTERS, "/cDAQ1Mod1/PFI4"),
        ("count_edges", "cDAQ1Mod2/ctr1", {}, "/cDAQ1Mod2/PFI3"),
        ("period", "cDAQ1Mod2/ctr2", {}, "/cDAQ1Mod2/PFI3"),
        # X Series manual, chapter 7
        ("count_edges", "Dev1/ctr0", {}, "/Dev1/PFI8"),
        ("freq", "Dev1/ctr0", {}, "/Dev1/PFI9"),
        ("freq", "Dev1/ctr0", TWO_COUNTERS, "/Dev1/PFI8"),
        # USB-6008/6009 user guide, "Event Counter"
        ("count_edges", "Low/ctr0", {"edge": Edge.FALLING}, "/Low/PFI0"),
        # No source was found: a twin that guesses would count nothing, and say so to nobody.
        ("count_edges", "Bus/ctr0", {}, None),
        ("count_edges", "Usb/ctr0", {}, None),
    ],
)
def test_where_a_counter_measures_by_default(add, counter, words, terminal):
    cards = {**CARDS, "cDAQ1": "cDAQ-9178", "cDAQ1Mod1": "NI 9401", "cDAQ1Mod2": "NI 9402"}
    with NiTwin(cards) as twin, nidaqmx.Task() as task:
        channel = getattr(task.ci_channels, f"add_ci_{add}_chan")(counter, **words)
        name = f"ci_{add}_term"
        if terminal is None:
            assert code(lambda: getattr(channel, name)) == -200197
            assert task.read() == 0, "as of any counter to which nothing is connected"
            twin.set(f"{counter.partition('/')[0]}/PFI0", 1)
            assert code(task.read) == -200197
            task.stop()
            setattr(channel, name, "PFI0")
            assert code(task.read) is None
            return
        assert getattr(channel, name) == terminal
        twin.set(terminal, lambda times: ((times * 100) % 1 < 0.5).astype(float))
        task.start()
        time.sleep(0.105)
        period = 1 / 200 if add == "pulse_width" else 1 / 100
        right = {"count_edges": 10, "freq": 100}.get(add, period)
        assert task.read() == pytest.approx(right, rel=1e-3 if add != "count_edges" else 0.1)


@pytest.mark.parametrize(("size", "right"), [(0, -200608), (100, None)])
def test_an_acquisition_needs_a_buffer(task, size, right):
    """NI's sentence of the code: "the selected buffer size is too small"."""
    clocked(task, "Dev1/ai0", 1000, samps_per_chan=100)
    task.in_stream.input_buf_size = size
    assert code(task.start) == right


@pytest.mark.parametrize(
    ("size", "samples", "right"),
    [(0, 10, -200859), (1, 10, -200609), (None, 1, -200609), (2, 2, None), (None, 2, None)],
)
def test_an_output_buffer_holds_two_samples(task, size, samples, right):
    """NI's names of the codes; storm-control issue 113: "Minimum Supported Value 2"."""
    clocked(task, "Dev1/ao0", 1000, sample_mode=CONTINUOUS)
    if size is not None:
        task.out_stream.output_buf_size = size
    task.write([0.0] * samples, auto_start=False)
    assert code(task.start) == right


# Signals from outside


def test_a_start_trigger_that_is_driven_is_waited_for(twin, task):
    twin.set("Dev1/PFI3", lambda times: (times > 0.5) * 1.0)
    twin.set("Dev1/ai0", lambda times: times)
    clocked(task, "Dev1/ai0", 1000, samps_per_chan=100)
    task.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/PFI3")
    task.start()
    assert task.in_stream.total_samp_per_chan_acquired == 0
    assert code(lambda: task.read(100, timeout=0.1)) == -200284
    assert task.read(100)[0] == pytest.approx(0.5, abs=1e-3)
    assert twin.now < 0.7


def test_a_clock_that_is_driven_times_the_samples_and_outputs_are_not_clocked_in_silence(twin, task):
    twin.set("Dev1/PFI5", lambda times: np.floor(40 * times) % 2)  # 20 rising edges a second
    twin.set("Dev1/ai0", lambda times: times)
    clocked(task, "Dev1/ai0", 1000, source="/Dev1/PFI5", samps_per_chan=10)
    assert np.diff(task.read(10)) == pytest.approx(0.05, abs=1e-3)
    with nidaqmx.Task() as out:
        clocked(out, "Dev1/ao0", 1000, source="/Dev1/PFI5", samps_per_chan=10)
        assert code(lambda: out.write([0.0] * 10, auto_start=True)) == -200197


def test_a_counter_puts_out_where_it_is_told_and_can_be_looked_at(twin):
    with nidaqmx.Task() as pulses, nidaqmx.Task() as count:
        channel = pulses.co_channels.add_co_pulse_chan_freq("Dev1/ctr0", freq=1000.0)
        assert channel.co_pulse_term == "/Dev1/PFI12"
        channel.co_pulse_term = "/Dev1/PFI5"
        pulses.timing.cfg_implicit_timing(FINITE, 50)
        edges = count.ci_channels.add_ci_count_edges_chan("Dev1/ctr1")
        edges.ci_count_edges_term = "/Dev1/PFI5"
        count.start()
        pulses.start()
        pulses.wait_until_done()
        assert count.read() == 50
    for name in ("Dev1/ctr0", "Dev1/PFI5"):
        put = twin.put(name)
        assert (put.values == 1).sum() == 50 and np.diff(put.times) == pytest.approx(5e-4)
    assert not len(twin.put("Dev1/PFI12").values)


@pytest.mark.parametrize("terminal", ["/Dev1/Ctr0InternalOutput", "Ctr0InternalOutput", "PFI12"])
def test_a_counter_measures_another_by_any_name(twin, terminal):
    with nidaqmx.Task() as pulses, nidaqmx.Task() as measure:
        pulses.co_channels.add_co_pulse_chan_freq("Dev1/ctr0", freq=10_000.0)
        pulses.timing.cfg_implicit_timing(CONTINUOUS)
        pulses.start()
        measure.ci_channels.add_ci_pulse_chan_freq("Dev1/ctr1").ci_pulse_freq_term = terminal
        measure.start()
        assert measure.read().freq == pytest.approx(10_000)


# Chassis: I 162, I 589


@pytest.fixture
def chassis(tmp_path: Path) -> Iterator[NiTwin]:
    (tmp_path / "cards.ini").write_text(
        "[DAQmxCDAQChassis cDAQ1]\nProductType = cDAQ-9178\nDevIsSimulated = 1\n"
        + "".join(
            f"[DAQmxCDAQModule cDAQ1Mod{slot}]\nProductType = {product}\nDevIsSimulated = 1\n"
            f"CompactDAQ.ChassisDevName = cDAQ1\nCompactDAQ.SlotNum = {slot}\n"
            for slot, product in enumerate(("NI 9215", "NI 9263"), 1)
        ),
        encoding="utf-8",
    )
    with NiTwin(tmp_path / "cards.ini") as twin:
        yield twin


def test_triggers_of_a_chassis(chassis):
    with nidaqmx.Task() as read, nidaqmx.Task() as play:
        clocked(read, "cDAQ1Mod1/ai0", 1000, samps_per_chan=100)
        clocked(play, "cDAQ1Mod2/ao0", 1000, samps_per_chan=100)
        assert code(lambda: read.triggers.start_trigger.term) == -200983
        read.control(TaskMode.TASK_RESERVE)
        terminal = read.triggers.start_trigger.term
        assert terminal == "/cDAQ1/ai/StartTrigger"
        play.triggers.start_trigger.cfg_dig_edge_start_trig("ai/StartTrigger")
        play.write([1.0] * 100, auto_start=False)
        assert code(play.start) == -89120, "a module has no such terminal"
        play.triggers.start_trigger.cfg_dig_edge_start_trig(terminal)
        play.start()
        assert not play.is_task_done()
        read.read(100)
        play.wait_until_done()


# Buffers and others


def test_no_more_than_the_buffer_holds(twin, task):
    twin.set("Dev1/ai0", lambda times: times)
    clocked(task, "Dev1/ai0", 1000, sample_mode=CONTINUOUS)
    task.in_stream.input_buf_size = 100
    task.in_stream.overwrite = OverwriteMode.OVERWRITE_UNREAD_SAMPLES
    task.start()
    time.sleep(3)
    newest = task.read(READ_ALL_AVAILABLE)
    assert len(newest) == 100 and newest[-1] == pytest.approx(3, abs=0.02)


def test_a_new_task_takes_new_samples(twin):
    twin.set("Dev1/ai0", 1.0)

    def poll(terminal):
        with nidaqmx.Task() as task:
            task.ai_channels.add_ai_voltage_chan(terminal)
            return float(task.read())

    for terminal in ("Dev1/ai0", "Dev1/ai1"):
        assert len({poll(terminal) for _ in range(8)}) > 2


@pytest.mark.parametrize(("enabled", "right"), [(False, (np.nan, np.nan)), (True, (1.0, 0.03))])
def test_a_supply_that_is_off_reads_no_number(task, enabled, right):
    """T TestPowerRead."""
    task.ai_channels.add_ai_power_chan("Sup/power", 1.0, 0.03, enabled)
    task.start()
    read = task.read()
    assert (read.voltage, read.current) == pytest.approx(right, nan_ok=True)


@pytest.mark.parametrize(("device", "told"), [("Dev1", "/Dev1/PFI5"), ("Hs", "PFI5")])
def test_a_clock_source_reads_back(task, device, told):
    """T test_timing_properties.py of a 6363, T test_timing.py of a 6535."""
    clocked(task, f"{device}/port0/line0", 1000, source="PFI5", active_edge=Edge.RISING)
    assert task.timing.samp_clk_src == told


def test_a_microphone_has_a_range(task):
    """94 dB are 1 Pa rms: 1.41 Pa at 50 mV/Pa are 71 mV."""
    channel = task.ai_channels.add_ai_microphone_chan("Dsa/ai0", mic_sensitivity=50, max_snd_press_level=94)
    assert channel.ai_max >= np.sqrt(2) and channel.ai_min == -channel.ai_max


def bits(*fields: tuple[int, int]) -> bytes:
    """A virtual TEDS file of (number, bits): a byte for a bit, after NI's head of 40."""
    return bytes(40) + bytes(number >> place & 1 for number, count in fields for place in range(count))


@pytest.mark.parametrize(
    ("fields", "add", "right"),
    [
        ([(25, 8), (0, 1), (0, 1), (53735, 16)], "accel", ("ai_accel_sensitivity", 49.03)),
        ([(25, 8), (1, 1), (0, 1), (29270, 16)], "force_iepe", ("ai_force_iepe_sensor_sensitivity", 3.25)),
        ([(27, 8), (0, 1), (61036, 16)], "microphone", ("ai_microphone_sensitivity", 1999.81)),
        ([(36, 8), (223, 11), (473, 11), (0, 14), (3, 4)], "thrmcpl",
         ("ai_thrmcpl_type", ThermocoupleType.K)),
    ],
)  # fmt: skip
def test_a_sensor_tells_what_it_is(task, tmp_path, fields, add, right):
    """T test_ai_channel.py, add_teds_ai_..._chan; the numbers are those in NI's own files."""
    (tmp_path / "sensor.ted").write_bytes(bits((0, 64), (0, 2), *fields, (0, 64)))
    device = "Eight" if add == "thrmcpl" else "Dsa"
    physical = System.local().devices[device].ai_physical_chans[0]
    physical.configure_teds(str(tmp_path / "sensor.ted"))
    more = {"max_snd_press_level": 94.0} if add == "microphone" else {}
    channel = getattr(task.ai_channels, f"add_teds_ai_{add}_chan")(f"{device}/ai0", **more)
    assert getattr(channel, right[0]) == pytest.approx(right[1], abs=0.01)


def test_a_log_lies_in_the_folder_of_the_program(twin, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with nidaqmx.Task() as task:
        clocked(task, "Dev1/ai0", 1000, samps_per_chan=10)
        task.in_stream.configure_logging("run.tdms", nidaqmx.constants.LoggingMode.LOG_AND_READ)
        task.read(10)
        assert task.in_stream.logging_file_path == Path("run.tdms")
    assert (tmp_path / "run.tdms").stat().st_size > 100
