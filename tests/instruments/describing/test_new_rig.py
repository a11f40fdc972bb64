"""A rig file like a shipped one, for each of four labs: filled in, marked, edited, checked, rehearsed."""

import json
from typing import Any

import pytest

import haploop
from haploop.base.validation import _FORMS
from haploop.instruments.config import shipped_rigs
from haploop.instruments.describing import LOOK_UP, Found, FoundCard, rig_problems, to_look_up
from tests.raising import raising

LABS = {
    "arduino": ("arduino", Found(ports=(("COM7", "Arduino Uno"),)), ['port = "COM7"'], {}),
    "usb card, iepe module, trek": (
        "compactdaq-iepe",
        Found(cards=(FoundCard("cDAQ9Mod1", "NI 9234"), FoundCard("cDAQ9Mod2", "NI 9263"))),
        ['devices = { cDAQ9Mod1 = "NI 9234", cDAQ9Mod2 = "NI 9263" }', '"cDAQ9Mod1/ai3"', '"cDAQ9Mod2/ao0"'],
        {'name = "PiezoDrive PD200"': 'name = "TREK 2220"', "gain = 20 ": "gain = 200 "},
    ),
    "sound card": (
        "no-ni",
        Found(sounds=(("Scarlett 4i4", "4 in, 4 out"),), ports=(("COM3", ""), ("COM5", ""))),
        ['device = "Scarlett 4i4"'],
        {'port = "COM3" ': 'port = "COM5" '},
    ),
    "the paper's": (
        "haptable",
        Found(cards=(FoundCard("Dev1", "PCI-6034E"), FoundCard("Dev2", "PCIe-6321"))),
        ['devices = { Dev1 = "PCI-6034E", Dev2 = "PCIe-6321" }'],
        {},
    ),
}
"""What each is like, what its computer has, what is then filled in, and what a person changes."""


@pytest.mark.parametrize("lab", LABS)
def test_a_lab_has_a_rig_file(lab, run, tmp_path, monkeypatch):
    like, found, filled, edits = LABS[lab]
    path = tmp_path / "lab.toml"
    monkeypatch.setattr("haploop.instruments.look_for_hardware", lambda: found)
    made = run("rig", "new", path, "--like", like)
    assert made.exit_code == 0, made.output
    text = path.read_text(encoding="utf-8")
    assert all(line in text for line in filled), text
    assert not [one for one in to_look_up(path) if any(line in one for line in filled[:1])]
    left = run("rig", "check", path)
    assert left.exit_code == 1 and left.stdout.count("line ") > 3 and LOOK_UP in left.stdout
    for before, after in edits.items():
        assert before in text
        text = text.replace(before, after)
    path.write_text(text.replace(LOOK_UP, "mine"), encoding="utf-8")
    complete = run("rig", "check", path)
    assert complete.exit_code == 0 and "is complete" in complete.stdout
    with haploop.open_rig(path, simulate="twin") as rig:
        assert rig.name == "lab"


@pytest.mark.parametrize("name", shipped_rigs())
def test_every_shipped_rig_can_be_begun_with(name, tmp_path):
    """Marks are comments: what is read is the shipped rig, with another name."""
    made = haploop.instruments.new_rig(tmp_path / "mine.toml", name, Found())
    shipped = haploop.load_rig_file(name)
    assert made.model_copy(update={"name": shipped.name}) == shipped
    assert rig_problems(tmp_path / "mine.toml") == []


@pytest.mark.parametrize("name", ["sound-card", "voice-coil"])
def test_what_a_rig_takes_from_its_base_is_to_look_up(name, tmp_path):
    """These state a few lines of their own; cards, gauges and limits are of another example."""
    haploop.instruments.new_rig(tmp_path / "mine.toml", name, Found())
    assert any(": base = " in line for line in to_look_up(tmp_path / "mine.toml"))


@pytest.mark.parametrize(("before", "after", "line", "says"), [
    ('driver = "ni-daqmx"', 'driver = "ni"', 8, "no driver 'ni' of a daq; did you mean 'ni-daqmx'?"),
    ('driver = "ni-daqmx"', 'driver = "zzz"', 8, "installed are ni-daqmx, serial-adc, sound-card."),
    ('driver = "ni-daqmx"', 'driver = "pdv-100"', 8, "is not for the role 'daq'"),
    ('terminal = "Dev1/ai0"', 'terminal = "Dev1-ai0"', 12, 'such as "Dev1/ai0"'),
    ("gain = 20 ", 'gain = "x" ', 46, "must be a number"),
    ('name = "PiezoDrive PD200"', 'name = "  "', 43, "must not be blank"),
    ("[amplifier]", "[amplifer]", 41, "did you mean 'amplifier'?"),
    ("kind = ", "kind ", 55, "is not valid TOML"),
    ('driver = "analog-amplifier"', 'driver = "trek"', 42, "no driver 'trek' of an amplifier; installed are"),
    ('channels = ["force"]', 'channels = ["Force"]', 22, "no channel 'Force'; did you mean 'force'?"),
    ('"Dev1/ai0"', '"Dev2/ai0"', 11, "force is wired to Dev2, which is none of devices (Dev1)"),
    ('"Dev1/ao0"', '"Dev2/ao0"', 18, "amplifier is wired to Dev2, which is none of devices"),
    ("capacitance = 90e-9", "capacitance = 90", 56, "actuator.capacitance must be 0.001 or less (found 90)"),
    ("range = 5, config", "range = 5, excitation = 2, config", 13,
     "excitation must be 0.02 or less (found 2)"),
    ('"USB-6211"', '"usb6211"', 9, "NI calls no card 'usb6211': did you mean 'USB-6211'?"),
    ('"USB-6211"', '"NI9234"', 9, "did you mean 'NI 9234'?"),
    ('["switch"]', '["switch"]\nthreshold = 25', 36,
     "25 V is never crossed, because the channel switch ends at 10 V"),
    ("button_point = 20", "button_point = 84", 66,
     "beyond the grid, whose 7 rows of 12 are numbered 0 to 83"),
    ('name = "lab"', 'base = "usb-6212"', 4, "there is no rig 'usb-6212': did you mean 'usb-6211'?"),
])  # fmt: skip
def test_an_error_has_a_line(before, after, line, says, run, tmp_path):
    path = tmp_path / "lab.toml"
    run("rig", "new", path, "--like", "usb-6211")
    text = path.read_text(encoding="utf-8").partition("# A USB-6211")[2]
    assert before in text
    text = "# A USB-6211" + text
    path.write_text(text.replace(before, after, 1), encoding="utf-8")
    result = run("rig", "check", path)
    assert result.exit_code == 2 and says in " ".join(result.stderr.split()), result.stderr
    assert f"line {line}" in result.stderr, (result.stderr, text)


def test_all_errors_are_told_at_once(run, tmp_path):
    path = tmp_path / "lab.toml"
    run("rig", "new", path, "--like", "usb-6211")
    text = path.read_text(encoding="utf-8")
    wrong = {"gain = 20 ": 'gain = "x" ', "threshold": "treshold", "Dev1/ai0": "Dev1", "rows = 7": "rows = 0"}
    for before, after in wrong.items():
        text = text.replace(before, after)
    path.write_text(text, encoding="utf-8")
    said = run("rig", "check", path).stderr
    assert all(one in said for one in ("amplifier.gain", "daq.channels.force.terminal", "table.rows")), said


@pytest.mark.parametrize(("name", "near"), [
    ("usb6211", "usb-6211"), ("USB", "usb-6211"), ("compact", "compactdaq-iepe"), ("hapttable", "haptable"),
])  # fmt: skip
def test_a_rig_that_is_nearly_named(name, near, run, tmp_path):
    for command in (("rig", "new", tmp_path / "x.toml", "--like", name), ("doctor", "--rig", name)):
        result = run(*command)
        assert result.exit_code == 2 and f"did you mean {near!r}?" in result.stderr
    assert not (tmp_path / "x.toml").exists()


def test_without_a_name_the_shipped_rigs_are_listed(run, tmp_path):
    result = run("rig", "new", tmp_path / "x.toml")
    assert result.exit_code == 2 and all(name in result.stderr for name in shipped_rigs())


def test_no_pattern_of_a_field_is_shown_to_a_person():
    def patterns(schema: Any) -> set[str]:
        if isinstance(schema, list):
            return set().union(*map(patterns, schema))
        if not isinstance(schema, dict):
            return set()
        own = {schema["pattern"]} if isinstance(schema.get("pattern"), str) else set()
        return own.union(*map(patterns, schema.values()))

    found = patterns(json.loads(json.dumps(haploop.instruments.rig_schema())))
    assert found and found <= set(_FORMS), found - set(_FORMS)


def test_a_library_that_is_missing_or_fails_is_one_sentence(monkeypatch):
    broken = raising(RuntimeError("Could not find an installation of NI-DAQmx. More words."))
    monkeypatch.setattr("haploop.instruments.describing._cards", broken)
    found = haploop.instruments.look_for_hardware()
    assert found.cards == ()
    why = "Could not find an installation of NI-DAQmx"
    assert found.missing[0] == f"NI cards could not be looked for ({why})."
