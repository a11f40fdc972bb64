"""A wrong description of a sensor is one sentence that says what to write instead."""

import pytest

from haploop.base.errors import ConfigurationError
from haploop.instruments import load_rig_file

FORCE = '[sensors.force]\nchannels = ["gauge0"]\n'
BRIDGE = FORCE + 'sensitivity = "2 mV/V"\n'
CHARGE = FORCE + 'sensitivity = "-4.3 pC/N"\n'
PLANAR = '[sensors.force]\nchannels = ["gauge0", "gauge1"]\n'
ALONG = '[sensors.acceleration]\nchannels = ["acceleration_z"]\n'
COUPLED = ALONG + "scale = 98\nhigh_pass_hz = 0.5\n"
TRAVEL = '[sensors.displacement]\nchannels = ["laser"]\n'
EXTRA = '[sensors.extra.t]\nchannel = "gauge0"\nscale = 1\nunit = "K"'
INPUTS = "[daq.channels]\n"
TWICE = "scale = 1e-3\n" + INPUTS + 'gauge1 = { terminal = "Dev1/ai0", range = 10, config = "diff" }'
DC = INPUTS + 'acceleration_z = { terminal = "Dev2/ai2", range = 5, coupling = "dc", excitation = 2e-3 }'
SCALED = FORCE + "scale = 20\n"
SPEED = '[sensors.velocity]\nchannels = ["laser"]\n'
OWN = "give each its own"

CASES = {
    "singular matrix": (PLANAR + 'axes = ["x", "z"]\nmatrix = [[1, 2], [2, 4]]', "depend on each other"),
    "row of zeros": (PLANAR + 'axes = ["x", "z"]\nmatrix = [[0, 0], [2, 4]]', "leave it out"),
    "short row": (PLANAR + 'axes = ["x", "z"]\nmatrix = [[1, 2], [2]]', "row 2 of matrix has 1 numbers"),
    "two sensors on a channel": (SCALED + TRAVEL.replace("laser", "gauge0") + "scale = 1e-3", OWN),
    "extra on a sensor's channel": (SCALED + EXTRA, OWN),
    "a channel twice": (PLANAR.replace("1", "0") + 'axes = ["x", "z"]\nscale = 20', "twice"),
    "two channels on a terminal": (SCALED + TRAVEL.replace("laser", "gauge1") + TWICE, "Dev1/ai0"),
    "range beyond the channel's": (
        SCALED + "range = 400",
        "20 V, and the channel gauge0 ends at 10 V: write range = 200",
    ),
    "AC-coupled, abort force": (
        CHARGE + 'amplifier = "10 mV/pC"\nhigh_pass_hz = 0.16\n[abort]\nforce = 50',
        "abort.force",
    ),
    "bridge without excitation": (BRIDGE + "rated = 50", "needs excitation"),
    "bridge without rated load": (BRIDGE + "excitation = 10", "rated"),
    "pC without amplifier": (CHARGE + "high_pass_hz = 0.16", "amplifier ="),
    "charge without high-pass": (CHARGE + 'amplifier = "10 mV/pC"', "high_pass_hz"),
    "vertical not among axes": (FORCE + 'scale = 20\nvertical = "x"', "use one of these"),
    "two axes without names": (PLANAR + "scale = 20", "name them"),
    "unit of another quantity": (ALONG + 'sensitivity = "2 mV/N"', "mV/g"),
    "scale of another quantity": (SPEED + 'scale = "20 mm/V"', "(m/s)/V"),
    "unit that nobody knows": (TRAVEL + 'sensitivity = "3 V/furlong"', "unit"),
    "scale 0": (FORCE + "scale = 0", "a scale of 0 measures nothing"),
    "gain 0": (FORCE + "sensitivity = 0.1\ngain = 0", "of 0 measures nothing"),
    "neither scale nor sensitivity": (FORCE, "give either scale"),
    "both": (FORCE + "scale = 20\nsensitivity = 0.05", "give either scale"),
    "infinite scale": (FORCE + "scale = inf", "number"),
    "gravity of an AC-coupled one": (COUPLED + "gravity = true", "leave gravity out"),
    "LVDT without excitation": (TRAVEL + 'sensitivity = "80 mV/V/mm"', "needs excitation"),
    "displacement of two channels": (PLANAR.replace("force", "displacement") + "scale = 1e-3", "at most 1"),
    "IEPE on a DC-coupled input": (COUPLED + DC, 'coupling = "ac"'),
    "coupled, and not said so": (ALONG + "scale = 98\n" + DC.replace('"dc"', '"ac"'), "write high_pass_hz"),
}


@pytest.mark.parametrize(("tables", "told"), CASES.values(), ids=CASES)
def test_a_wrong_sensor_is_one_sentence(tmp_path, tables, told):
    path = tmp_path / "rig.toml"
    path.write_text(f'base = "haptable"\nname = "wrong"\n{tables}\n', encoding="utf-8")
    with pytest.raises(ConfigurationError) as refused:
        load_rig_file(path)
    sentence = str(refused.value)
    assert told in sentence
    assert "\n" not in sentence.strip()
    assert sentence.startswith(f"{path}") and len(sentence) - len(str(tmp_path)) < 300
