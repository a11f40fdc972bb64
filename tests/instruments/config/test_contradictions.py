"""A wrong description of amplifier, actuator, wiring or pick-up is one sentence that says what to write."""

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError
from haploop.instruments import load_rig_file, open_rig
from tests.raising import raises

COIL = """
base = "haptable"
name = "coil"
wiring = "direct"
relay = false

[amplifier]
driver = "analog-amplifier"
name = "an audio amplifier"
source = "its data sheet"
input = "amplifier"
gain = 2
min = -12
max = 12
current_peak = 1
current_average = 0.5
monitor = { channel = "drive", scale = 2 }

[daq.channels]
drive = { terminal = "Dev2/ai4", range = 10, config = "rse" }

[actuator]
kind = "coil"
resistance = 8
inductance = 0.5e-3
volts = 4
watts = 1
thermal_time = 2
protected_by = "a fuse of 0.5 A"

[table]
patches = ["A"]
patch_places = { A = [0.2, 0.15] }

[vibrometer]
driver = "analog-vibrometer"
name = "a Doppler head"
source = "its data sheet"
channel = "laser"
scale = 0.005
range = 0.02
bandwidth_hz = 20000
"""
PEOPLE = """
base = "simulated"
[people]
number = 12
threshold = -3.5
uncertainty = 3.5
spread = 5.0
button = "push"
force = 2.0
"""
GLUED = ("scale = 0.005\nrange = 0.02", 'quantity = "acceleration"\nscale = 98\nrange = 490\nmass = 0.002')


def written(folder: Path, *changes: tuple[str, str]) -> Path:
    text = COIL
    for before, after in changes:
        assert before in text, before
        text = text.replace(before, after, 1)
    file = folder / "rig.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_the_right_description_is_taken(tmp_path):
    rig = load_rig_file(written(tmp_path))
    assert rig.relay is None and rig.sensors.drive is not None
    assert (rig.sensors.drive.channels, rig.sensors.drive.ratio) == (("drive",), 2.0)
    load_rig_file(written(tmp_path, GLUED))


INVERTED = ('input = "amplifier"', 'input = "swept"\ninverting = true')
SWEPT = (
    "[table]",
    '[generator]\ndriver = "keysight-33500"\nresource = "TCPIP::192.0.2.1::5025::SOCKET"\noutput = "swept"\n'
    "[table]",
)
BARE = ('protected_by = "a fuse of 0.5 A"\n', "")
COILS = COIL.partition("[actuator]\n")[2].partition("protected_by")[0]
PIEZO = 'kind = "piezo"\ncapacitance = 1e-6\nmin = 0\nmax = 150\n'
FAR = ("scale = 0.005\nrange = 0.02", 'quantity = "displacement"\nscale = 5e-5\nrange = 2e-4')
SLOW_ABORT = ("[table]", "[abort]\nvelocity = 0.01\n\n[table]")
SPEED = 'scale = 0.005\nquantity = "speed"\n'


@pytest.mark.parametrize(("changes", "says"), [
    # amplifier
    ([("gain = 2\n", "gain = -2\n")], r"amplifier\.gain must be above 0"),
    ([('source = "its data sheet"\ninput', "input")], r"the key 'amplifier\.source' is missing"),
    ([("min = -12", "min = 0")], r"amplifier\.min: .* goes below 0 V \(min = -50\)"),
    ([("current_peak = 1", "current_peak = 0.1")], r"current_average: 0\.5 A .* swap the two"),
    ([('channel = "drive", scale', 'channel = "monitr", scale')], r"no channel 'monitr' .*: name"),
    ([('input = "amplifier"', 'input = "ao0"')], r"no output 'ao0' .*\(amplifier\): name one of"),
    ([('wiring = "direct"\nrelay = false\n', "")], r"monitor: .* put a divider behind the relay into"),
    ([INVERTED, SWEPT], r"inverting: .* its non-inverting input"),
    # actuator
    ([('kind = "coil"', 'kind = "motor"')], r"actuator\.kind must be 'piezo' or 'coil'"),
    ([("watts = 1\n", "")], r"actuator: a coil needs watts: add it to \[actuator\]"),
    ([("watts = 1\n", "watts = 3\n")], r"at volts = 4 into 8 ohm it can dissipate 2 W at most"),
    ([("watts = 1\n", "watts = 1\ncapacitance = 1e-9\n")], r"a coil has no capacitance, .*: remove it"),
    ([("thermal_time = 2", "thermal_time = 3600")], r"actuator\.thermal_time must be 600 or less"),
    ([("a fuse of 0.5 A", "nothing")], r"'nothing' protects nothing: name the fuse"),
    ([("a fuse of 0.5 A", "None yet")], r"'None yet' protects nothing"),
    ([BARE], r"can put out -12 to 12 V, the actuator takes -4 to 4 V"),
    ([BARE, ("min = -12\nmax = 12", "min = -4\nmax = 5")], r"can put out -4 to 5 V.* what keeps it"),
    ([("[table]", "[limits]\nmax = 12\n\n[table]")], r"limits\.max: 12 V .*: write max = 4"),
    ([("[table]", "[limits]\nmin = -5\n\n[table]")], r"limits\.min: -5 V .*write min = -4"),
    ([(COILS, PIEZO)], r"actuator\.min: .* cannot follow a drive.* write the negative volts"),
    # wiring
    ([('wiring = "direct"', 'wiring = "none"')], r"wiring must be 'relay' or 'direct'"),
    ([('patches = ["A"]', 'patches = ["A", "B"]')], r'2 patches are named: write patches = \["A"\]'),
    ([("relay = false\n", "")], r'wiring: .* remove \[relay\], or write wiring = "relay"'),
    # pick-up
    ([("scale = 0.005\n", "scale = 5\n")], r"scale: its output would have 0\.004 V .*write range and"),
    ([("bandwidth_hz = 20000", "bandwidth_hz = 100000")], r"half of the table's rate \(25000 Hz\)"),
    ([FAR, ("bandwidth_hz = 20000", "bandwidth_hz = 30000")], r"30000 Hz .* set a lower low-pass filter"),
    ([("range = 0.02", "range = 0.02\nhigh_pass_hz = 100")], r"hides motion .*: switch it off"),
    ([('channel = "laser"', 'channel = "lasr"')], r"no channel 'lasr' .*: name the one"),
    ([("range = 0.02", "range = 0.04")], r"8 V at 40 mm/s, and the channel 'laser' ends at 5 V"),
    ([GLUED, ("mass = 0.002", "mass = 0")], r"mass: an accelerometer .*: write its mass in kg"),
    ([("range = 0.02", "range = 0.02\nmass = 0.002")], r"shows velocity touches nothing: remove mass"),
    ([GLUED, SLOW_ABORT], r"write \[abort\] acceleration instead"),
    ([("scale = 0.005\n", SPEED)], r"quantity must be 'velocity', 'displ"),
    ([("scale = 0.005\n", "scale = 0.005\ndelay = 1.1\n")], r"vibrometer\.delay must be below 1"),
])  # fmt: skip
def test_a_wrong_one_is_one_sentence(tmp_path, changes, says):
    told = raises(ConfigurationError, says, load_rig_file, written(tmp_path, *changes))
    assert "\n" not in told and told.startswith(str(tmp_path / "rig.toml")) and told.endswith((".", ")"))


def test_what_a_rig_lacks_is_told(tmp_path):
    file = tmp_path / "rig.toml"
    file.write_text('base = "simulated"\nrelay = false\n', encoding="utf-8")
    needs = pytest.raises(ConfigurationError, match=r'needs one, or wiring = "direct" \(')
    with open_rig(file) as rig, needs:
        rig.excite(np.zeros(100), ["A"], ["drive"])
    for base, away, says in (
        ("voice-coil", "amplifier", r"direct wiring needs an \[amplifier\]: add it"),
        ("voice-coil", "table", r"direct wiring needs a \[table\]: add it"),
        ("haptable", "actuator", r"table: a rig with a \[table\] needs an \[actuator\]: write kind"),
    ):
        file.write_text(f'base = "{base}"\n{away} = false\n', encoding="utf-8")
        raises(ConfigurationError, says, load_rig_file, file)


@pytest.mark.parametrize(("before", "after"), [
    ("number = 12\nthreshold = -3.5\nuncertainty = 3.5", "number = 2\nthreshold = -3.5\nuncertainty = 9"),
    ("number = 12", "number = 100001"),
    ("threshold = -3.5", "threshold = -61"),
    ("threshold = -3.5", "threshold = 61"),
    ("threshold = -3.5", "threshold = nan"),
    ("uncertainty = 3.5", "uncertainty = 0"),
    ("uncertainty = 3.5", "uncertainty = 61"),
    ("spread = 5.0", "spread = 0"),
    ("uncertainty = 3.5\nspread = 5.0", "uncertainty = 40\nspread = 61"),
    ("force = 2.0", "force = 0"),
    ("force = 2.0", "force = 101"),
    ('"push"', '""'),
    ('"push"', '"a\\u0007bell"'),
    ('"push"', f'"{"x" * 81}"'),
])  # fmt: skip
def test_people_that_no_lab_can_have_measured_are_refused(tmp_path, before, after):
    path = tmp_path / "people.toml"
    path.write_text(PEOPLE, encoding="utf-8")
    assert load_rig_file(path).people is not None
    path.write_text(PEOPLE.replace(before, after), encoding="utf-8")
    raises(ConfigurationError, "people", load_rig_file, path)


@pytest.mark.parametrize("uncertainty", [2.74, 2.6])
def test_a_mean_is_known_no_better_than_so_many_people_tell_it(tmp_path, uncertainty):
    """12 who differ by 5 dB tell it to 2.8 dB at best; 0.1 dB are lost by rounding."""
    path = tmp_path / "people.toml"
    path.write_text(PEOPLE.replace("uncertainty = 3.5", f"uncertainty = {uncertainty}"), encoding="utf-8")
    refused = pytest.raises(ConfigurationError, match=r"12 people who differ by 5 dB tell .* to 2\.8 dB")
    with nullcontext() if uncertainty > 2.7 else refused:
        load_rig_file(path)
