"""Nothing is played past the limiter: each way that a script or a driver has is tried."""

import re
from collections.abc import Iterator
from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from haploop.base.errors import ConfigurationError, LimitError
from haploop.instruments import Daq, Rig, Sweep, load_rig_file, open_rig
from haploop.instruments.config.rig_file import Device, DriveLimits, RigFile
from haploop.instruments.generator.role import Generator
from haploop.instruments.player.role import Player
from haploop.instruments.relay.role import Relay
from haploop.instruments.safety.audit import entries
from haploop.mocks.daq.twin import DaqTwin
from tests.instruments.safety.at_the_patch import Burst, bursts
from tests.raising import raises
from tests.rig_files import changed

pytestmark = pytest.mark.usefixtures("unproved")

RATE = 50_000.0
TONE = 10 * np.sin(2 * np.pi * 250 * np.arange(10_000) / RATE) * np.hanning(10_000)


@pytest.fixture
def rig() -> Iterator[Rig]:
    with open_rig(held(min=-30, max=30)) as rig:
        yield rig


def held(**limits: float) -> RigFile:
    return changed(load_rig_file("simulated"), limits=DriveLimits(**limits))


def amplifier(file: RigFile, **settings: object) -> Device:
    return Device(driver="e413-d2", **(file.amplifier.settings | settings))


def generator_rig() -> RigFile:
    file = load_rig_file("simulated")
    box = Device(driver="keysight-33500", resource="TCPIP::127.0.0.1::5025::SOCKET", output="source")
    return changed(file, generator=box, amplifier=amplifier(file, input="source"))


# Ways past it


@pytest.mark.parametrize(("file", "way"), [
    ("simulated", lambda r: r.daq.stream(["drive"], RATE, 500, 1000, {"amplifier": np.full(1000, 0.5)})),
    ("simulated", lambda r: r.daq.stream(["drive"], RATE, 500, 1000, {"amplifier": np.zeros(1000)})),
    ("sound-card", lambda r: r.player.play(np.zeros(1000), RATE)),
    (generator_rig(), lambda r: r.generator.configure(Sweep(10, 300, 1, 0.1))),
])  # fmt: skip
def test_an_instrument_of_a_rig_plays_nothing_by_itself(file, way):
    with open_rig(file, simulate="twin") as rig:
        rig.relay.connect(["A"])
        raises(LimitError, r"a rig plays only what its limiter has authorised", way, rig)
        rig.clock.sleep(0.5)
        assert [e["kind"] for e in entries(rig.audit.folder)].count("refused") == 1
    assert rig.simulation.truth.peak == 0


def test_a_generator_is_not_started_again_after_its_sweep():
    with open_rig(generator_rig()) as rig:
        rig.generate(Sweep(10, 300, 0.5, 20), ["A"], ["drive"])
        rig.generator.arm()
        raises(LimitError, "", rig.generator.trigger)
        assert not rig.generator.is_on


def test_a_driver_alone_plays_nothing(rig):
    alone = DaqTwin(rig.daq._settings, rig.simulation.plant)
    with pytest.raises(LimitError, match="without a rig's limits: open the rig with open_rig"):
        alone.stream(["drive"], RATE, 500, 1000, {"amplifier": np.zeros(1000)})
    with alone.stream(["drive"], RATE, 500, 1000) as stream:
        assert stream.capture().volts.shape == (1, 1000)


@pytest.mark.parametrize(("role", "name"), [
    (Daq, "stream"),
    (DaqTwin, "stream"),
    (Player, "play"),
    (Generator, "configure"),
    (Generator, "trigger"),
    (Relay, "connect"),
])  # fmt: skip
def test_no_driver_replaces_what_asks_the_limiter(role, name):
    with pytest.raises(TypeError, match=rf"Sly replaces \w+\.{name}, .* write _{name} instead"):
        type("Sly", (role,), {name: lambda *_: None})


def test_only_the_authorised_drive_is_played(rig, monkeypatch):
    stream = rig.daq.stream
    for change in (
        lambda rate, wave: (rate, {"amplifier": 1.01 * wave}),
        lambda rate, wave: (rate, {"amplifier": wave, "elsewhere": wave}),
        lambda rate, wave: (2 * rate, {"amplifier": wave}),
    ):

        def sly(channels: Any, rate: Any, block: Any, samples: Any, play: Any, change: Any = change) -> Any:
            return stream(channels, change(rate, 0)[0], block, samples, change(rate, play["amplifier"])[1])

        monkeypatch.setattr(rig.daq, "stream", sly)
        raises(LimitError, "", rig.excite, TONE, ["A"], ["drive"])
    assert rig.simulation.truth.peak == 0


def test_a_drive_that_is_changed_after_it_was_checked_is_played_as_it_was(rig):
    drive = TONE.copy()
    capture = rig.excite(drive, ["A"], ["drive"], progress=lambda *_: drive.fill(45.0))
    assert np.abs(capture.volts).max() == pytest.approx(0.1, rel=0.05)
    assert rig.simulation.truth.peak < 11


def test_while_a_drive_is_played_the_relay_only_opens_and_no_other_is(rig):
    seen: list[str] = []

    def meddle(*_: object) -> None:
        for step in (
            lambda: rig.relay.connect(["A", "B"]),
            lambda: rig.relay.connect(["A"]),
            lambda: rig.excite(TONE, ["A"], ["drive"]),
        ):
            seen.append(raises(LimitError, "being played", step))
        assert rig.simulation.truth.closed == {"A"}

    rig.excite(TONE, ["A"], ["drive"], progress=meddle)
    assert len(seen) == 9  # in each of its blocks


# Limits, to the last volt, in the plant


def played(file: RigFile, drive: np.ndarray, patches: tuple[str, ...] = ("A",)) -> list[Burst]:
    with open_rig(file) as rig:
        record = rig.simulation.truth.record()
        rig.excite(drive, patches, ["drive"])
    return bursts(record)


def tone(peak: float, hertz: float = 250.0, seconds: float = 0.2) -> np.ndarray:
    t = np.arange(round(seconds * RATE)) / RATE
    return np.asarray(peak * np.sin(2 * np.pi * hertz * t) * np.sin(np.pi * t / seconds) ** 2)


@pytest.mark.parametrize(("limits", "drive", "says", "seen"), [
    ({"max": 20.0}, lambda s: s * tone(19.99), "rises to", lambda b: b.high / 20),
    ({"min": -20.0}, lambda s: s * tone(19.99), "falls to", lambda b: -b.low / 20),
    ({"peak_to_peak": 40.0}, lambda s: s * tone(19.99), "has a peak-to-peak voltage of",
     lambda b: (b.high - b.low) / 40),
    ({"slew": 6e4}, lambda s: s * tone(38.2), "slews at", lambda b: b.slew / 6e4),
    ({"max_duration": 0.2}, lambda s: tone(20, seconds=0.2 * s), "lasts", lambda b: b.seconds / 0.2),
])  # fmt: skip
def test_a_limit_is_met_and_not_passed(limits, drive, says, seen):
    file = held(**limits)
    (burst,) = played(file, drive(0.995))
    assert 0.97 < seen(burst) < 1.011  # the amplifier's own gain is off by 1 %
    raises(LimitError, rf"The drive {says} .* at sample \d+, .* of the rig file's", played, file, drive(1.02))


def test_a_refusal_says_whose_limit_by_how_much_and_where(rig):
    refused = raises(LimitError, "", rig.excite, tone(33), ["A"], ["drive"])
    found = re.fullmatch(
        r"The drive falls to -(.*) V at sample (\d+), (.*) V beyond the -30 V of the rig file's \[limits\]\.",
        refused,
    )
    assert found and float(found[1]) - float(found[3]) == pytest.approx(30, abs=0.02)
    assert tone(33)[int(found[2])] == pytest.approx(-float(found[1]), abs=0.01)
    with open_rig("simulated") as wide:
        raises(LimitError, r"48 V of the relay\.$", wide.excite, tone(49), ["A"], ["drive"])
        with pytest.raises(LimitError, match=r"0\.1 A of the amplifier\.$"):
            wide.excite(tone(40, 1800), ["A", "B", "C", "D"], ["drive"])


def test_silence_elsewhere_does_not_make_a_current_harmless():
    file = load_rig_file("simulated")
    loud = tone(40, 250, 1.0)
    with open_rig(changed(file, amplifier=amplifier(file, current_average=0.8e-3))) as rig:
        rig.excite(loud * 0.5, ["A"], ["drive"])
        for drive in (loud, np.pad(loud, (0, 100_000)), np.concatenate([tone(1), np.zeros(100_000), loud])):
            raises(LimitError, "draws on average", rig.excite, drive, ["A"], ["drive"])


def test_what_a_player_makes_of_a_drive_is_held_to_the_limits():
    """Resampling overshoots at an edge that is steeper than the card can play."""
    rng = np.random.default_rng(1)
    edges = np.repeat(np.sign(rng.uniform(-1, 1, 200)), 4) * 4.9
    edges = np.concatenate([[0.0], edges - edges.mean(), [0.0]])
    strict = changed(load_rig_file("sound-card"), limits=DriveLimits(min=-5, max=5, peak_to_peak=11))
    with open_rig(strict, simulate="twin") as rig:
        assert np.abs(edges).max() < 5
        raises(LimitError, r"rises to|falls to|peak-to-peak", rig.excite, edges, ["A"], ["drive"])
    assert rig.simulation.truth.peak == 0


def test_what_no_limit_is_known_for_is_not_played():
    file = changed(load_rig_file("simulated"), amplifier=None)
    with open_rig(file) as rig, pytest.raises(ConfigurationError, match=r"no \[amplifier\]"):
        rig.excite(TONE, ["A"], ["drive"])


def test_no_value_in_what_was_opened_can_be_changed(rig):
    file = rig.file
    for part in (file, file.limits, file.abort, file.table, file.sensors.drive, rig.limits):
        for name in getattr(type(part), "model_fields", None) or vars(part):
            raises((ValidationError, FrozenInstanceError), "", setattr, part, name, None)
    file.relay.settings["rating"] = 500.0  # type: ignore[union-attr]  a copy, or else of no effect
    file.amplifier.settings["gain"] = 1.0
    raises(LimitError, "", rig.excite, 9 * TONE, ["A"], ["drive"])
