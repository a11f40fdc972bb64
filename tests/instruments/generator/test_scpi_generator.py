"""The generator role on both families, reached by calls; and one by VISA through a socket."""

import gc
import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from haploop.base.arrays import FloatArray
from haploop.base.clock import VirtualClock
from haploop.base.errors import ConfigurationError, InstrumentError, LimitError
from haploop.instruments import Arbitrary, Burst, Sweep, Waveform
from haploop.instruments.conformance import bypass_interlock
from haploop.instruments.generator.scpi_generator import Dg1000z, Keysight33500, ScpiGenerator
from haploop.mocks.generator import DG1000Z, KEYSIGHT_33500, Box, Product
from haploop.mocks.transport import DirectLine, LineServer, ReplyFault
from haploop.nidaqmx_twin.nodes import Run, Source
from tests.raising import raises

FAMILIES = {"keysight": (Keysight33500, KEYSIGHT_33500), "rigol": (Dg1000z, DG1000Z)}


class Bench:
    """A plant that is nothing but an open input, whose volts are remembered."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.runs: list[Run] = []
        self._source: Source | None = None

    def drive(self, node: str, source: Source) -> None:
        assert node == "amplifier"
        self._source = source

    def advance(self, until: float) -> None:
        if self._source:
            self.runs.extend(self._source.take(until))

    def volts(self, start: float, stop: float) -> FloatArray:
        """Steps of 20 us from `start` to `stop` (s), which may be now at the latest."""
        self.advance(self.clock.now())
        times = np.arange(start, stop, 20e-6) + 1e-6
        out = np.zeros(len(times))
        for run in self.runs:
            index = np.floor((times - run.start) / run.period + 1e-6).astype(int)
            here = index >= 0
            out[here] = run.values[np.minimum(index[here], len(run.values) - 1)]
        return out


def settings(**changes: object) -> ScpiGenerator.Settings:
    basic = {"resource": "TCPIP::127.0.0.1::5025::SOCKET", "output": "amplifier", "timeout": 0.2}
    return ScpiGenerator.Settings.model_validate(basic | changes)


@dataclass
class Setup:
    bench: Bench
    box: Box
    open: Callable[..., ScpiGenerator]

    def tell(self, *commands: str) -> str:
        """What the box answers at its front, past the driver."""
        return "".join(line for command in commands for line in self.box.answer(command))


@pytest.fixture(params=FAMILIES)
def setup(request: pytest.FixtureRequest) -> Setup:
    driver, product = FAMILIES[request.param]
    bench = Bench()
    box = Box(product, bench, "amplifier")

    def opened(**changes: object) -> ScpiGenerator:
        generator = driver(settings(**changes), bench.clock, DirectLine(box.answer))
        bypass_interlock(generator)
        return generator

    return Setup(bench, box, opened)


def test_opening_changes_nothing(setup):
    setup.tell("OUTP ON", "FREQ 263.5", "VOLT 1")
    generator = setup.open()
    assert generator.is_on
    assert float(setup.tell("FREQ?")) == 263.5
    assert generator.load == 50
    assert generator.amplitude == pytest.approx(0.5)
    assert generator.identity.split()[2] in ("33522B", "DG1062Z")


SWEEP = Sweep(start_hz=20, stop_hz=625, duration=0.5, amplitude=0.8)
BURST = Burst(263.5, 20, 0.5)
PULSES = Arbitrary([0, 0, 0.2, 0.8, 0.4, 0, -0.4, -0.8, -0.2, 0], 5000)


def test_each_waveform_is_played_once_with_its_trigger_whatever_was_played_before(setup):
    generator, bench = setup.open(), setup.bench
    kinds: list[Waveform] = [SWEEP, BURST, BURST, SWEEP]
    if isinstance(generator, Keysight33500):
        kinds += [PULSES, PULSES, SWEEP, PULSES, BURST]
    else:
        with pytest.raises(ConfigurationError, match=r"DG1062Z .* does not play Arbitrary: .* Sweep, Burst"):
            generator.configure(PULSES)
    for waveform in kinds:
        generator.configure(waveform)
        assert generator.load == math.inf
        assert generator.amplitude == pytest.approx(waveform.amplitude)
        generator.arm()
        begin = bench.clock.now()
        bench.clock.sleep(0.2)
        assert not generator.is_on
        start = bench.clock.now()
        generator.trigger()
        bench.clock.sleep(waveform.duration + 0.3)
        assert generator.is_on
        generator.off()
        bench.clock.sleep(0.1)
        assert not bench.volts(begin, start).any()
        # A sweep goes on at its start frequency until it is switched off.
        samples, rate_hz = waveform.sampled(0.3)
        end = waveform.duration + 0.3 * waveform.goes_on
        times = np.arange(0, end, 20e-6)
        expected = (
            samples[np.floor(times * rate_hz + 1e-6).astype(int)]
            if isinstance(waveform, Arbitrary)
            else np.interp(times, np.arange(len(samples)) / rate_hz, samples)
        )
        played = bench.volts(start, start + end)[: len(times)]
        np.testing.assert_allclose(played, expected, atol=2e-3 * waveform.amplitude)
        after = bench.volts(start + end + 40e-6, bench.clock.now())
        assert len(after) and not after.any()
    assert generator.errors() == ()


def test_the_load_halves_or_doubles_the_volts(setup):
    generator = setup.open(load=50)
    generator.configure(SWEEP)
    assert generator.load == 50
    assert generator.amplitude == pytest.approx(0.8), "as the instrument sees it"
    generator.arm()
    generator.trigger()
    begin = setup.bench.clock.now()
    setup.bench.clock.sleep(1)
    assert np.abs(setup.bench.volts(begin, begin + 1)).max() == pytest.approx(1.6, rel=1e-3)


@pytest.mark.parametrize("mode", ["BURS", "SWE", "AM", "FM"])
def test_configuring_switches_the_output_off_first(setup, mode):
    setup.tell("OUTP1 ON", "VOLT:OFFS 4", f"{mode}:STAT ON")
    generator = setup.open()
    generator.configure(SWEEP)
    assert not generator.is_on
    assert float(setup.tell("VOLT:OFFS?")) == 0
    assert setup.tell(f"FUNC?;:{mode}:STAT?") in ("SIN;0", "SIN;OFF")


def test_more_volts_than_the_rig_allows_are_refused_before_anything_is_sent(setup):
    generator = setup.open()
    setup.tell("OUTP ON")
    with pytest.raises(LimitError, match=r"1.2 V peak was refused: 'highest' in \[generator\] is 1 V"):
        generator.configure(Sweep(1, 625, 2, 1.2))
    assert generator.is_on


def test_the_instruments_own_words_for_what_it_refuses(setup):
    generator = setup.open(highest=50)
    with pytest.raises(
        InstrumentError, match=r"refused a setting: -222 Data out of range; value clipped to upper"
    ):
        generator.configure(Sweep(1, 625, 2, 20))
    raises(ConfigurationError, "no waveform to arm", generator.arm)
    raises(InstrumentError, "-222", generator.configure, Sweep(1, 625, 1000, 0.5))


def test_errors_of_somebody_else_are_not_blamed_on_the_sweep(setup):
    setup.tell("NONSENSE 1")
    generator = setup.open()
    generator.configure(SWEEP)
    setup.tell("NONSENSE 1", "FREQ banana")
    assert generator.errors() == ("-113 Undefined header", "-104 Data type error")
    assert generator.errors() == ()


@pytest.mark.parametrize(("act", "error", "says"), [
    (lambda _, generator: generator.off(), ConfigurationError, r"not armed|no waveform to play"),
    (lambda setup, _: setup.tell("SWE:STAT OFF"), InstrumentError, "its waveform: -211 Trigger ignored"),
], ids=["switched off", "trigger ignored"])  # fmt: skip
def test_a_sweep_that_does_not_start_leaves_the_output_off(setup, act, error, says):
    generator = setup.open()
    generator.configure(SWEEP)
    generator.arm()
    act(setup, generator)
    raises(error, says, generator.trigger)
    assert not generator.is_on


class Deaf(Box):
    """An instrument that passes over some commands without a word."""

    def __init__(self, product: Product, plant: Bench, deaf: str) -> None:
        super().__init__(product, plant, "amplifier")
        answer = self.answer
        self.answer = lambda line: [] if deaf in line and "?" not in line else answer(line)


def deaf_to(words: str, family: str, *said: str) -> ScpiGenerator:
    driver, product = FAMILIES[family]
    bench = Bench()
    box = Deaf(product, bench, words)
    for line in said:
        box.answer(line)
    generator = driver(settings(), bench.clock, DirectLine(box.answer))
    bypass_interlock(generator)
    return generator


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(("deaf", "sentence"), [
    ("LOAD", r"given inf for load but reads 50"),
    ("VOLT ", r"given 1.6 for peak_to_peak but reads"),
    ("FREQ:STOP", r"given 625 for stop_hz but reads 1000"),
    ("SWE:TIME", r"given 0.5 for duration but reads 1"),
])  # fmt: skip
def test_a_setting_that_was_not_taken_is_read_back(family, deaf, sentence):
    raises(InstrumentError, sentence, deaf_to(deaf, family).configure, SWEEP)


@pytest.mark.parametrize("family", FAMILIES)
def test_an_output_that_stays_on_is_said(family):
    with pytest.raises(InstrumentError, match="switch its output off but reads on: switch it off by hand"):
        deaf_to("OFF", family, "OUTP1 ON").off()


@pytest.fixture
def served() -> Iterator[tuple[LineServer, Keysight33500]]:
    """A generator that pyvisa reaches through a socket."""
    bench = Bench()
    with LineServer(Box(KEYSIGHT_33500, bench, "amplifier").answer) as server:
        resource = f"TCPIP::127.0.0.1::{server.port}::SOCKET"
        generator = Keysight33500.open(settings(resource=resource, visa="@py"), bench.clock)
        yield server, generator
        generator.close()


@pytest.mark.parametrize(("kind", "says"), [
    ("silence", r"(did not answer|was lost after) 'OUTP1\?'"),
    ("garbled", r"answered 'OUTP1\?' with .* which is no text"),
    ("truncated", r"'OUTP1\?'"),
    ("disconnect", r"'OUTP1\?'"),
])  # fmt: skip
def test_a_fault_of_the_line_passes(served, kind, says):
    server, generator = served
    fault = ReplyFault(kind, asked="OUTP1?", times=1)
    server.faults.append(fault)
    with pytest.raises(InstrumentError, match=rf"^The generator at TCPIP::\S+ .*{says}"):
        assert generator.is_on
    assert fault.fired == 1
    assert not generator.is_on, "the next question opens a new connection"


def test_a_late_answer_is_not_taken_for_the_next_one(served):
    server, generator = served
    server.faults.append(ReplyFault("delay", asked="VOLT?", times=1, delay=0.25))
    with pytest.raises(InstrumentError, match="did not answer"):
        generator.amplitude  # noqa: B018
    assert generator.load == 50
    server.close()
    for _ in range(2):
        raises(InstrumentError, r"^The generator at TCPIP::", generator.off)


@pytest.mark.parametrize(
    "resource", ["TCPIP::127.0.0.1::1::SOCKET", "nonsense", "TCPIP::no.such.host.invalid::5025::SOCKET"]
)
def test_no_such_resource_is_one_sentence(resource):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # pyvisa-py forgets its socket then
        with pytest.raises(InstrumentError, match=rf"^The generator at {resource} cannot be "):
            Keysight33500.open(settings(resource=resource, visa="@py"), VirtualClock())
        gc.collect()


@pytest.mark.parametrize(("kind", "figures", "told"), [
    (Sweep, (0, 625, 20, 1), "cannot be played"),
    (Sweep, (10, 10, 1, 1), "cannot be played"),
    (Sweep, (1, 625, 0, 1), "cannot be played"),
    (Sweep, (1, math.inf, 1, 1), "cannot be played"),
    (Sweep, (1, 1e9, 1, 1), "too long to be judged"),
    (Burst, (0, 5, 1), "cannot be played"),
    (Burst, (math.inf, 5, 1), "cannot be played"),
    (Burst, (100, 0, 1), "cannot be played"),
    (Burst, (100, 2.5, 1), "cannot be played"),
    (Burst, (100, 5, 0), "cannot be played"),
    (Burst, (100, 5, math.nan), "cannot be played"),
    (Burst, (1e7, 10**8, 1), "too long to be judged"),
    (Arbitrary, ([0, 1], 1000), "three samples"),
    (Arbitrary, ([[0, 1, 0]], 1000), "one row"),
    (Arbitrary, ([0, math.nan, 0], 1000), "finite"),
    (Arbitrary, ([0, 0, 0], 1000), "not all 0 V"),
    (Arbitrary, ([0, 1, 0], 0), "0 samples/s"),
    (Arbitrary, ([0, 1, 0], math.nan), "nan samples/s"),
    (Arbitrary, ([1, 0, 0], 1000), "this one at 1 and 0 V"),
    (Arbitrary, ([0, 1, -1], 1000), "this one at 0 and -1 V"),
    (Arbitrary, ([0, 1, 0], 1e-6), "too long to be judged"),
])  # fmt: skip
def test_what_no_generator_plays(kind, figures, told):
    raises(ConfigurationError, told, kind, *figures)


def test_a_waveform_states_its_volts_duration_and_duty():
    assert (SWEEP.amplitude, SWEEP.duration, SWEEP.duty) == (0.8, 0.5, 1)
    burst = Burst(200, 10, 3)
    assert (burst.amplitude, burst.duration, burst.duty) == (3, 0.05, 1)
    assert (PULSES.amplitude, PULSES.duration, PULSES.duty) == (0.8, 0.002, 0.7)
    volts = np.array([0.0, -2.0, 1.0, 0.0])
    kept = Arbitrary(volts, 10)
    volts[:] = 400
    assert kept.amplitude == 2 and kept == Arbitrary((0, -2, 1, 0), 10)
    assert kept.scaled(3) == Arbitrary((0, -6, 3, 0), 10)
