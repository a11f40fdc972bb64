"""The sound card as a DAQ: its driver on the twin of the library that it plays and records with."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from haploop.base.arrays import FloatArray
from haploop.base.clock import VirtualClock
from haploop.base.errors import ConfigurationError, InstrumentError, LimitError
from haploop.base.validation import validate
from haploop.instruments import Daq, load_rig_file
from haploop.instruments.conformance import DaqConformance, Fired, bypass_interlock
from haploop.instruments.daq.sound_card import SoundCardDaq
from haploop.mocks.daq.sound_card import DRIFT, LATENCY, DuplexCard, Line
from haploop.mocks.plant import Faults, Plant
from haploop.nidaqmx_twin.nodes import Run
from tests.raising import raises
from tests.rig_files import changed

SIMULATED = load_rig_file("simulated")
RATE = 48_000.0


def settings(**changes: Any) -> SoundCardDaq.Settings:
    inputs = {"laser": (1, 5.0), "drive": (2, 2.0), "spare": (4, 1.5)}
    channels = {name: {"input": n, "volts_per_full_scale": volts} for name, (n, volts) in inputs.items()}
    outputs = {"amplifier": {"output": 1, "volts_per_full_scale": 1.4}}
    card = {"channels": channels, "outputs": outputs, "latency": LATENCY}
    return SoundCardDaq.Settings.model_validate(card | changes)


class Bench:
    """A card on a plant, with a cable from its output to the spare input."""

    def __init__(self, *faults: dict[str, Any], **changes: Any) -> None:
        self.plant = Plant(changed(SIMULATED, simulation={"faults": faults}), VirtualClock())
        self.plant.cables["spare"] = "amplifier"
        self.settings = settings(**changes)
        self.card = DuplexCard(self.settings, self.plant)
        self.daq = SoundCardDaq(self.settings, self.plant.clock, self.card)
        bypass_interlock(self.daq)

    def play(self, wave: FloatArray, *channels: str, samples: int | None = None) -> FloatArray:
        with self.daq.stream(channels, RATE, 4800, samples or len(wave), {"amplifier": wave}) as stream:
            return stream.capture().volts


def coupled(corner_hz: float, **output: Any) -> dict[str, Any]:
    given = settings().model_dump()
    for one in (*given["channels"].values(), *given["outputs"].values()):
        one["high_pass_hz"] = corner_hz
    given["outputs"]["amplifier"] |= output
    return {"channels": given["channels"], "outputs": given["outputs"]}


def burst(peak: float = 1.0, duration: float = 0.2, hz: float = 400.0) -> FloatArray:
    t = np.arange(round(duration * RATE)) / RATE
    volts = np.sin(2 * np.pi * hz * t) * np.sin(np.pi * t / duration) ** 2
    volts -= volts.mean()
    return np.asarray(peak * volts / np.abs(volts).max())


class _OnACard(DaqConformance):
    capabilities = ("outputs", "loop")
    channels = ("laser", "drive", "spare")
    outputs = ("amplifier",)
    output_range = 1.4
    played = 0.5
    loop = ("amplifier", "spare")
    rate_hz = RATE
    faults = ("overrun", "underrun", "device gone", "daq-overrun", "play-cut-off")
    corner: float

    @pytest.fixture
    def daq(self) -> Daq:
        self.bench = Bench(**coupled(self.corner, highest=1.4))
        return self.bench.daq

    @contextmanager
    def fault(self, kind: str) -> Iterator[Fired]:
        card, counted = self.bench.card, SimpleNamespace(fired=1)
        if kind == "overrun":
            card.overflows_at = 2400
        elif kind == "device gone":
            card.dies_at = 2400
        elif kind == "underrun":
            card.starves_at = 2400
        else:
            faults = ({"kind": kind, "after": 0.051},)
            self.bench.plant.faults = Faults.of_file(changed(SIMULATED, simulation={"faults": faults}))
        yield counted
        if kind == "overrun":
            counted.fired = int(card.overflows_at is None)


class TestDcCoupled(_OnACard):
    corner = 0.0
    faults = ("overrun", "device gone", "daq-overrun")


class TestAcCoupled(_OnACard):
    corner = 5.0
    ac_coupled = True
    tolerance = 0.06
    faults = ("overrun", "device gone", "daq-overrun")


def test_a_waveform_is_heard_at_sample_0_at_its_volts():
    bench = Bench()
    wave = burst()
    heard = bench.play(wave, "spare")[0]
    assert np.abs(heard - wave).max() < 0.06  # two couplings of 5 Hz
    direct = Bench(**coupled(0.0))
    for _ in range(3):
        assert np.abs(direct.play(wave, "spare")[0] - wave).max() < 2e-3


def test_reading_the_plant_changes_nothing_of_what_is_heard(monkeypatch):
    """A board on the wire reads in a thread of its own, and may come first after each wait."""
    alone, read = Bench(), Bench()
    sleep = read.plant.clock.sleep

    def waits(duration: float) -> None:
        sleep(duration)
        read.plant.read(["laser"], np.array([[read.plant.clock.now()]]))

    monkeypatch.setattr(read.plant.clock, "sleep", waits)
    heard = [bench.play(burst(), "spare")[0] for bench in (alone, read)]
    np.testing.assert_array_equal(*heard)


def test_it_takes_the_rigs_time_at_its_own_pace():
    bench = Bench()
    before = bench.plant.clock.now()
    with bench.daq.stream(["laser"], RATE, 4800, 480_000) as stream:
        assert stream.capture().volts.shape == (1, 480_000)
    took = bench.plant.clock.now() - before
    assert took == pytest.approx(10.05, abs=0.02) and took < 10.05 / (1 + DRIFT) + 0.02


@pytest.mark.parametrize("frame", [0, 4000, 9000, 12_000])
def test_an_underrun_anywhere_in_a_play_is_an_error(frame):
    bench = Bench()
    bench.card.starves_at = frame
    with pytest.raises(InstrumentError, match=r"ran out of samples to play \(an underrun\).*not used"):
        bench.play(burst(), "spare")
    bench.play(burst(), "spare")  # the next one is a new trial


def test_an_overrun_in_the_silence_before_a_recording_is_none():
    bench = Bench()
    bench.card.overflows_at = 480
    with bench.daq.stream(["laser"], RATE, 480, 4800) as stream:
        stream.capture()
    assert bench.card.overflows_at is None
    bench.card.overflows_at = 4800
    told = pytest.raises(InstrumentError, match=r"lost samples of its inputs \(an overrun\) near frame 4800")
    with bench.daq.stream(["laser"], RATE, 480, 9600) as stream, told:
        stream.capture()


def test_a_play_of_another_latency_is_no_play_where_a_monitor_hears_it():
    bench = Bench(monitor="spare")
    for wave in (burst(), burst(hz=2000.0)):
        bench.play(wave, "laser")
    bench.card.latency += 256
    with pytest.raises(InstrumentError, match=rf"of {LATENCY + 256} frames, and \[daq\] says {LATENCY}"):
        bench.play(burst(), "laser")
    bench.plant.cables.clear()  # nothing is heard: nothing can be said
    bench.play(burst(), "laser")


def test_the_couplings_are_stated_as_responses():
    bench = Bench()
    wave = burst(0.5, 2.0, 20.0)
    heard = bench.play(wave, "spare", samples=len(wave) + 48_000)[0]
    f = np.fft.rfftfreq(len(heard), 1 / RATE)
    stated = bench.daq.response("spare", f) ** 2  # the output's is the same
    expected = np.fft.irfft(np.fft.rfft(wave, len(heard)) * stated, len(heard))
    assert np.abs(heard - expected).max() < 2e-3
    assert abs(bench.daq.response("spare", np.array([5.0]))[0]) == pytest.approx(np.sqrt(0.5))


@pytest.mark.parametrize(("wave", "says"), [
    (burst(1.01), r"leaves the output's range of \+-1 V"),
    (burst(0.5) + 0.02, "AC-coupled, so take the mean off"),
    (np.append(burst(0.5), np.nan), "is not finite"),
])  # fmt: skip
def test_what_cannot_be_played_as_it_is_is_refused(wave, says):
    bench = Bench()
    raises(LimitError, says, bench.play, wave, "spare")
    assert bench.card.open is None


@pytest.mark.parametrize(("changes", "says"), [
    ({"latency": None}, "outputs need latency: write latency = 0.*doctor --loop"),
    ({"monitor": "dirve"}, "monitor names 'dirve', and the channels are laser, drive, spare"),
    ({"channels": {}}, "channels must have 1 or more entries"),
    ({"channels": {"a": {"input": 1}}}, "the key 'channels.a.volts_per_full_scale' is missing"),
    ({"channels": {"a": {"input": 0, "volts_per_full_scale": 1}}}, "channels.a.input must be 1 or more"),
    ({"channels": {n: {"input": 1, "volts_per_full_scale": 1} for n in "ab"}},
     "input 1 has two names, 'a' and 'b': keep one"),
    ({"outputs": {n: {"output": 2, "volts_per_full_scale": 1} for n in "ab"}},
     "output 2 has two names, 'a' and 'b': keep one"),
    ({"channels": {"a": {"input": 1, "volts_per_full_scale": -1}}}, "must be above 0"),
    ({"channels": {"a": {"terminal": "Dev1/ai0", "range": 1}}}, "unknown key 'channels.a.terminal'"),
    ({"outputs": {"a": {"output": 1, "volts_per_full_scale": 1, "high_pass_hz": 500}}}, "must be 50"),
    ({"buffer": "tiny"}, "buffer must be 'high' or 'low'"),
    ({"rate_hz": float("nan")}, "rate_hz must be"),
])  # fmt: skip
def test_a_wrong_table_is_one_sentence(changes, says):
    given = settings().model_dump() | changes
    refused = raises(ConfigurationError, says, validate, SoundCardDaq.Settings, given, "[daq] of lab.toml")
    assert "\n" not in refused and refused.endswith(".")


@pytest.mark.parametrize(("change", "says"), [
    (("rate_hz = 48000", "rate_hz = 44100"), "rate_hz at the top is 44100: write rate_hz = 48000"),
    (("[table]\nrate_hz = 48000", "[table]\nrate_hz = 50000"), r"rate_hz in \[table\] is 50000: write"),
    (("input = 9, volts_per_full_scale = 5, high_pass_hz = 0", "input = 9, volts_per_full_scale = 5"),
     r"'acceleration_z' is AC-coupled, and \[sensors.acceleration\] needs its voltage at rest"),
    (
        (
            "input = 1, volts_per_full_scale = 10, high_pass_hz = 0",
            "input = 1, volts_per_full_scale = 10",
        ),
        r"'gauge0' is AC-coupled, and \[sensors.force\] needs its voltage at rest: write high_pass",
    ),
])  # fmt: skip
def test_what_a_file_says_twice_is_one_sentence(change, says, tmp_path):
    text = (Path(__file__).parents[2] / "calibration/self_test/card.toml").read_text()
    assert change[0] in text
    (tmp_path / "rig.toml").write_text(text.replace(*change, 1))
    raises(ConfigurationError, says, load_rig_file, tmp_path / "rig.toml")


def test_what_the_device_has_not_is_one_sentence():
    bench = Bench()
    more = settings(channels={"far": {"input": 9, "volts_per_full_scale": 1.0}})
    with pytest.raises(ConfigurationError, match=r"has 4 inputs, and \[daq\] names input 9"):
        SoundCardDaq(more, bench.plant.clock, bench.card)
    with pytest.raises(ConfigurationError, match=r"runs at 48000.*50000 were asked.*write rate_hz = 48000"):
        bench.daq.stream(["laser"], 50_000, 100, 100)
    busy = pytest.raises(InstrumentError, match="does not start at 48000 samples/s")
    with bench.daq.stream(["laser"], RATE, 480), busy:
        bench.daq.stream(["laser"], RATE, 480)


def test_zero_ends_no_recording():
    bench = Bench()
    with bench.daq.stream(["spare"], RATE, 480, 9600) as stream:
        blocks = iter(stream)
        next(blocks)
        bench.daq.zero()
        assert next(blocks).first == 480


def test_a_cable_carries_what_stood_on_the_output_at_each_time():
    """Three periods of 4 ms with a hole between the second and the third: nothing before, the last held."""
    line = Line(2.0, 0.0)
    for number, start in enumerate((1.0, 1.004, 1.012)):
        line.put(Run(start, 1e-3, np.arange(4.0) + 10 * number))
    line.take(2.0)
    times = np.array([0.5, 1.0, 1.0035, 1.004, 1.0079, 1.011, 1.012, 1.0149, 1.5])
    volts = 2.0 * np.array([0, 0, 3, 10, 13, 13, 20, 22, 23])
    np.testing.assert_array_equal(line.volts(times), volts)
    for first in range(len(times)):
        for end in range(first + 1, len(times) + 1):
            np.testing.assert_array_equal(line.volts(times[first:end]), volts[first:end])
