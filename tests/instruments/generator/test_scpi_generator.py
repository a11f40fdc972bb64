"""The generator role on both families: the same scenario on the twins and by VISA through a socket."""

from __future__ import annotations

import gc
import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from haploop.instruments import (
    Arbitrary,
    Burst,
    ConfigurationError,
    InstrumentError,
    LimitError,
    Sweep,
    Waveform,
    load_rig_file,
)
from haploop.instruments.arrays import FloatArray
from haploop.instruments.conformance import bypass_interlock
from haploop.instruments.generator.scpi_generator import Dg1000z, Keysight33500, ScpiGenerator
from haploop.mocks.clock import VirtualClock
from haploop.mocks.generator import DG1000Z, KEYSIGHT_33500, Box, Product
from haploop.mocks.generator.scpi_generator import keysight, keysight_wire
from haploop.mocks.plant import Plant, Run, Source
from haploop.mocks.transport import DirectLine, LineServer, ReplyFault

SWEEP = Sweep(start_hz=1, stop_hz=625, duration=2, amplitude=0.8)
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
    server: LineServer | None = None


def played(generator: ScpiGenerator) -> ScpiGenerator:
    bypass_interlock(generator)
    return generator


def setups(family: str, kind: str) -> Iterator[Setup]:
    driver, product = FAMILIES[family]
    bench = Bench()
    box = Box(product, bench, "amplifier")
    if kind == "twin":
        yield Setup(
            bench, box, lambda **s: played(driver(settings(**s), bench.clock, DirectLine(box.answer)))
        )
        return
    opened: list[ScpiGenerator] = []
    with LineServer(box.answer) as server:
        resource = f"TCPIP::127.0.0.1::{server.port}::SOCKET"

        def opener(**changes: object) -> ScpiGenerator:
            opened.append(
                played(driver.open(settings(resource=resource, visa="@py", **changes), bench.clock))
            )
            return opened[-1]

        yield Setup(bench, box, opener, server)
        for generator in opened:
            generator.close()


@pytest.fixture(params=[(f, k) for f in FAMILIES for k in ("twin", "wire")], ids="-".join)
def setup(request: pytest.FixtureRequest) -> Iterator[Setup]:
    yield from setups(*request.param)


@pytest.fixture
def wired() -> Iterator[Setup]:
    yield from setups("keysight", "wire")


def tell(setup: Setup, *commands: str) -> str:
    """What the box answers at its front, past the driver."""
    return "".join(line for command in commands for line in setup.box.answer(command))


def test_opening_changes_nothing(setup: Setup) -> None:
    tell(setup, "OUTP ON", "FREQ 263.5", "VOLT 1")
    generator = setup.open()
    assert generator.is_on
    assert float(tell(setup, "FREQ?")) == 263.5
    assert generator.load == 50
    assert generator.amplitude == pytest.approx(0.5)
    assert generator.identity.split()[2] in ("33522B", "DG1062Z")


def test_a_sweep_reaches_the_amplifier_only_with_its_trigger(setup: Setup) -> None:
    generator = setup.open()
    generator.configure(SWEEP)
    assert generator.load == math.inf
    assert generator.amplitude == pytest.approx(0.8)
    generator.arm()
    setup.bench.clock.sleep(1)
    assert [generator.is_on] == [False]
    start = setup.bench.clock.now()
    generator.trigger()
    assert [generator.is_on] == [True]
    setup.bench.clock.sleep(SWEEP.duration)
    generator.off()
    setup.bench.clock.sleep(0.5)
    assert not setup.bench.volts(0, start).any()
    t = np.arange(0, SWEEP.duration, 20e-6)
    expected = 0.8 * np.sin(2 * np.pi * (t + (625 - 1) * t**2 / (2 * SWEEP.duration)))
    np.testing.assert_allclose(
        setup.bench.volts(start, start + SWEEP.duration)[: len(t)], expected, atol=1e-6
    )
    assert not setup.bench.volts(start + SWEEP.duration + 20e-6, setup.bench.clock.now()).any()
    assert generator.errors() == ()


def test_an_untriggered_or_finished_sweep_stands_at_its_start_frequency(setup: Setup) -> None:
    generator = setup.open()
    generator.configure(Sweep(start_hz=50, stop_hz=400, duration=0.5, amplitude=0.5))
    generator.arm()
    generator.trigger()
    begin = setup.bench.clock.now()
    setup.bench.clock.sleep(1)
    after = setup.bench.volts(begin + 0.6, begin + 1)
    assert np.abs(after).max() == pytest.approx(0.5, rel=1e-3)
    assert np.count_nonzero((after[:-1] < 0) & (after[1:] >= 0)) == pytest.approx(20, abs=1)


PULSES = Arbitrary([0, 0, 0.2, 0.8, 0.4, 0, -0.4, -0.8, -0.2, 0], 5000)


@pytest.mark.parametrize("waveform", [Burst(263.5, 20, 0.8), Burst(50, 1, 0.3), PULSES], ids=str)
def test_a_waveform_is_played_once_with_its_trigger_and_then_rests(setup: Setup, waveform: Waveform) -> None:
    generator = setup.open()
    if isinstance(generator, Dg1000z) and isinstance(waveform, Arbitrary):
        with pytest.raises(ConfigurationError, match=r"DG1062Z .* does not play Arbitrary: .* Sweep, Burst"):
            generator.configure(waveform)
        return
    for _ in range(2):  # The second play differs in nothing from the first.
        generator.configure(waveform)
        assert generator.amplitude == pytest.approx(waveform.amplitude)
        generator.arm()
        begin = setup.bench.clock.now()
        setup.bench.clock.sleep(0.5)
        assert not generator.is_on
        start = setup.bench.clock.now()
        generator.trigger()
        setup.bench.clock.sleep(waveform.duration + 0.3)
        assert generator.is_on
        generator.off()
        assert not setup.bench.volts(begin, start).any()
        samples, rate_hz = waveform.sampled(0)
        times = np.arange(0, waveform.duration, 20e-6)
        expected = (
            samples[np.floor(times * rate_hz + 1e-6).astype(int)]
            if isinstance(waveform, Arbitrary)
            else np.interp(times, np.arange(len(samples)) / rate_hz, samples)
        )
        played = setup.bench.volts(start, start + waveform.duration)[: len(times)]
        np.testing.assert_allclose(played, expected, atol=2e-3 * waveform.amplitude)
        after = setup.bench.volts(start + waveform.duration + 40e-6, setup.bench.clock.now())
        assert len(after) and not after.any()
    assert generator.errors() == ()


def test_kinds_of_waveform_follow_each_other_in_any_order(setup: Setup) -> None:
    """Nothing of the waveform before is left: each is what it is alone."""
    generator = setup.open()
    burst = Burst(100, 3, 0.5)
    kinds: list[Waveform] = [SWEEP, burst, SWEEP, burst]
    if isinstance(generator, Keysight33500):
        kinds += [PULSES, SWEEP, PULSES, burst, PULSES]
    for waveform in kinds:
        generator.configure(waveform)
        generator.arm()
        start = setup.bench.clock.now()
        generator.trigger()
        setup.bench.clock.sleep(waveform.duration)
        generator.off()
        played = setup.bench.volts(start, start + waveform.duration)
        samples, _ = waveform.sampled(0)
        assert np.sqrt(np.mean(played**2)) == pytest.approx(np.sqrt(np.mean(samples**2)), rel=0.02)
        assert np.abs(played).max() == pytest.approx(waveform.amplitude, rel=2e-3)


def test_the_load_halves_or_doubles_the_volts(setup: Setup) -> None:
    generator = setup.open(load=50)
    generator.configure(SWEEP)
    assert generator.load == 50
    assert generator.amplitude == pytest.approx(0.8), "as the instrument sees it"
    generator.arm()
    generator.trigger()
    begin = setup.bench.clock.now()
    setup.bench.clock.sleep(1)
    assert np.abs(setup.bench.volts(begin, begin + 1)).max() == pytest.approx(1.6, rel=1e-3)


def test_configuring_switches_the_output_off_first(setup: Setup) -> None:
    tell(setup, "OUTP1 ON", "SOUR1:FUNC DC", "VOLT:OFFS 4", "BURS:STAT ON")
    generator = setup.open()
    generator.configure(SWEEP)
    assert not generator.is_on
    assert float(tell(setup, "VOLT:OFFS?")) == 0
    assert tell(setup, "FUNC?;:BURS:STAT?") in ("SIN;0", "SIN;OFF")


def test_more_volts_than_the_rig_allows_are_refused_before_anything_is_sent(setup: Setup) -> None:
    generator = setup.open()
    tell(setup, "OUTP ON")
    with pytest.raises(LimitError, match=r"1.2 V peak was refused: 'highest' in \[generator\] is 1 V"):
        generator.configure(Sweep(1, 625, 2, 1.2))
    assert generator.is_on


def test_the_instruments_own_words_for_what_it_refuses(setup: Setup) -> None:
    generator = setup.open(highest=50)
    with pytest.raises(
        InstrumentError, match=r"refused a setting: -222 Data out of range; value clipped to upper"
    ):
        generator.configure(Sweep(1, 625, 2, 20))
    with pytest.raises(ConfigurationError, match="no waveform to arm"):
        generator.arm()
    with pytest.raises(InstrumentError, match="-222"):
        generator.configure(Sweep(1, 625, 1000, 0.5))


def test_errors_of_somebody_else_are_not_blamed_on_the_sweep(setup: Setup) -> None:
    tell(setup, "NONSENSE 1")
    generator = setup.open()
    generator.configure(SWEEP)
    tell(setup, "NONSENSE 1", "FREQ banana")
    assert generator.errors() == ("-113 Undefined header", "-104 Data type error")
    assert generator.errors() == ()


def test_no_trigger_without_arming(setup: Setup) -> None:
    generator = setup.open()
    with pytest.raises(ConfigurationError, match=r"not armed|no waveform to play"):
        generator.trigger()
    generator.configure(SWEEP)
    generator.arm()
    generator.off()
    generator.off()
    with pytest.raises(ConfigurationError, match=r"not armed|no waveform to play"):
        generator.trigger()
    assert not generator.is_on


def test_a_trigger_that_is_ignored_leaves_the_output_off(setup: Setup) -> None:
    generator = setup.open()
    generator.configure(SWEEP)
    generator.arm()
    tell(setup, "SWE:STAT OFF")
    with pytest.raises(InstrumentError, match="did not start its waveform: -211 Trigger ignored"):
        generator.trigger()
    assert not generator.is_on


class Deaf(Box):
    """An instrument that passes over some commands without a word."""

    def __init__(self, product: Product, plant: Bench, deaf: str) -> None:
        super().__init__(product, plant, "amplifier")
        answer = self.answer
        self.answer = lambda line: [] if deaf in line and "?" not in line else answer(line)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(
    ("deaf", "sentence"),
    [
        ("LOAD", r"given inf for load but reads 50"),
        ("VOLT ", r"given 1.6 for peak_to_peak but reads"),
        ("FREQ:STOP", r"given 625 for stop_hz but reads 1000"),
        ("SWE:TIME", r"given 2 for duration but reads 1"),
    ],
)
def test_a_setting_that_was_not_taken_is_read_back(family: str, deaf: str, sentence: str) -> None:
    driver, product = FAMILIES[family]
    bench = Bench()
    box = Deaf(product, bench, deaf)
    with pytest.raises(InstrumentError, match=sentence):
        played(driver(settings(), bench.clock, DirectLine(box.answer))).configure(SWEEP)


@pytest.mark.parametrize("family", FAMILIES)
def test_an_output_that_stays_on_is_said(family: str) -> None:
    driver, product = FAMILIES[family]
    bench = Bench()
    box = Deaf(product, bench, "OFF")
    box.answer("OUTP1 ON")
    with pytest.raises(InstrumentError, match="switch its output off but reads on: switch it off by hand"):
        driver(settings(), bench.clock, DirectLine(box.answer)).off()


def test_another_instrument_is_refused() -> None:
    bench = Bench()
    box = Box(DG1000Z, bench, "amplifier")
    with pytest.raises(InstrumentError, match=r"Rigol Technologies DG1062Z.* not for: correct 'driver'"):
        Keysight33500(settings(), bench.clock, DirectLine(box.answer))


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("silence", r"(did not answer|was lost after) 'OUTP1\?'"),
        ("terminator", r"answered 'OUTP1\?' with b'0\\r', which ends in a carriage return"),
        ("garbled", r"answered 'OUTP1\?' with .* which is no text"),
        ("truncated", r"'OUTP1\?'"),
        ("drip", r"no line end within 0.2 s"),
        ("disconnect", r"'OUTP1\?'"),
    ],
)
def test_a_fault_of_the_line_is_one_sentence_and_passes(wired: Setup, kind: str, sentence: str) -> None:
    generator = wired.open()
    assert wired.server is not None
    fault = ReplyFault(kind, asked="OUTP1?", times=1, delay=0.25)  # type: ignore[arg-type]
    wired.server.faults.append(fault)
    with pytest.raises(InstrumentError, match=rf"^The generator at TCPIP::\S+ .*{sentence}"):
        assert generator.is_on
    assert fault.fired == 1
    assert not generator.is_on, "the next question opens a new connection"


def test_a_late_answer_is_not_taken_for_the_next_one(wired: Setup) -> None:
    generator = wired.open()
    assert wired.server is not None
    fault = ReplyFault("delay", asked="VOLT?", times=1, delay=0.25)
    wired.server.faults.append(fault)
    with pytest.raises(InstrumentError, match="did not answer"):
        generator.amplitude  # noqa: B018
    assert fault.fired == 1
    assert generator.load == 50


def test_a_generator_that_has_gone_is_one_sentence(wired: Setup) -> None:
    generator = wired.open()
    assert wired.server is not None
    wired.server.close()
    for _ in range(2):
        with pytest.raises(InstrumentError, match=r"^The generator at TCPIP::"):
            generator.off()


@pytest.mark.parametrize("resource", ["TCPIP::127.0.0.1::1::SOCKET", "nonsense"])
def test_no_such_resource_is_one_sentence(resource: str) -> None:
    with pytest.raises(InstrumentError, match=rf"^The generator at {resource}"):
        Keysight33500.open(settings(resource=resource, visa="@py"), VirtualClock())


def test_an_unknown_host_is_one_sentence() -> None:
    resource = "TCPIP::no.such.host.invalid::5025::SOCKET"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # pyvisa-py forgets its socket then
        try:
            Keysight33500.open(settings(resource=resource, visa="@py"), VirtualClock())
        except InstrumentError as error:
            sentence = str(error)
        gc.collect()
    assert sentence.startswith(f"The generator at {resource} cannot be opened (could not connect")


@pytest.mark.parametrize("sweep", [(0, 625, 20, 1), (10, 10, 1, 1), (1, 625, 0, 1), (1, math.inf, 1, 1)])
def test_a_sweep_that_no_generator_can_play(sweep: tuple[float, float, float, float]) -> None:
    with pytest.raises(ConfigurationError, match="cannot be played"):
        Sweep(*sweep)


@pytest.mark.parametrize(
    "burst", [(0, 5, 1), (math.inf, 5, 1), (100, 0, 1), (100, 2.5, 1), (100, 5, 0), (100, math.nan, 1)]
)
def test_a_burst_that_no_generator_can_play(burst: tuple[float, int, float]) -> None:
    with pytest.raises(ConfigurationError, match="cannot be played"):
        Burst(*burst)


@pytest.mark.parametrize(
    ("volts", "rate_hz", "told"),
    [
        ([], 1000, "three samples"),
        ([0, 1], 1000, "three samples"),
        ([[0, 1, 0]], 1000, "one row"),
        ([0, math.nan, 0], 1000, "finite"),
        ([0, 0, 0], 1000, "not all 0 V"),
        ([0, 1, 0], 0, "0 samples/s"),
        ([0, 1, 0], math.nan, "nan samples/s"),
        ([1, 0, 0], 1000, "this one at 1 and 0 V"),
        ([0, 1, -1], 1000, "this one at 0 and -1 V"),
    ],
)
def test_an_arbitrary_waveform_that_no_generator_can_play(
    volts: list[float], rate_hz: float, told: str
) -> None:
    with pytest.raises(ConfigurationError, match=told):
        Arbitrary(volts, rate_hz)


@pytest.mark.parametrize(
    "endless",
    [
        lambda: Burst(1e7, 10**8, 1.0),
        lambda: Sweep(1.0, 1e9, 1.0, 1.0),
        lambda: Arbitrary([0, 1, 0], 1e-6),
    ],
)
def test_a_waveform_that_would_fill_the_memory_is_refused_at_once(endless: Callable[[], Waveform]) -> None:
    with pytest.raises(ConfigurationError, match="too long to be judged"):
        endless()


def test_a_waveform_states_its_volts_duration_and_duty() -> None:
    assert (SWEEP.amplitude, SWEEP.duration, SWEEP.duty) == (0.8, 2, 1)
    burst = Burst(200, 10, 3)
    assert (burst.amplitude, burst.duration, burst.duty) == (3, 0.05, 1)
    assert (PULSES.amplitude, PULSES.duration, PULSES.duty) == (0.8, 0.002, 0.7)
    volts = np.array([0.0, -2.0, 1.0, 0.0])
    kept = Arbitrary(volts, 10)
    volts[:] = 400
    assert kept.amplitude == 2 and kept == Arbitrary((0, -2, 1, 0), 10)
    assert kept.scaled(3) == Arbitrary((0, -6, 3, 0), 10)


@pytest.mark.parametrize("kind", ["twin", "wire"])
def test_a_sweep_moves_the_table(kind: str) -> None:
    clock = VirtualClock()
    plant = Plant(load_rig_file("simulated"), clock)

    def play(generator: ScpiGenerator) -> None:
        plant.switch("A", True, clock.now())
        bypass_interlock(generator)
        generator.configure(Sweep(200, 300, 1, 0.8))
        generator.arm()
        generator.trigger()
        clock.sleep(1.5)
        generator.off()
        generator.close()

    if kind == "twin":
        play(keysight(settings(), plant))
    else:
        with keysight_wire(settings(), plant) as address:
            play(Keysight33500.open(settings(**address), clock))
    assert plant.truth.peak == pytest.approx(40, rel=0.02)
    clock.sleep(0.1)
    assert plant.truth.patch_voltages["A"] == pytest.approx(0, abs=0.02)
