"""What the doctor says of a rig that is as its file says, and of one that is not."""

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.calibration.self_test import Finding, examine, examine_each
from haploop.calibration.self_test.sensor_test import check_camera
from haploop.calibration.self_test.verdict_test import check_bands
from haploop.instruments import Rig, load_rig_file, open_rig
from haploop.instruments.config import RigFile
from haploop.instruments.config.rig_file import Device
from haploop.instruments.operator import UnansweredError
from haploop.mocks.plant import PlantSource, Surface, random_modal


def of_status(findings: list[Finding], status: str) -> list[Finding]:
    return [finding for finding in findings if finding.status == status]


def assert_safe(rig: Rig) -> None:
    rig.clock.sleep(0.1)
    assert rig.simulation.truth.closed == frozenset()
    assert max(map(abs, rig.simulation.truth.patch_voltages.values())) < 0.02
    assert rig.simulation.truth.peak < 11


@pytest.mark.parametrize(("name", "seed"), [("haptable", 0), ("haptable", 7), ("four-channel", 0)])
def test_a_rig_as_its_file_says_is_all_green(open, name, seed):
    rig = open(name, seed=seed)
    findings = examine(rig)
    assert {f.status for f in findings} == {"green"}, findings
    assert {f.instrument for f in findings} == {
        "daq", "amplifier", "relay", "vibrometer", "force", "acceleration", "table", "rig"
    }  # fmt: skip
    assert_safe(rig)


@pytest.mark.parametrize(
    ("base", "differs", "says"),
    [
        ("usb-6211", "[sensors.acceleration]\nlow_pass_hz = 10000", "Write rate_hz = 20000 or more"),
        ("usb-6211", "[table]\nrate_hz = 9000", "Write rate_hz in [table] = 10000 or more"),
        ("usb-6211", "[sensors.acceleration]\nlow_pass_hz = 2500", None),
        ("usb-6211", "[sensors.acceleration]\nlow_pass_hz = 60", "is dull"),
        ("compactdaq-iepe", "[sensors.acceleration]\nlow_pass_hz = 10000",
         None),  # a delta-sigma card filters
        ("no-ni", "[sensors.acceleration]\nlow_pass_hz = 30000", None),  # and so does audio
        ("minimal", "[sensors.acceleration]\ncapacitor = 10e-9", None),
    ],
)  # fmt: skip
def test_what_a_sensor_passes_beyond_half_the_rate_or_short_of_the_skin(base, differs, says, tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(f'base = "{base}"\nname = "mine"\n{differs}\n')
    with open_rig(path, simulate="twin") as rig:
        told = list(check_bands(rig))
    sentences = " ".join(finding.sentence for finding in told)
    assert (says in sentences) if says else not told, told
    assert {finding.status for finding in told} <= {"green" if says == "is dull" else "yellow"}


def test_figures_that_are_not_the_products_own_are_shown_with_their_source(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text('base = "simulated"\n[relay]\nrating = 60\nrating_source = "label on box 3"\n')
    with open_rig(path) as rig:
        (shown,) = [finding for finding in examine(rig) if finding.name == "Ratings"]
    assert (shown.instrument, shown.status) == ("relay", "yellow") and "label on box 3" in shown.sentence


def gains(gain: float, ratio: float | None) -> list[Finding]:
    """Yellow findings on a rig whose file has this gain of the amplifier and this divider's ratio."""
    file = load_rig_file("simulated")
    assert file.amplifier is not None and file.sensors.drive is not None
    settings = file.amplifier.settings | {"gain": gain, "rating_source": "a test"}
    drive = file.sensors.drive.model_copy(update={"ratio": ratio}) if ratio else None
    update = {
        "amplifier": Device(driver="e413-d2", **settings),
        "sensors": file.sensors.model_copy(update={"drive": drive}),
    }
    with open_rig(file.model_copy(update=update), simulate="twin") as rig:
        found = [finding for finding in examine(rig) if finding.name == "Gain"]
        assert rig.simulation.truth.peak < 11
    return [finding for finding in found if finding.status == "yellow"]


def test_a_gain_and_a_divider_that_only_agree_with_each_other_are_said():
    (said,) = gains(25.0, 50.0)
    assert said.instrument == "amplifier"
    assert "gain = 25 in [amplifier] and ratio = 50 in [sensors.drive] are both 0.5 times" in said.sentence
    assert "2 times the volts" in said.sentence
    for gain, ratio in ((50.0, 100.0), (50.0, 50.0), (25.0, 100.0), (25.0, 60.0)):
        assert not gains(gain, ratio)


def test_a_gain_that_cannot_be_proved_is_said():
    (said,) = gains(50.0, None)
    assert "cannot be proved on this rig" in said.sentence


FOUR = [
    ({"kind": "amplifier-gain", "patch": "C", "gain": 40}, "amplifier", "0.797 V arrive at patch C"),
    ({"kind": "amplifier-gain", "patch": "C", "gain": 200}, "table", "Patch C got 4.0"),
    ({"kind": "sensor-disconnected", "channel": "drive_c"}, "relay", "no voltage reaches it"),
    ({"kind": "relay-welded", "patch": "D"}, "relay", "no voltage reaches it"),
    ({"kind": "relay-welded", "patch": "D", "after": 50.69}, "relay", "a contact is welded closed"),
    ({"kind": "patch-dead", "patch": "B"}, "table", "the patch is dead"),
]
"""On one of four channels."""


@pytest.mark.many_plays
@pytest.mark.parametrize(
    ("fault", "instrument", "says"),
    [
        ({"kind": "relay-swapped"}, "relay", "patches A and B are swapped"),
        ({"kind": "relay-swapped", "patches": ["D", "C"]}, "relay", "patches C and D are swapped"),
        ({"kind": "vibrometer-range", "range": 0.5}, "vibrometer", "set the range to 20 mm/s"),
        ({"kind": "force-calibration"}, "force", "Check the serial number on the .cal file"),
        ({"kind": "accelerometer-inverted"}, "acceleration", "mounted upside down"),
        ({"kind": "patch-dead", "patch": "C"}, "table", "the patch is dead"),
        ({"kind": "rtsi-missing"}, "daq", "connect a RTSI cable"),
        ({"kind": "clock-drift"}, "daq", "clocks of their own"),
        ({"kind": "amplifier-gain", "gain": 40}, "amplifier", "0.797 V arrive"),
        ({"kind": "amplifier-trip", "after": 45}, "amplifier", "is the amplifier on"),
        ({"kind": "laser-blocked"}, "vibrometer", "is the beam blocked"),
        ({"kind": "laser-dropout", "after": 46, "times": 20}, "vibrometer", "too little light"),
        ({"kind": "sensor-disconnected", "channel": "acceleration_z"}, "acceleration", "z must show 9.8"),
        ({"kind": "daq-overrun"}, "daq", "-200279"),
        ({"kind": "daq-overflow", "device": "Dev1"}, "daq", "Dev1 lost samples"),
        ({"kind": "relay-stuck", "patch": "B", "after": 40}, "relay",
         "channel 2 (patch B) was told to close"),
        ({"kind": "relay-lost", "patch": "B", "after": 40}, "relay", "channel 2 (patch B) was told to close"),
        ({"kind": "relay-welded", "patch": "D"}, "relay", "the contact does not close"),
        ({"kind": "relay-welded", "after": 50.1}, "relay", "welded closed"),
        *FOUR,
    ],
    ids=lambda value: "-".join(map(str, value.values())) if isinstance(value, dict) else "",
)  # fmt: skip
def test_one_thing_that_is_wrong_is_one_red_sentence(open, mode, fault, instrument, says):
    four = (fault, instrument, says) in FOUR
    of_one_card = fault["kind"].startswith(("sensor", "daq")) and not four
    rig = open("four-channel" if four else "minimal" if of_one_card else "haptable", faults=[fault])
    red = of_status(examine(rig), "red")
    assert [finding.instrument for finding in red] == [instrument], red
    assert says in red[0].sentence
    assert red[0].sentence.endswith((".", "?"))
    (asked,) = rig.simulation.faults
    assert asked.fired
    if "relay-" not in fault["kind"] and not of_one_card:
        assert_safe(rig)


def test_swapped_monitors_of_two_patches_are_named(open, monkeypatch):
    rig = open("four-channel")
    right = rig.monitor
    monkeypatch.setattr(rig, "monitor", lambda p: right({"B": "C", "C": "B"}.get(p, p)))
    red = of_status(examine(rig), "red")
    assert [finding.name for finding in red] == ["Patch B", "Patch C"]
    assert "shows on drive_b, and not on its own monitor" in red[0].sentence


def test_a_saturated_gauge_is_named(open):
    rig = open("minimal", faults=[{"kind": "sensor-saturated", "channel": "gauge2"}])
    red = of_status(examine(rig), "red")
    assert [finding.name for finding in red] == ["Noise floor of gauge2", "Known mass"]


def test_a_rig_without_a_table_is_tested_for_what_it_has(open, mode):
    if mode not in ("twin", "wire"):
        pytest.skip("of a rig that haploop ships")
    findings = examine(open("minimal"))
    assert {f.instrument for f in findings} == {"daq", "force", "acceleration"}
    assert {f.status for f in findings} == {"green"}


@pytest.mark.parametrize("mass", [float("nan"), float("inf"), 0.0, -0.5])
def test_a_mass_that_is_none_is_refused(open, mass):
    with pytest.raises(ConfigurationError, match="is no mass"):
        examine(open("minimal"), mass)


def test_each_instrument_is_opened_on_the_plant_that_was_given(mode):
    seen: list[str] = []

    class Watched(PlantSource):
        def make(self, file: RigFile, rng: np.random.Generator) -> Surface:
            seen.append(file.name)
            return random_modal(rng).make(file, rng)

    file = load_rig_file("haptable")
    findings = examine_each(file, mode, InstrumentError("The box does not answer."), plant=Watched())
    opened = [finding for finding in findings if finding.name == "Identity" and finding.instrument != "rig"]
    assert {finding.status for finding in opened} == {"green"}
    assert len(seen) == 1 and len(opened) >= 4  # all of them in one world
    said = {finding.instrument: finding.sentence for finding in opened}
    assert said["relay"].endswith(" responds.") and said["vibrometer"].endswith("it was not asked.")
    assert findings[-2].sentence == "The box does not answer."


class TestCommand:
    def test_green_is_exit_code_0(self, run):
        report = run.json("doctor --rig haptable --simulate twin")
        assert report["status"] == "green"
        assert set(report["findings"][0]) == {"name", "instrument", "status", "sentence"}

    def test_a_safe_state_that_is_not_confirmed_leaves_the_table(self, run, monkeypatch):
        def busy(_rig):
            raise InstrumentError("The safe state was not confirmed: Dev2 is in use. Switch it off by hand.")

        monkeypatch.setattr(Rig, "make_safe", busy)
        result = run("doctor --rig haptable --simulate twin")
        assert result.exit_code in (1, 3), result.output
        said = " ".join(result.stdout.split())
        assert "Identity (relay)" in said and "Dev2 is in use. Switch it off by hand." in said
        assert "Not tested, because the safe state was not confirmed." in said and "Gravity" not in said

    def test_red_is_exit_code_1(self, run, tmp_path):
        file = tmp_path / "rig.toml"
        file.write_text(
            'base = "minimal"\n[[simulation.faults]]\nkind = "accelerometer-inverted"\n', encoding="utf-8"
        )
        result = run("doctor --rig", file, "--simulate", "twin", ends=1)
        assert "upside down" in " ".join(result.stdout.split())

    def test_an_instrument_that_does_not_open_is_exit_code_3(self, run, tmp_path):
        file = tmp_path / "rig.toml"
        file.write_text(
            'base = "haptable"\n[[simulation.faults]]\n'
            'kind = "reply"\ninstrument = "relay"\nhow = "garbled"\n',
            encoding="utf-8",
        )
        red = [
            f
            for f in run.json("doctor --rig", file, "--simulate", "wire", ends=3)["findings"]
            if f["status"] == "red"
        ]
        assert [f["instrument"] for f in red] == ["relay"]
        assert "whole JSON" in red[0]["sentence"]


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ({"kind": "frames-lost", "times": 3}, "3 of 23 frames were lost"),
        ({"kind": "ambient-light", "light": 200.0}, "lower the exposure"),
    ],
)
def test_a_camera_that_loses_frames_or_sees_a_lamp(fault, says):
    """The first frames are lost, which no gap between two shows."""
    file = load_rig_file("experiment")
    simulation = file.simulation.model_copy(update={"faults": (fault,)})
    with open_rig(file.model_copy(update={"simulation": simulation})) as rig:
        found = list(check_camera(rig))
    assert says in " ".join(one.sentence for one in found if one.status != "green")


def test_what_nobody_could_be_asked_is_not_tested_and_not_red(open):
    """Without a terminal the console's questions have no answer, which is no difference of the settings."""
    rig = open("haptable")

    def nobody(request):
        raise UnansweredError(f"Nobody is at the console to answer: {request}")

    rig.operator.confirm = nobody
    findings = examine(rig)
    assert not of_status(findings, "red")
    settings = next(one for one in findings if one.name == "Settings" and one.instrument == "vibrometer")
    assert settings.status == "yellow" and settings.sentence.startswith("Not tested: nobody was there")
    rig.operator.confirm = lambda request: False
    said = [one.sentence for one in of_status(examine(rig), "red")]
    assert any("The settings differ from the rig file" in sentence for sentence in said)
    assert_safe(rig)
