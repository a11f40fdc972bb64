"""A rig is described by answers: what is found is offered, and the file is valid, or not there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import haploop
from haploop.instruments.describing import Found, FoundCard
from haploop.mocks.computer import simulated_computer
from tests.command_line import Run

Answers = dict[str, str]
TABLE = {
    "its product": "TREK 2205", "Gain": "50", "Lowest output": "-500", "Highest output": "500",
    "Peak current": "0.02", "Average current": "0.01", "Bandwidth": "20000", "monitor or a divider": "100",
    "Capacitance": "90e-9", "Lowest voltage": "-100", "Highest voltage": "400",
    "protects it": "a clamp at 400 V", "Its product": "PDV-100", "Scale": "0.005", "Full scale": "0.02",
    "Delay": "1.1e-3",
}  # fmt: skip


def asker(answers: Answers, asked: list[str]) -> Callable[[str, str], str]:
    """Answers the first question that contains a key of `answers`, and takes the default of others."""

    def ask(question: str, default: str) -> str:
        asked.append(question)
        return next((answer for part, answer in answers.items() if part in question), default)

    return ask


def described(path: Path, answers: Answers, found: Found | None = None) -> tuple[haploop.RigFile, list[str]]:
    asked: list[str] = []
    told: list[str] = []
    file = haploop.new_rig(path, asker(answers, asked), found or simulated_computer(), told.append)
    assert file.model_dump() == haploop.load_rig_file(path).model_dump()
    return file, [*asked, *told]


def test_a_rig_that_records_only(tmp_path: Path) -> None:
    """A load cell and an IEPE accelerometer on the card that was found."""
    answers = {"Force:": "20 N/V", "Vertical acceleration:": "100 mV/g", "contact": "2.5", "table?": "no"}
    file, asked = described(tmp_path / "lab.toml", answers)
    assert file.name == "lab" and file.table is None and file.daq.settings["devices"] == {"Dev1": "USB-6211"}
    assert any("USB-6211 (Dev1)" in question for question in asked)
    channels = file.daq.settings["channels"]
    assert [channels[c]["terminal"] for c in ("force", "acceleration", "switch")] == [
        "Dev1/ai0", "Dev1/ai1", "Dev1/ai2",
    ]  # fmt: skip
    assert file.sensors.force is not None and file.sensors.acceleration is not None
    assert file.sensors.force.matrix == ((20.0,),) and file.sensors.acceleration.ac_coupled


@pytest.mark.parametrize(
    ("sensor", "answer", "more", "expected"),
    [
        ("Force", "-4.3 pC/N", {"charge amplifier": "20 mV/pC", "high-pass": "0.16"}, 1 / (4.3e-12 * 20e9)),
        (
            "Force",
            "2 mV/V",
            {"excitation": "10", "rated load": "50", "Gain of": "100"},
            50 / (2e-3 * 10 * 100),
        ),
        ("Force", "0.25 V/N", {}, 4.0),
        ("Vertical acceleration", "100 mV/g", {"Its high-pass": ""}, 98.0665),
        ("The cap's travel", "0.5 mm/V", {}, 5e-4),
        ("The cap's velocity", "20 mm/s/V", {}, 0.02),
    ],
)
def test_sensors_as_data_sheets_have_them(
    tmp_path: Path, sensor: str, answer: str, more: Answers, expected: float
) -> None:
    file, _ = described(
        tmp_path / "lab.toml", {f"{sensor}:": answer, f"{sensor}, ": answer, "table?": "no", **more}
    )
    (linear,) = file.sensors.linear.values()
    assert abs(linear.matrix[0][0]) == pytest.approx(expected)


def test_a_rig_that_plays_is_rehearsed(tmp_path: Path, run: Run) -> None:
    answers = {"Force:": "20 N/V", "Vertical acceleration:": "100 mV/g", "Largest drive": "40", **TABLE}
    path = tmp_path / "lab.toml"
    file, asked = described(path, answers)
    assert file.wiring == "direct" and file.limits.max == 40 and file.amplifier is not None
    assert not any("Its gain" in question and "[50]" in question for question in asked)
    result = run("doctor", "--rig", path, "--simulate", "twin")
    assert result.exit_code == 0, result.output


def test_modules_get_terminals_that_they_have(tmp_path: Path) -> None:
    found = Found(cards=(FoundCard("cDAQ1Mod1", "NI 9234", 4, 0), FoundCard("cDAQ1Mod2", "NI 9263", 0, 4)))
    answers = {"Force:": "112 mV/N", "Vertical acceleration:": "100 mV/g", **TABLE}
    file, _ = described(tmp_path / "lab.toml", answers, found)
    channels, outputs = file.daq.settings["channels"], file.daq.settings["outputs"]
    assert {c["terminal"][:9] for c in channels.values()} == {"cDAQ1Mod1"}
    assert outputs["amplifier"]["terminal"] == "cDAQ1Mod2/ao0"
    assert file.rate_hz == 5120 and file.table is not None and file.table.rate_hz == 51_200


def test_a_relay_on_a_port_that_was_found(tmp_path: Path) -> None:
    answers = {
        "connects the actuator": "serial-relay",
        "which port": "2",
        "limit": "40",
        **TABLE,
        "Force:": "20 N/V",
    }
    file, _ = described(tmp_path / "lab.toml", answers)
    assert file.relay is not None and file.relay.settings["port"] == "COM5"


def test_a_generator_that_visa_lists(tmp_path: Path) -> None:
    answers = {"function generator": "keysight-33500", "Force:": "20 N/V", **TABLE}
    file, asked = described(tmp_path / "lab.toml", answers)
    assert file.generator is not None and file.generator.settings["resource"].startswith("USB0::0x0957")
    assert any("0x0957" in question for question in asked)


def test_what_is_no_rig_is_said_and_asked_again(tmp_path: Path) -> None:
    """Five times, with the answers as defaults; then nothing is written."""
    told: list[str] = []
    ask = asker({"Force:": "20 parsec/V", "table?": "no"}, [])
    with pytest.raises(haploop.ConfigurationError, match="was not written"):
        haploop.new_rig(tmp_path / "lab.toml", ask, simulated_computer(), told.append)
    assert len(told) == 5 and all("parsec" in sentence for sentence in told)
    assert not list(tmp_path.iterdir())


def test_a_wrong_answer_is_asked_again(tmp_path: Path) -> None:
    given = iter(["17", "toaster", "2", *[""] * 100])
    asked: list[str] = []

    def ask(question: str, default: str) -> str:
        asked.append(question)
        if "What takes the samples" in question:
            return next(given)
        if "table?" in question:
            return "no"
        return "100 mV/g" if "Vertical acceleration:" in question else default

    file = haploop.new_rig(tmp_path / "lab.toml", ask, simulated_computer(), asked.append)
    assert file.daq.driver == "sound-card" and "'toaster' is none of them." in asked


def test_a_figure_with_its_unit_is_asked_again_at_once(tmp_path: Path) -> None:
    """And not all forty questions, when the file turns out to be none."""
    given = iter(["7.4 kHz", "nan", "7400"])
    told: list[str] = []
    plain = asker({"Force:": "20 N/V", **TABLE}, [])

    def ask(question: str, default: str) -> str:
        return next(given) if "Amplifier: Bandwidth" in question else plain(question, default)

    file = haploop.new_rig(tmp_path / "lab.toml", ask, simulated_computer(), told.append)
    assert file.amplifier is not None and file.amplifier.settings["bandwidth_hz"] == 7400
    assert told == [f"'{one}' is no number: write it without its unit." for one in ("7.4 kHz", "nan")]


def test_nothing_is_overwritten(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "lab.toml"
    path.write_text("mine\n")
    refused = run("rig", "new", path, "--simulate")
    assert refused.exit_code == 2 and "exists" in refused.stderr and path.read_text() == "mine\n"


def test_what_cannot_be_looked_for_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> list[FoundCard]:
        raise RuntimeError("no driver\nat all")

    monkeypatch.setattr("haploop.instruments.describing.found._cards", broken)
    found = haploop.look_for_hardware()
    assert found.cards == () and "NI cards could not be looked for (no driver at all)." in found.missing
