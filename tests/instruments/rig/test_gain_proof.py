"""The amplifier's gain is proved at a volt before the first play of a session."""

from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from haploop.base.errors import InstrumentError, LimitError
from haploop.instruments import Rig, Sweep, load_rig_file, open_rig
from haploop.instruments.limits import Limits
from haploop.instruments.rig.monitoring import TOO_MUCH, UnshownError, level_of, loudest, tone
from haploop.instruments.safety.audit import entries
from haploop.mocks.faults.relay import AmplifierGain
from haploop.mocks.faults.sensors import SensorDisconnected
from tests.instruments.safety.at_the_patch import bursts
from tests.instruments.safety.test_limiter import TONE, generator_rig
from tests.raising import raises
from tests.rig_files import changed


def excite(rig: Rig) -> Any:
    return rig.excite(np.pad(TONE, 100), ["A"], ["drive"])


def sweep(rig: Rig) -> Any:
    return rig.generate(Sweep(10, 300, 0.3, 20), ["A"], ["drive"])


SOURCES = pytest.mark.parametrize(("file", "play"), [
    *((load_rig_file(name), excite) for name in ("simulated", "four-channel", "sound-card")),
    (generator_rig(), sweep),
])  # fmt: skip


@SOURCES
def test_a_gain_above_the_files_is_found_at_a_volt(file, play):
    """A tenth of the true gain of 50 in the file once put 168 V on the patch for 0.2 s."""
    stated = 25.0
    amplifier = file.amplifier.model_copy()
    amplifier.__pydantic_extra__ = dict(amplifier.settings) | {"gain": stated, "rating_source": "a test"}
    with open_rig(file.model_copy(update={"amplifier": amplifier}), simulate="twin") as rig:
        record = rig.simulation.truth.record()
        raises(InstrumentError, r"played to prove the gain: correct gain in \[amplifier\]", play, rig)
        assert rig.simulation.truth.peak < 1.1 * 50 / stated
        assert sum(burst.seconds for burst in bursts(record)) < 0.3
        assert rig.lockout is not None and "prove the gain" in rig.lockout.why
        assert [e["kind"] for e in entries(rig.audit.folder)].count("tripped") == 1
        raises(LimitError, "locked out", play, rig)


@SOURCES
def test_a_gain_is_proved_once_in_a_session(file, play):
    with open_rig(file, simulate="twin") as rig:
        record = rig.simulation.truth.record()
        play(rig)
        first, *others = bursts(record)
        assert first.high == pytest.approx(1, rel=0.05) and first.seconds < 0.3
        assert others and max(burst.high for burst in others) > 9
        count = len(bursts(record))
        play(rig)
        assert len(bursts(record)) == count + len(others)


def test_each_channel_of_an_amplifier_is_proved():
    with open_rig("four-channel", simulate="twin") as rig:
        for patches in ({"A": TONE, "C": TONE}, {"A": TONE, "B": TONE}):
            rig.excite_each(patches, ["drive"])
        played = [e["output"] for e in entries(rig.audit.folder) if e["kind"] == "played" and e["peak"] <= 1]
        assert played == ["amplifier", "amplifier_c", "amplifier_b"]


@pytest.mark.parametrize("mode", ["twin", "wire"])
def test_a_gain_that_is_wrong_on_one_channel_is_found_at_a_volt(mode):
    wrong = {"faults": [{"kind": "amplifier-gain", "patch": "C", "gain": 250.0}]}
    with open_rig("four-channel", simulate=mode, simulation=wrong) as rig:
        rig.excite_each({"A": TONE, "B": TONE}, ["drive"])
        record = rig.simulation.truth.record()
        with pytest.raises(InstrumentError, match=r"Patch C got 5\.\d* V when 1 V were played"):
            rig.excite_each(dict.fromkeys("ABCD", TONE), ["drive"])
        assert max(burst.high for burst in bursts(record)) < 5.5
        assert rig.lockout is not None and "Patch C" in rig.lockout.why
        raises(LimitError, "locked out", rig.excite_each, {"A": TONE}, ["drive"])
        assert not rig.simulation.truth.closed


def blind(file: str) -> tuple[str, str, str, list[dict[str, Any]]]:
    """The dead monitor, its patch, all patches, and the faults: nothing shows a gain five times too large."""
    dead, patch, patches = ("drive_c", "C", "ABCD") if file == "four-channel" else ("drive", "A", "A")
    gain = {"kind": "amplifier-gain", "gain": 250.0, "patch": patch}
    return dead, patch, patches, [{"kind": "sensor-disconnected", "channel": dead}, gain]


@pytest.mark.parametrize(("mode", "file"), [("twin", "four-channel"), ("wire", "simulated")])
def test_nothing_is_played_while_a_patchs_monitor_is_dead(mode, file):
    """With a monitor that shows nothing, neither the proof nor the abort monitor looks after the patch."""
    _, patch, patches, faults = blind(file)
    with open_rig(file, simulate=mode, simulation={"faults": faults}) as rig:
        for _ in range(2):
            with pytest.raises(InstrumentError, match=f"that patch {patch} was to get .* nothing else"):
                rig.excite_each(dict.fromkeys(patches, TONE), ["drive"])
        assert rig.simulation.truth.peak < 5.5 and not rig.simulation.truth.closed


def test_a_volt_that_shows_on_another_patchs_monitor_is_said(monkeypatch):
    with open_rig("four-channel", simulate="twin") as rig:
        right = rig.monitor
        monkeypatch.setattr(rig._own, "monitor", lambda p: right({"B": "C", "C": "B"}.get(p, p)))
        with pytest.raises(InstrumentError, match=r"patch B was to get .* and drive_b shows it"):
            rig.excite_each({"A": TONE, "B": TONE}, ["drive"])
        assert rig.simulation.truth.peak < 1.1


def test_what_is_refused_of_several_drives_is_refused_before_the_first_is_proved():
    with open_rig("four-channel", simulate="twin") as rig:
        broken, high = TONE.copy(), 6 * TONE
        broken[100] = np.nan
        for bad, says in ((broken, "is nan at sample 100"), (high, "falls to"), (TONE[:-1], "of one length")):
            raises(LimitError, says, rig.excite_each, {"A": TONE, "B": TONE, "C": bad, "D": TONE}, ["drive"])
        assert rig.simulation.truth.peak == 0


def test_nothing_is_proved_for_a_drive_that_is_refused_or_silent():
    with open_rig("simulated") as rig:
        raises(LimitError, "falls to", rig.excite, 10 * TONE, ["A"], ["drive"])
        rig.excite(0 * TONE, ["A"], ["drive"])
        rig.excite(TONE, [], ["drive"])
        assert rig.simulation.truth.peak == 0


@pytest.mark.parametrize("mains_hz", [50.0, 60.0])
@pytest.mark.parametrize("hum", [0.0, 1.0])
def test_the_amplitude_is_the_tones(mains_hz, hum):
    """Wherever it is, on an offset, in the noise of a monitor and with hum as large: no lockout for these."""
    rng = np.random.default_rng(3)
    for noise in (0.0, 0.03, 0.3):
        for before in (0, 777, 20_000):
            for phase in np.arange(0, 6.28, 0.4):
                volts = 0.4 + np.pad(tone(1.0, 50_000.0), (before, 500))
                volts += noise * rng.standard_normal(len(volts))
                t = np.arange(len(volts)) / 50_000.0
                for harmonic, share in ((1, 1.0), (2, 0.3), (3, 0.2)):
                    volts += hum * share * np.sin(2 * np.pi * harmonic * mains_hz * t + phase)
                assert abs(loudest(volts, 50_000.0) - 1) < 0.03 + 0.12 * hum < TOO_MUCH - 1


def test_a_gain_that_cannot_be_proved_is_logged_once():
    file = changed(load_rig_file("simulated"), sensors={"drive": None})
    with open_rig(file, simulate="twin") as rig:
        rig.excite(TONE, [], ["laser"])
        assert not [e for e in entries(rig.audit.folder) if e["kind"] == "unproved"]
        for _ in range(2):
            rig.excite(TONE, ["A"], ["laser"])
        said = [e for e in entries(rig.audit.folder) if e["kind"] in ("unproved", "played")]
    assert [e["kind"] for e in said] == ["played", "unproved", "played", "played"]
    assert said[1]["input"] == "amplifier" and "cannot be proved on this rig" in said[1]["why"]


@pytest.mark.parametrize(("mode", "file", "stands"), [
    ("twin", "simulated", 0.0),
    ("twin", "simulated", 0.2),
    ("twin", "four-channel", 0.0),
    ("wire", "simulated", 0.0),
])  # fmt: skip
def test_a_monitor_dies_later(mode, file, stands, monkeypatch):
    """And the one after that is not played: a gain that is wrong by then reaches no patch.

    A dead monitor may show volts that stand (`stands`, at its terminal), as many as the play had.
    """
    dead, patch, patches, faults = blind(file)
    cut, gained, broken = SensorDisconnected.channel, AmplifierGain.gain, set[str]()

    def channel(own: Any, name: str, volts: Any, times: Any) -> Any:
        return cut(own, name, volts, times) + stands * (name == dead) if "monitor" in broken else volts

    def gain(own: Any, right: Any, run: Any) -> Any:
        return gained(own, right, run) if "gain" in broken else right

    monkeypatch.setattr(SensorDisconnected, "channel", channel)
    monkeypatch.setattr(AmplifierGain, "gain", gain)
    with open_rig(file, simulate=mode, simulation={"faults": faults}) as rig:
        rig.excite_each(dict.fromkeys(patches, TONE), ["drive"])
        broken.add("monitor")
        with pytest.raises(UnshownError, match=f"each volt that patch {patch} was to get when it was played"):
            rig.excite_each(dict.fromkeys(patches, TONE), ["drive"])
        assert rig.simulation.truth.peak < 11 and not rig.simulation.truth.closed
        broken.add("gain")
        for _ in range(2):
            with pytest.raises(UnshownError, match="when the gain was proved"):
                rig.excite_each(dict.fromkeys(patches, TONE), ["drive"])
        assert rig.simulation.truth.peak < 11 and not rig.simulation.truth.closed


@pytest.mark.parametrize(("limit", "level"), [(40.0, 1.0), (2.0, 0.5)])
def test_the_proof_is_a_quarter_of_a_small_limit(limit, level):
    """A gain four times too large would still be within it."""
    assert level_of(Limits(max=limit, min=-limit)) == level


@pytest.mark.parametrize(("gain", "refused"), [(1.2, False), (1.3, True)])
def test_a_quarter_more_than_was_asked_for_locks_the_rig_out(gain, refused):
    fault = {"kind": "amplifier-gain", "gain": 50 * gain, "patch": "A"}
    with open_rig("simulated", simulation={"faults": [fault]}) as rig:
        with suppress(InstrumentError):
            rig.prove_gain("A")
        assert (rig.lockout is not None) is refused
        assert rig.simulation.truth.peak == pytest.approx(gain, rel=0.02)
