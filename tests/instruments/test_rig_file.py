from __future__ import annotations

from pathlib import Path

import pytest

from instruments import ConfigurationError, load_rig_file

SHIPPED = Path(__file__).parents[2] / "rigs" / "simulated.toml"


def written(folder: Path, text: str) -> Path:
    file = folder / "rig.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_a_shipped_rig_is_found_by_its_bare_name() -> None:
    assert load_rig_file("simulated") == load_rig_file(SHIPPED)


def test_the_papers_numbers() -> None:
    rig = load_rig_file("simulated")
    assert rig.rate_hz == 5000
    assert rig.table is not None
    assert rig.table.rows * rig.table.columns == 84
    assert rig.table.patches == ("A", "B", "C", "D")
    assert rig.limits.swing == 100
    assert rig.amplifier is not None
    assert rig.amplifier.settings["gain"] == 50


def test_a_simulation_table_chooses_another_plant(tmp_path: Path) -> None:
    text = SHIPPED.read_text(encoding="utf-8") + "\n[simulation]\nseed = 7\ndamping_scale = 3\n"
    rig = load_rig_file(written(tmp_path, text))
    assert (rig.simulation.seed, rig.simulation.damping_scale) == (7, 3)


def test_a_file_with_nothing_but_a_simulation_is_the_simulated_rig(tmp_path: Path) -> None:
    rig = load_rig_file(written(tmp_path, "[simulation]\nmode_drift = 0.03\n"))
    assert rig.name == "simulated"
    assert rig.simulation.mode_drift == 0.03


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("name = ", "not valid TOML"),
        ('name = "x"\n', "'daq' is missing"),
        ("[simulation]\nsead = 1\n", "unknown key 'simulation.sead'; did you mean 'seed'"),
        ("[simulation]\nseed = -1\n", "simulation.seed"),
        ("[simulation]\ndamping_scale = nan\n", "simulation.damping_scale"),
    ],
)
def test_what_is_wrong_is_named_in_one_sentence(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ConfigurationError, match=says) as caught:
        load_rig_file(written(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_a_missing_file_says_what_there_is(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="simulated"):
        load_rig_file(tmp_path / "none.toml")
    with pytest.raises(ConfigurationError, match="simulated"):
        load_rig_file("none")


def test_a_base_is_merged_table_by_table(tmp_path: Path) -> None:
    stock = load_rig_file("stock-accelerometer")
    assert stock.sensors.acceleration is not None
    assert stock.sensors.acceleration.bandwidth_hz == 50
    assert stock.sensors.force == load_rig_file("simulated").sensors.force
    variant = tmp_path / "variant.toml"
    variant.write_text('base = "rig.toml"\nrate_hz = 10000\n', encoding="utf-8")
    written(tmp_path, 'base = "simulated"\nname = "mine"\n')
    assert (load_rig_file(variant).name, load_rig_file(variant).rate_hz) == ("mine", 10_000)


def test_a_base_that_is_its_own_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="builds on this file itself"):
        load_rig_file(written(tmp_path, 'base = "rig.toml"\n'))


def test_every_shipped_rig_loads() -> None:
    for file in SHIPPED.parent.glob("*.toml"):
        assert load_rig_file(file).name == file.stem


def test_only_rigs_that_say_so_are_simulated() -> None:
    assert load_rig_file("simulated").simulate == "twin"
    assert load_rig_file("haptable").simulate is None
    assert load_rig_file("minimal").simulate is None
