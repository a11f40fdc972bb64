"""The sound card's driver through the twin's `sounddevice`, and what a rig makes of its plays."""

import importlib

import numpy as np
import pytest

from haploop.base.arrays import FloatArray
from haploop.base.clock import RealClock, VirtualClock
from haploop.base.errors import ConfigurationError, InstrumentError, LimitError
from haploop.calibration import calibrate, drive_for
from haploop.calibration.drive import check
from haploop.calibration.response.excitation import linear_sweep
from haploop.instruments import Rig, load_rig_file
from haploop.instruments.conformance import bypass_interlock
from haploop.instruments.player.sound_card import SoundCard, at_rate
from haploop.instruments.rig.alignment import Aligned, Timing, find
from haploop.mocks.plant import Plant
from haploop.mocks.player import DRIFT, Card, Jack, twin
from tests.calibration.conftest import make_press
from tests.raising import raises, raising

pytestmark = pytest.mark.requires("simulation")

RATE = 50_000.0
SETTINGS = {"output": "line-out", "volts_per_full_scale": 1.4}


def burst(peak: float, duration: float = 0.4, hz: float = 263.5) -> FloatArray:
    t = np.arange(round(duration * RATE)) / RATE
    volts = np.sin(2 * np.pi * hz * t) * np.sin(np.pi * t / duration) ** 2
    volts -= volts.mean()
    return np.asarray(peak * volts / np.abs(volts).max())


def settings(**changes: object) -> SoundCard.Settings:
    return SoundCard.Settings.model_validate(SETTINGS | changes)


def assert_off(rig: Rig) -> None:
    """No contact is closed, and what the coupling held has gone."""
    truth = rig.simulation.truth
    assert truth.closed == frozenset()
    rig.clock.sleep(0.2)
    assert max(map(abs, truth.patch_voltages.values())) < 0.02


class Bench:
    """A card on a plant's clock, and the volts that it puts out."""

    def __init__(self, **changes: object) -> None:
        self.plant = Plant(load_rig_file("sound-card"), VirtualClock())
        self.driver = twin(settings(**changes), self.plant)
        bypass_interlock(self.driver)
        assert isinstance(self.driver.audio, Card)
        self.card = self.driver.audio
        self.card.jack.high_pass_hz = 0.0
        self.steps: list[tuple[float, FloatArray]] = []
        take = self.card.jack.take

        def remember(until: float) -> list[object]:
            runs = take(until)
            self.steps += [(run.start, run.values) for run in runs]
            return list(runs)

        self.card.jack.take = remember

    def wait(self, duration: float) -> None:
        self.plant.clock.sleep(duration)
        self.plant.advance(self.plant.clock.now())

    @property
    def volts(self) -> FloatArray:
        return np.concatenate([values for _, values in self.steps]) if self.steps else np.zeros(1)


def test_a_waveform_comes_out_whole_at_the_cards_rate():
    bench = Bench()
    wave = burst(0.9)
    with bench.driver.play(wave, RATE):
        bench.wait(0.4 + bench.driver.max_latency)
    out = bench.volts
    t = np.arange(round(0.4 * 48_000)) / 48_000
    wanted = np.interp(t, np.arange(len(wave)) / RATE, wave)
    first = int(np.abs(np.correlate(out, wanted, "valid")).argmax())
    assert np.abs(out[first : first + len(wanted)] - wanted).max() < 2e-3  # what np.interp is wrong by
    assert np.abs(out[:first]).max() < 1e-4 and np.abs(out[first + len(wanted) :]).max() < 1e-4


def test_resampling_is_exact_for_what_is_band_limited():
    wave = burst(1.0)
    there = at_rate(wave, RATE, 48_000)
    assert len(there) == round(0.42 * 48_000)
    t = np.arange(len(there)) / 48_000
    inside = t < 0.4
    exact = np.sin(2 * np.pi * 263.5 * t) * np.sin(np.pi * t / 0.4) ** 2
    share = float(np.dot(there[inside], exact[inside]) / np.dot(exact[inside], exact[inside]))
    assert np.abs(there[inside] - share * exact[inside]).max() < 1e-4
    assert np.abs(at_rate(there, 48_000, RATE)[: len(wave)] - wave).max() < 1e-4


@pytest.mark.parametrize(("wave", "changes", "says"), [
    (burst(1.01), {}, r"1.01 V peak was refused.*1 V"),
    (burst(1.5), {"highest": 2.0}, r"1.5 V peak was refused.*1.4 V"),
    (burst(0.5) + 0.02, {}, "AC-coupled, so take the mean off"),
])  # fmt: skip
def test_what_cannot_be_played_is_refused(wave, changes, says):
    bench = Bench(**changes)
    with pytest.raises(LimitError, match=says), bench.driver.play(wave, RATE):
        pass
    bench.wait(0.5)
    assert not bench.card.jack.begun and np.abs(bench.volts).max() == 0


def test_a_busy_device_is_one_sentence():
    bench = Bench()
    other = SoundCard(settings(), bench.plant.clock, bench.card)
    bypass_interlock(other)
    refused = pytest.raises(InstrumentError, match="cannot play at 48000 samples/s")
    with bench.driver.play(burst(0.9), RATE):
        with refused, other.play(burst(0.5), RATE):
            pass
        bench.wait(1.0)


@pytest.mark.parametrize(("error", "says"), [
    (ImportError("No module"), r"pip install \"haploop\[sound\]\""),
    (OSError("PortAudio library not found"), "install the distribution's PortAudio"),
])  # fmt: skip
def test_without_sounddevice(error, says, monkeypatch):
    def load(name: str) -> object:
        assert name == "sounddevice"
        raise error

    monkeypatch.setattr(importlib, "import_module", load)
    raises(ConfigurationError, says, SoundCard.open, settings(), RealClock())


def test_no_such_device_is_one_sentence(monkeypatch):
    bench = Bench()
    monkeypatch.setattr(bench.card, "query_devices", raising(ValueError("No output device matching 'USB'")))
    with pytest.raises(InstrumentError, match="no sound output 'USB'"):
        SoundCard(settings(device="USB"), RealClock(), bench.card)


# On a rig


def played(rig: Rig) -> Jack:
    assert isinstance(rig.player, SoundCard) and isinstance(rig.player.audio, Card)
    return rig.player.audio.jack


@pytest.mark.long
def test_a_capture_is_on_the_drives_clock(open, tmp_path):
    """As with the DAQ's own output, whenever a play begins and however fast the card's clock is."""
    # Without coupling, so that both give the same.
    (tmp_path / "direct.toml").write_text('base = "sound-card"\n[player]\nhigh_pass_hz = 0\n')
    rig, wired = open(str(tmp_path / "direct.toml")), open("haptable")
    jack, drive = played(rig), burst(40)
    jack.high_pass_hz = 0.0
    by_daq = wired.excite(drive, ["A"], ["laser", "drive"], tail=0.1)
    for drift in (DRIFT, -100e-6):
        jack.drift = drift
        capture = rig.excite(drive, ["A"], ["laser", "drive"], tail=0.1)
        assert isinstance(capture, Aligned)
        assert capture.channels == by_daq.channels and capture.volts.shape == by_daq.volts.shape
        assert capture.delays == pytest.approx(by_daq.delays) and not capture.overload.any()
        assert capture.timing.drift == pytest.approx(drift, abs=1e-6)
        assert capture.timing.misfit < 1e-3
        # The amplifier's pole (31.8 us) and half a step (10 us) are lateness of the DAQ's play, and
        # part of the begin of the player's.
        late = np.gradient(by_daq.volts[1], 1 / RATE) * 42e-6
        shifted = by_daq.volts[1] + late
        assert np.std(capture.volts[1] - shifted) < 5e-3 * np.std(shifted)
        assert np.corrcoef(capture.volts[0], by_daq.volts[0])[0, 1] > 0.99
    assert rig.simulation.truth.closed == frozenset()


@pytest.mark.parametrize(("made", "corner"), [
    (burst, 5.0), (burst, 2.0), (burst, 10.0), (lambda peak: linear_sweep(RATE, 2.0, 625.0, peak), 2.0),
])  # fmt: skip
def test_the_begin_does_not_depend_on_what_the_coupling_is_believed_to_be(open, made, corner, monkeypatch):
    """Declared as 5 Hz: a wrong corner must not pass for a delay."""
    rig = open("sound-card")
    jack, begun = played(rig), []
    jack.high_pass_hz = corner
    stream, now = rig.daq.stream, rig.clock.now
    monkeypatch.setattr(rig.daq, "stream", lambda *a, **k: (begun.append(now()), stream(*a, **k))[1])
    capture = rig.excite(made(40.0), ["A"], ["drive"], tail=0.1)
    assert isinstance(capture, Aligned)
    truth = jack.begun[-1] + 0.05 / (1 + DRIFT) - begun[-1]
    # The amplifier's pole (31.8 us) and half a step of the card (10.4 us) come after the begin.
    assert capture.timing.begin - truth == pytest.approx(42.2e-6, abs=2e-6 if corner == 5 else 15e-6)


def test_the_operator_confirms_what_cannot_be_read(open, monkeypatch):
    rig = open("sound-card")
    asked: list[str] = []

    def answer(request: object) -> bool:
        asked.append(str(request))
        return "volume" not in str(request)

    monkeypatch.setattr(rig.operator, "confirm", answer)
    raises(InstrumentError, "did not confirm the settings of the Sound card", rig.confirm_settings)
    assert len(asked) == 2 and "1.4 V peak" in asked[1]


@pytest.mark.long
@pytest.mark.parametrize(("full_scale", "says"), [
    (2.8, r"Patch A got .* to prove the gain: .* a player's volume"),
    (0.0, "monitor shows 0.* V for each volt"),
    (-1.4, "upside down"),  # a tone, whose neighbouring half waves are nearly as good
])  # fmt: skip
def test_a_wrong_volume_is_found_in_what_is_measured(open, full_scale, says):
    rig = open("sound-card")
    played(rig).full_scale = full_scale
    raises(InstrumentError, says, rig.excite, burst(40, 2.0), ["A"], ["drive", "laser"])
    assert_off(rig)


def test_an_underflow_on_the_rig_is_an_error_and_leaves_it_safe(open):
    rig = open("sound-card")
    played(rig).starves_at = 9600
    raises(InstrumentError, "ran out of samples", rig.excite, burst(40), ["A"], ["drive", "laser"])
    assert rig.simulation.truth.closed == frozenset()
    capture = rig.excite(burst(40), ["A"], ["laser"], tail=0.1)  # the next one is a new trial
    assert capture.channels == ("laser",) and capture.volts.shape == (1, 25_000)
    assert capture.delays.shape == capture.overload.shape == (1,)


def test_a_play_stops_before_the_relay_opens(open, monkeypatch):
    rig = open("sound-card")
    bypass_interlock(rig.player)
    truth, connect, seen = rig.simulation.truth, rig.relay.connect, []

    def watched(patches: object) -> None:
        if not patches:
            seen.append(max(map(abs, truth.patch_voltages.values())))
        connect(patches)

    rig.relay.connect(["A"])
    with (
        pytest.raises(InstrumentError, match="had not played to the end"),
        rig.player.play(burst(0.8, 2.0), RATE),
    ):
        rig.clock.sleep(1.0)
        assert truth.patch_voltages["A"] and truth.peak > 10
        with monkeypatch.context() as patch:
            patch.setattr(rig.relay, "connect", watched)
            rig.make_safe()
        # What the coupling still holds after the rest.
        assert max(seen) < 0.5
        rig.clock.sleep(0.5)
        assert truth.closed == frozenset() and max(map(abs, truth.patch_voltages.values())) < 0.02


def test_an_interrupted_play_leaves_the_rig_safe(open):
    rig = open("sound-card")

    def interrupt(*_: object) -> None:
        if rig.simulation.truth.peak > 1:
            raise KeyboardInterrupt

    raises(KeyboardInterrupt, "", rig.excite, burst(40, 2.0), ["A"], ["drive", "laser"], progress=interrupt)
    assert_off(rig)


@pytest.mark.usefixtures("unproved")
def test_a_long_tone_is_not_taken_for_its_neighbour(open):
    rig = open("sound-card")
    plays = [rig.excite(burst(40, 2.0), ["A"], ["drive"]) for _ in range(3)]
    waves = [capture.volts[0] for capture in plays]
    for wave in waves:
        # A period's neighbour would differ by 0.7 % of the peak where the burst rises.
        assert np.abs(wave - waves[0]).max() < 2e-3 * np.abs(waves[0]).max()


def measured(drive: FloatArray, begin: float, drift: float, sign: float = 1.0) -> FloatArray:
    """What a monitor shows of a drive that was played then and so fast; straight between samples."""
    t = np.arange(len(drive) + 20_000) / RATE
    seen = np.interp((t - begin) * (1 + drift), np.arange(len(drive)) / RATE, drive, 0.0, 0.0)
    return np.asarray(sign * seen + 1e-3 * np.random.default_rng(0).standard_normal(len(t)))


def test_a_clock_that_is_no_crystals_is_refused():
    sweep = linear_sweep(RATE, 3.0, 625.0, 40.0)

    def flat(f: FloatArray) -> np.ndarray:
        return np.ones(len(f), dtype=np.complex128)

    timing = find(measured(sweep, 0.1234, 200e-6), sweep, RATE, 0.0, flat)
    assert isinstance(timing, Timing)
    assert timing.drift == pytest.approx(200e-6, abs=1e-6) and timing.begin == pytest.approx(0.1234, abs=1e-6)
    for says, seen in (
        (r"differs from the DAQ's by 7\d\d ppm", measured(sweep, 0.1234, 700e-6)),
        ("upside down", measured(sweep, 0.1234, 0.0, -1.0)),
        ("does not show the drive", np.random.default_rng(0).standard_normal(170_000)),
    ):
        raises(InstrumentError, says, find, seen, sweep, RATE, 0.0, flat)


@pytest.mark.night
@pytest.mark.many_plays
@pytest.mark.usefixtures("few_callbacks")
def test_a_drive_made_through_the_sound_card_passes_its_check(open):
    rig = open("sound-card")
    calibration = calibrate(rig)
    result = check(rig, drive_for(make_press(), calibration, rig.limits))
    assert result.passed and result.reasons == ()
    # 7 % by the DAQ's output; the coupling takes away what undoes the patch's hysteresis below 20 Hz.
    assert result.within.root < 0.13 and result.correlation > 0.99 and result.within.floor < 0.02
