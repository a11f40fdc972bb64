"""A cable from output to input tells volts, latency and coupling, and the findings say what to write."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import haploop
from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.calibration import examine_loop
from haploop.calibration.response import linear_sweep
from haploop.calibration.self_test import loop_test
from haploop.instruments import Rig, load_rig_file
from haploop.instruments.config import Device, RigFile
from haploop.mocks.daq.sound_card import DuplexCard

pytestmark = [pytest.mark.requires("simulation"), pytest.mark.usefixtures("few_callbacks")]

CARD = load_rig_file(Path(__file__).with_name("card.toml"))


@pytest.fixture(autouse=True)
def _a_person_reads_fast(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop_test, "_READ", 1.0)


def with_daq(**changes: Any) -> RigFile:
    device = Device.model_validate({"driver": CARD.daq.driver, **CARD.daq.settings, **changes})
    return CARD.model_copy(update={"daq": device})


def card_of(rig: Rig) -> DuplexCard:
    card = rig.daq.audio
    assert isinstance(card, DuplexCard)
    return card


def looped(
    change: Callable[[DuplexCard], object] = lambda _card: None, volts: float | None = None, **daq: Any
) -> dict[str, tuple[str, str]]:
    with haploop.open_rig(with_daq(**daq), simulate="twin") as rig:
        change(card_of(rig))
        findings = examine_loop(rig, "drive", volts)
        assert not rig.simulation.plant.cables and rig.simulation.truth.peak == 0
    return {finding.name: (finding.status, finding.sentence) for finding in findings}


def test_a_card_as_the_file_says_is_green_but_for_the_voltmeter():
    found = looped()
    assert {name: status for name, (status, _) in found.items()} == {
        "Volts of amplifier": "yellow",
        "Volts of drive": "green",
        "Latency": "green",
        "AC coupling": "green",
    }
    assert "0.3394 V rms at 200 Hz" in found["Volts of amplifier"][1]


@pytest.mark.long
def test_the_latency_is_told():
    assert looped(latency=0)["Latency"] == (
        "red",
        "The input is late by 1152 samples in each of 3 plays: write latency = 1152 in [daq].",
    )

    def slower(card: DuplexCard) -> None:
        card.latency = 2000

    assert "write latency = 2000 in [daq]" in looped(slower)["Latency"][1]


def test_another_latency_each_time_is_no_latency(monkeypatch):
    opened = DuplexCard.Stream

    def later(card: DuplexCard, **settings: Any) -> Any:
        card.latency += 64
        return opened(card, **settings)

    monkeypatch.setattr(DuplexCard, "Stream", later)
    status, sentence = looped()["Latency"]
    assert status == "red" and "another time each, so no play is aligned" in sentence


@pytest.mark.long
def test_volts_are_told_with_and_without_a_voltmeter():
    """The card puts out 1.1 V where the file says 1.4, and its input takes 1.5 V as the file says."""

    def quieter(card: DuplexCard) -> None:
        card.named["amplifier"].full_scale = 1.1

    told = looped(quieter)["Volts of drive"]
    assert told[0] == "red" and "write volts_per_full_scale = 1.9" in told[1]  # if the output were right
    real = 0.48 * 1.1 / 1.4 / 2**0.5
    told = looped(quieter, volts=real)
    assert "write volts_per_full_scale = 1.1 in [daq.outputs.amplifier]" in told["Volts of amplifier"][1]
    assert told["Volts of drive"][0] in ("green", "yellow")


def test_the_corner_is_told():
    def other(card: DuplexCard) -> None:
        card.named["amplifier"].high_pass_hz = card.high_pass_hz["drive"] = 12.0

    status, sentence = looped(other)["AC coupling"]
    assert status == "red"
    assert float(sentence.partition("high_pass_hz = ")[2].split()[0]) == pytest.approx(12, rel=0.05)


def test_wires_that_are_swapped_or_missing_are_told(monkeypatch):
    def turned(card: DuplexCard) -> None:
        card.full_scale["drive"] *= -1

    assert "upside down: swap the wires" in looped(turned)["Latency"][1]
    monkeypatch.setattr(DuplexCard, "heard", lambda _card, count, times, *_: np.zeros((len(times), count)))
    assert "drive hears nothing of 0.48 V at amplifier" in looped()["Loop"][1]


def test_the_command_says_the_same(run):
    file = str(Path(__file__).with_name("card.toml"))
    ran = run("doctor", "--rig", file, "--simulate", "twin", "--loop", "drive", "--json")
    assert ran.exit_code == 0 and '"Latency"' in ran.stdout
    ran = run("doctor", "--rig", file, "--simulate", "twin", "--volts", "1")
    assert ran.exit_code == 2 and "--volts needs --loop" in ran.stderr


@pytest.fixture
def cabled(mode: str) -> None:
    """The loop's cable is simulated by the twins; terminals of simulated NI cards on a wire have none yet."""
    if mode == "wire":
        pytest.skip("no cable can be plugged between terminals of NI cards on a wire")


@pytest.mark.usefixtures("cabled")
def test_ni_cards_are_measured_as_well(open):
    rig = open("haptable")
    found = {f.name: f for f in examine_loop(rig, "drive")}
    assert {found[name].status for name in ("Volts of drive", "Latency", "AC coupling")} == {"green"}


@pytest.mark.parametrize("name", ["voice-coil", "no-ni"])
def test_without_a_relay_nothing_is_played_into_a_cable(name, open):
    rig = open(name)
    with pytest.raises(ConfigurationError, match=r"has no relay, so a loop's plays may reach its actuator"):
        examine_loop(rig, "drive")
    assert rig.simulation.truth.peak == 0 and not rig.simulation.plant.cables


def test_without_a_relay_the_monitor_tells_the_latency():
    """As docs/how-to/sound-card.md says: the card is late by 1152 frames, its amplifier by one."""
    # Doctor's sweep: the proof of the gain is too short to tell.
    file = load_rig_file("no-ni")
    daq = Device.model_validate(
        {"driver": file.daq.driver, **file.daq.settings, "latency": 0, "monitor": "drive"}
    )
    sweep = linear_sweep(48_000.0, 0.3, 625.0, 1.0)
    file = file.model_copy(update={"daq": daq})
    with (
        haploop.open_rig(file, simulate="twin") as rig,
        pytest.raises(InstrumentError, match="with a latency of 1153 frames"),
    ):
        rig.excite(sweep, ["A"], ["drive"])


def test_what_cannot_be_measured_so_is_refused(open):
    with pytest.raises(ConfigurationError, match="is not fed by one output of the DAQ"):
        examine_loop(open("sound-card"), "drive")
    with pytest.raises(ConfigurationError, match="nan V is no reading of a voltmeter"):
        examine_loop(open("haptable"), "drive", float("nan"))
