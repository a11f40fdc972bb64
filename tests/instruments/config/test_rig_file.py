import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from haploop.base.errors import ConfigurationError
from haploop.base.validation import key_lines
from haploop.instruments import load_rig_file
from haploop.instruments.rig.json_schema import rig_schema
from tests.raising import raises

SHIPPED = Path(__file__).parents[3] / "rigs" / "simulated.toml"


def written(folder: Path, text: str) -> Path:
    file = folder / "rig.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_every_shipped_rig_loads_and_only_those_that_say_so_are_simulated():
    assert load_rig_file("simulated") == load_rig_file(SHIPPED)
    for file in SHIPPED.parent.glob("*.toml"):
        # The simulated rig with a camera is the same rig: what was calibrated there is played here.
        assert load_rig_file(file).name == ("simulated" if file.stem == "experiment" else file.stem)
    assert load_rig_file("simulated").simulate == "twin"
    assert load_rig_file("haptable").simulate is load_rig_file("minimal").simulate is None


def test_a_file_with_nothing_but_a_simulation_is_the_simulated_rig_on_another_plant(tmp_path):
    rig = load_rig_file(written(tmp_path, "[simulation]\nseed = 7\nmode_drift = 0.03\n"))
    assert rig == load_rig_file("simulated").model_copy(update={"simulation": rig.simulation})
    assert (rig.simulation.seed, rig.simulation.mode_drift) == (7, 0.03)


HAPTABLE = 'base = "haptable"\n'
DEAD = '[[simulation.faults]]\nkind = "patch-dead"\n'


@pytest.mark.parametrize(("text", "says"), [
    ("name = ", "not valid TOML"),
    ('name = "x"\n', "'daq' is missing"),
    ("[simulation]\nseed = -1\n", "simulation.seed"),
    ("[simulation]\ndamping_scale = nan\n", "simulation.damping_scale"),
    # The line is named.
    ("[simulation]\n\nsead = 1\n", "toml, line 3: unknown key 'simulation.sead'; did you mean 'seed'"),
    (
        'base = "minimal"\n[daq.channels]\n# a new one\nextra = { terminl = "Dev1/ai1", range = 1 }\n',
        "rig.toml, line 4: unknown key 'daq.channels.extra.terminl'; did you mean 'terminal'",
    ),
    ('base = "minimal"\n\n[daq.channels.extra]\nrange = 1\n', "line 3: the key 'daq.channels.extra.term"),
    (HAPTABLE + "[relay]\nsettle = 0.1\ndead_man = 0\n", "line 4: relay.dead_man must be 0.1 or more"),
    (HAPTABLE + "limits.peak_to_peak = -1\n", "rig.toml, line 2: limits.peak_to_peak"),
    (HAPTABLE + "[sensors.force]\nmatrix = [\n  [1, 2],\n]\n[limits]\npeak_to_peak = 1\n",
     "rig.toml, line 2: sensors.force: row 1 of matrix has 2 numbers for 6 channels"),
    (DEAD + DEAD + 'pach = "A"\n', "line 5: unknown key 'simulation.faults.1.pach'; did you mean"),
    ('[[simulation.faults]]\nkind = "relay-stick"\n', "line 2: unknown fault kind .*'relay-stuck'"),
    (HAPTABLE + "[table]\npatch_places = { E = [0, 0] }\n", "line 3: table.patch_places.*'E'"),
    # What a value must be is said in plain words.
    (HAPTABLE + 'rate_hz = "a"\n', r"rate_hz must be a number \(found 'a'\)"),
    (HAPTABLE + "rate_hz = -1\n", r"rate_hz must be above 0 \(found -1\)"),
    (HAPTABLE + "rate_hz = inf\n", r"rate_hz must be a finite number \(found inf\)"),
    (HAPTABLE + "[limits]\nduty = 2\n", r"limits.duty must be 1 or less \(found 2\)"),
    (HAPTABLE + "[table]\nrows = 1.5\n", r"table.rows must be a whole number \(found 1.5\)"),
    (HAPTABLE + "[sensors.force]\nchannels = 3\n", r"sensors.force.channels must be a list \(found 3\)"),
    (HAPTABLE + "sensors = 3\n", r"sensors must be a table \(found 3\)"),
    # Limits are numbers about zero.
    (HAPTABLE + "[limits]\nmax = nan\n", "limits.max"),
    (HAPTABLE + "[limits]\nmin = nan\n", "limits.min"),
    (HAPTABLE + "[limits]\nmax = -60\n", "limits.max"),
    (HAPTABLE + "[limits]\nmin = 60\n", "limits.min"),
    (HAPTABLE + "[limits]\npeak_to_peak = inf\n", "limits.peak_to_peak"),
    # Two would be one output of one task, which the card refuses when it is to be set to zero.
    (HAPTABLE + '[daq.outputs]\nother = { terminal = "dev2/AO0" }\n',
     "dev2/AO0 has two names, 'amplifier' and 'other'"),
    ('base = "rig.toml"\n', "is itself based on this file"),
])  # fmt: skip
def test_what_is_wrong_is_named_in_one_sentence(tmp_path, text, says):
    assert "\n" not in raises(ConfigurationError, says, load_rig_file, written(tmp_path, text))


def test_a_key_is_looked_for_in_the_file_where_it_stands(tmp_path):
    written(tmp_path, '# mine\nbase = "haptable"\nname = "mine"\n[amplifier]\ngian = 50\n')
    variant = tmp_path / "variant.toml"
    for more, place in (("", r"rig\.toml, line 5"), ("gian = 20\n", r"variant\.toml, line 4")):
        variant.write_text(f'base = "rig.toml"\n[amplifier]\nmin = -50\n{more}', encoding="utf-8")
        raises(ConfigurationError, rf"{place}: unknown key 'amplifier\.gian'", load_rig_file, variant)


def test_what_looks_like_a_key_within_a_value_is_none():
    text = (
        '[a]\nlist = [\n  "x = 1", # [b]\n]\nlong = """\n[c]\nkey = 2\n"""\n'
        '"d e".f = 3\n[[g]]\n[[g]]\n[g.h]\ni = 4\n'
    )
    assert key_lines(text) == {
        ("a",): 1, ("a", "list"): 2, ("a", "long"): 5, ("a", "d e", "f"): 9,
        ("g", 0): 10, ("g", 1): 11, ("g", 1, "h"): 12, ("g", 1, "h", "i"): 13,
    }  # fmt: skip


def chosen(table: dict[str, Any], key: str, name: str) -> dict[str, Any]:
    """What a schema asks of a table whose `key` is `name`."""
    (rule,) = [r["then"] for r in table["allOf"] if r["if"]["properties"][key] == {"const": name}]
    return rule


def test_the_schema_knows_every_driver_and_every_fault():
    schema = rig_schema()
    relay = schema["properties"]["relay"]
    assert {"yocto-maxicoupler", "serial-relay"} <= set(relay["properties"]["driver"]["enum"])
    assert "pdv-100" not in relay["properties"]["driver"]["enum"]
    yocto = chosen(relay, "driver", "yocto-maxicoupler")
    assert yocto["additionalProperties"] is False
    assert {"driver", "hub", "patches", "rating", "dead_man"} <= set(yocto["properties"])
    faults = schema["$defs"]["SimulationSettings"]["properties"]["faults"]["items"]
    assert "after" in chosen(faults, "kind", "amplifier-trip")["properties"]
    text = json.dumps(schema, allow_nan=False)
    references = set(re.findall(r'"#/\$defs/([^"]+)"', text))
    assert references <= set(schema["$defs"])


def test_the_schema_has_every_key_of_the_shipped_rigs():
    schema = rig_schema()
    for file in SHIPPED.parent.glob("*.toml"):
        for role, table in tomllib.loads(file.read_text(encoding="utf-8")).items():
            assert role in schema["properties"]
            if isinstance(table, dict) and "driver" in table:
                rule = chosen(schema["properties"][role], "driver", table["driver"])
                assert set(table) <= set(rule["properties"])


def test_a_missing_file_says_what_there_is(tmp_path):
    for missing in (tmp_path / "none.toml", "zzz"):
        raises(ConfigurationError, "simulated", load_rig_file, missing)


def test_a_base_is_merged_table_by_table(tmp_path):
    stock = load_rig_file("stock-accelerometer")
    assert stock.sensors.acceleration.bandwidth_hz == 50
    assert stock.sensors.force == load_rig_file("simulated").sensors.force
    variant = tmp_path / "variant.toml"
    variant.write_text('base = "rig.toml"\nrate_hz = 10000\n', encoding="utf-8")
    written(tmp_path, 'base = "simulated"\nname = "mine"\n')
    assert (load_rig_file(variant).name, load_rig_file(variant).rate_hz) == ("mine", 10_000)


def test_another_driver_takes_nothing_over_from_the_bases(tmp_path):
    ofv = 'driver = "ofv-5000"\nport = "COM3"\nchannel = "laser"\nscale = 0.005\n'
    vibrometer = load_rig_file(written(tmp_path, f"{HAPTABLE}[vibrometer]\n{ofv}")).vibrometer
    assert set(vibrometer.settings) == {"port", "channel", "scale"}


def test_a_file_of_notepad_begins_with_a_mark(tmp_path):
    file = tmp_path / "rig.toml"
    file.write_bytes(b"\xef\xbb\xbf" + b'base = "haptable"\nname = "lab"\n')
    assert load_rig_file(file).name == "lab"
    file.write_bytes(b'name = "l\xe4b"\n')
    for path, says in ((file, "is not text in UTF-8: save it as that"), (tmp_path, "cannot be read")):
        raises(ConfigurationError, says, load_rig_file, path)


@pytest.mark.parametrize("text", [
    "a." * 20_000 + "b = 1\n",
    "[" + "a . " * 200 + "b]\n",
    "x = {" + "'a'." * 200 + "b = 1}\n",
    "x = " + "[" * 9999,
])  # fmt: skip
def test_a_key_of_very_many_parts_takes_no_memory(tmp_path, text):
    """Python's parser takes 1.6 GB for 40 kB of them."""
    path = tmp_path / "deep.toml"
    path.write_text(text)
    raises(ConfigurationError, "is not valid TOML: it is nested too deeply", load_rig_file, path)
    path.write_text('notes = "a.b.c"\n# ' + "a." * 50 + "\n" + "a." * 90 + "b = 1\n")
    raises(ConfigurationError, "name", load_rig_file, path)


@pytest.mark.parametrize(("table", "line", "own"), [
    ("relay", "rating = 400", r"rating = 400 is not what the Yocto-MaxiCoupler has \(48\)"),
    ("relay", "rating = 48.01", "rating = 48.01 is not"),
    ("amplifier", "gain = 5", r"gain = 5 is not what the E-413.D2 has \(50\)"),
    ("amplifier", "gain = 50.5", "gain = 50.5 is not"),
    ("amplifier", "max = 500", "max = 500 is not"),
    ("amplifier", "min = -101", "min = -101 is not"),
    ("amplifier", "current_peak = 0.2", "current_peak = 0.2 is not"),
    ("amplifier", "current_average = 0.06", "current_average = 0.06 is not"),
])  # fmt: skip
def test_a_figure_not_the_products_own_states_source(table, line, own, tmp_path):
    """With rating = 400 for a box of 48 V, 150 V were played whole."""
    text = f'base = "haptable"\n[{table}]\n{line}\n'
    with pytest.raises(ConfigurationError, match=f"{own}.*say where it is from in rating_source"):
        load_rig_file(written(tmp_path, text))
    given = load_rig_file(written(tmp_path, f'{text}rating_source = "data sheet PZ193E"\n'))
    assert given.devices[table].settings["rating_source"] == "data sheet PZ193E"


@pytest.mark.parametrize("line", ["rating = 42", "[amplifier]\nmax = 300\nmin = -20\ncurrent_peak = 0.01"])
def test_a_stricter_figure_needs_no_source(line, tmp_path):
    load_rig_file(written(tmp_path, f'base = "haptable"\n[relay]\n{line}\n'))
