"""Nothing outside a limit reaches a patch, whoever plays and however: looked at in the plant."""

from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from haploop.base.arrays import FloatArray
from haploop.base.errors import HaploopError, InstrumentError, LimitError
from haploop.instruments import Arbitrary, Rig, RigFile, Sweep, Waveform, load_rig_file, open_rig
from haploop.instruments import Burst as SineBurst
from haploop.instruments.config import Actuator
from haploop.instruments.config.rig_file import Device, DriveLimits
from haploop.mocks.plant import AMPLIFIER_GAIN_ERROR
from tests.instruments.safety.at_the_patch import Burst, bursts, busiest_minute, of_patch
from tests.rig_files import changed

CODE = 0.5 * 50 * 20 / 2**16
"""V at the patch of half a code of the card's output."""
SIZES = st.sampled_from((0.2, 0.6, 0.8, 0.9, 0.95, 0.999, 1.0, 1.001, 1.02, 1.5))
WIRED = ("daq", "each", "generator", "player")


@dataclass(frozen=True)
class Held:
    """What must hold at the patch, with what a real amplifier's gain and a card's steps may add."""

    file: RigFile
    source: str

    @classmethod
    def of(cls, rig: Rig, source: str) -> Self:
        return cls(rig.file, source)

    def by(self, found: list[Burst]) -> list[str]:
        own, patch, file = self.file.limits, self.file.actuator, self.file
        assert patch.min is not None and patch.max is not None and patch.capacitance is not None
        amplifier, relay = file.amplifier.settings, file.relay.settings["rating"]
        low = max(own.min, patch.min, -relay)
        high = min(own.max, patch.max, relay)
        share = 1 + AMPLIFIER_GAIN_ERROR + 1e-6
        broken, by_daq = [], self.source in ("daq", "each")
        for burst in found:
            farads = patch.capacitance * burst.patches
            rows = (
                ("min", -burst.low, -low, CODE),
                ("max", burst.high, high, CODE),
                ("peak_to_peak", burst.high - burst.low, own.peak_to_peak, 2 * CODE),
                ("slew", burst.slew, own.slew, 2 * CODE / 20e-6),
                ("current", farads * burst.slew, amplifier["current_peak"], farads * 2 * CODE / 20e-6),
                ("average", farads * burst.charge / 2, amplifier["current_average"], farads * CODE * 5e4),
                ("max_duration", burst.seconds, own.max_duration, 1e-4 if by_daq else 0.03),
            )
            # No generator fades out what it switches off, nor does it know of a mean.
            if self.source != "generator":
                rows += (("cut", burst.cut, own.slew, 2 * CODE / 20e-6),)
            if by_daq:
                rows += (("max_offset", abs(burst.mean), own.max_offset, CODE),)
            broken += [
                f"{name} {value} > {most}" for name, value, most, c in rows if value > most * share + c
            ]
        if busiest_minute(found) > own.duty * 60 + 1e-3 * len(found):
            broken.append(f"duty {busiest_minute(found)} > {own.duty * 60}")
        return broken


@st.composite
def files(draw: Callable[..., Any], source: str) -> RigFile:
    """A simulated rig with limits that a drive may break in every way."""
    file = load_rig_file("four-channel" if source == "each" else "simulated")
    assert file.amplifier and file.relay and file.table

    def near(loose: float, *tight: float) -> float:
        """Mostly a limit that is not met, so that each of the others is, in turn."""
        return loose * draw(st.sampled_from((1.0,) * 2 * len(tight) + tight))

    limits = DriveLimits(
        min=-near(50, 0.3, 0.6),
        max=near(50, 0.3, 0.6),
        peak_to_peak=near(100, 0.3, 0.7),
        slew=near(0.5e6, 0.02, 0.2),
        # A sweep is taken to last half a second longer, until it is surely off.
        max_duration=near(0.6, 0.1, 0.5) + 0.5 * (source == "generator"),
        duty=near(1.0, 0.02, 0.005),
        max_offset=near(2.0, 0.01, 0.3),
        max_end=near(2.0, 0.01, 0.3),
    )
    amplifier = file.amplifier.settings | {
        "input": file.amplifier.settings["input"] if source in ("daq", "each") else "source",
        "current_peak": near(0.1, 0.03, 0.3),
        "current_average": near(0.05, 0.003, 0.1),
        "rating_source": "a test",
    }
    table = {"rate_hz": draw(st.sampled_from((20_000.0, 50_000.0)))}
    low, high = -near(60, 0.2, 0.5), near(60, 0.2, 0.5)
    patch = Actuator(kind="piezo", min=low, max=high, capacitance=draw(st.floats(10e-9, 200e-9)))
    relay = file.relay.settings | {"rating": near(55, 0.2, 0.8), "rating_source": "a test"}
    more: dict[str, Device] = {
        "amplifier": Device(driver="e413-d2", **amplifier),
        "relay": Device(driver=file.relay.driver, **relay),
    }
    if source == "generator":
        box = {"resource": "TCPIP::127.0.0.1::5025::SOCKET", "output": "source", "highest": 5.0}
        more["generator"] = Device(driver="keysight-33500", **box)
    if source == "player":
        card = {"output": "source", "volts_per_full_scale": 1.4, "highest": 1.4, "high_pass_hz": 0}
        more["player"] = Device(driver="sound-card-output", **card)
    return changed(file, limits=limits, table=table, actuator=patch, **more)


def faded(shape: FloatArray) -> FloatArray:
    """At rest at both ends, and without a mean."""
    window = np.hanning(len(shape))
    return np.asarray(window * (shape - (window @ shape) / window.sum()))


@st.composite
def waves(draw: Callable[..., Any]) -> Callable[[float], FloatArray]:
    """A waveform at a rate, in shares of the largest that is allowed: smooth, rough, cut off, or none."""
    rough = ("noise", "steps", "constant", "cut", "spike", "nan")
    kind = draw(st.sampled_from(("tone",) * 14 + rough))
    size, offset = draw(SIZES), draw(st.sampled_from((0.0,) * 6 + (0.01, 0.1)))
    hertz, seconds = (
        draw(st.sampled_from((20, 100, 263.5, 600, 3000))),
        draw(st.sampled_from((0.004, 0.02, 0.06, 0.3, 0.61))),
    )
    pad, seed = draw(st.sampled_from((0, 0, 500))), draw(st.integers(0, 99))

    def wave(rate_hz: float) -> FloatArray:
        t = np.arange(max(2, round(seconds * rate_hz))) / rate_hz
        rng = np.random.default_rng(seed)
        shape = {
            "tone": lambda: faded(np.sin(2 * np.pi * hertz * t)),
            "noise": lambda: rng.uniform(-1, 1, len(t)),
            "steps": lambda: np.sign(np.sin(2 * np.pi * hertz * t)),
            "constant": lambda: np.ones(len(t)),
            "cut": lambda: np.sin(2 * np.pi * hertz * t + 1),
            "spike": lambda: (np.arange(len(t)) == len(t) // 2).astype(float),
            "nan": lambda: np.where(np.arange(len(t)) == 3, np.nan, 0.0),
        }[kind]()
        return np.pad(size * shape + offset * (kind != "nan"), pad)

    return wave


@dataclass
class Attempt:
    """One try to play, by every way that a script has."""

    way: str
    wave: Callable[[float], FloatArray]
    patches: tuple[str, ...]
    waveform: Waveform
    pause: float

    def at(self, rig: Rig) -> None:
        rate_hz = rig.table.rate_hz
        drive = rig.limits.peak * self.wave(rate_hz)
        waveform = self.waveform.scaled(rig.limits.peak)
        volts = drive / 50
        match self.way:
            case "excite":
                rig.excite(drive, self.patches, ["drive"])
            case "each":
                # Whichever comes first, another may be the largest.
                shares = np.linspace(1, -0.5, len(self.patches))[::-1]
                of = dict(zip(sorted(self.patches), shares, strict=True))
                rig.excite_each({patch: of[patch] * drive for patch in self.patches}, ["drive"])
            case "generate":
                rig.generate(waveform, self.patches, ["drive"])
            case "stream":
                rig.relay.connect(self.patches)
                with rig.daq.stream(["drive"], rate_hz, 500, 3000, {"amplifier": volts}) as stream:
                    stream.capture()
            case "generator":
                rig.relay.connect(self.patches)
                with suppress(HaploopError):
                    rig.generator.configure(waveform)
                with suppress(HaploopError):
                    rig.generator.arm()
                with suppress(HaploopError):
                    rig.generator.trigger()
                rig.clock.sleep(0.1)
            case "player":
                rig.relay.connect(self.patches)
                with rig.player.play(volts, rate_hz):
                    rig.clock.sleep(0.7)
            case "meddle":
                rig.excite(drive, self.patches, ["drive"], progress=lambda *_: self.meddle(rig, volts))

    def meddle(self, rig: Rig, volts: FloatArray) -> None:
        """While a drive is played."""
        rate_hz = rig.table.rate_hz
        for step in (
            lambda: rig.relay.connect(rig.relay.patches),
            lambda: rig.relay.connect(self.patches),
            lambda: rig.daq.stream(["laser"], rate_hz, 500, 600, {"amplifier": volts}),
            lambda: rig.daq.stream(["laser"], rate_hz * 2, 500, 600, {"amplifier": volts}),
            lambda: rig.excite(rig.limits.peak * self.wave(rate_hz), ["A"], ["laser"]),
            lambda: volts.__imul__(3),
        ):
            with suppress(HaploopError, ValueError):
                step()


@st.composite
def waveforms(draw: Callable[..., Any]) -> Waveform:
    """A generator's waveform, in shares of the largest that is allowed."""
    size, hertz = draw(SIZES), draw(st.floats(1, 300))
    match draw(st.sampled_from(("sweep", "sweep", "burst", "arbitrary"))):
        case "burst":
            return SineBurst(hertz, draw(st.integers(1, 40)), size)
        case "arbitrary":
            rate_hz, count = draw(st.sampled_from((500, 5000, 49_000, 120_000))), draw(st.integers(8, 4000))
            shape = faded(np.sin(2 * np.pi * hertz * np.arange(count) / rate_hz))
            steps = draw(st.booleans()) * np.random.default_rng(count).uniform(-0.1, 0.1, count)
            steps[[0, -1]] = 0
            # No generator plays less than a millivolt.
            return Arbitrary(size * (shape + steps) / np.abs(shape + steps).max(), rate_hz)
    return Sweep(hertz, hertz + draw(st.floats(5, 2000)), draw(st.floats(0.05, 0.6)), size)


@st.composite
def attempts(draw: Callable[..., Any], source: str) -> Attempt:
    ways = {
        "daq": ("excite", "excite", "excite", "excite", "stream", "meddle"),
        "each": ("each", "each", "each", "each", "excite", "stream", "meddle"),
        "generator": ("generate", "generate", "generate", "generator", "stream"),
        "player": ("excite", "excite", "excite", "player", "stream", "meddle"),
    }
    return Attempt(
        way=draw(st.sampled_from(ways[source])),
        wave=draw(waves()),
        patches=draw(st.sampled_from((("A",), ("B",), ("A", "C"), ("D", "A"), ("A", "B", "C", "D")))),
        waveform=draw(waveforms()),
        pause=draw(st.sampled_from((0.0, 0.0, 3.0, 30.0))),
    )


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("source", WIRED)
def test_nothing_beyond_a_limit_reaches_a_patch(source, full):
    outcomes: Counter[str] = Counter()

    @settings(
        max_examples=(400 if full else 15),
        deadline=None,
        database=None,
        derandomize=not full,
        # A rig is too slow to be shrunk: the first thing that is found is said.
        phases=(Phase.generate,),
        suppress_health_check=list(HealthCheck),
    )
    @given(file=files(source), tries=st.lists(attempts(source), min_size=2, max_size=4))
    def holds(file: RigFile, tries: list[Attempt]) -> None:
        with open_rig(file) as rig:
            record = rig.simulation.truth.record()
            if source == "player":
                # As the file says. A coupling capacitor would go on emptying after every drive.
                rig.player.audio.jack.high_pass_hz = 0.0
            for attempt in tries:
                try:
                    attempt.at(rig)
                    outcomes["played"] += attempt.way in ("excite", "each", "generate", "meddle")
                except InstrumentError as error:
                    # A player's odd waveform is not found again in what was measured of it.
                    assert source == "player" and "was stopped" not in str(error)
                    outcomes["played"] += 1
                except LimitError as error:
                    outcomes[str(error).split(" ", 4)[2]] += 1
                    outcomes["refused"] += 1
                rig.make_safe()
                rig.clock.sleep(attempt.pause)
        of_each = [of_patch(record, p) for p in rig.table.patches] if source == "each" else [record]
        for found in map(bursts, of_each):
            assert not Held.of(rig, source).by(found)
            outcomes["bursts"] += len(found)

    holds()
    print(source, dict(outcomes))
    # Limits that let nothing pass would prove nothing.
    assert outcomes["played"] and outcomes["bursts"] and outcomes["refused"], outcomes
