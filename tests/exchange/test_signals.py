"""Signals, read back by programs that are not ours: the same values, in the same units."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

import haploop
from haploop.acquisition import content_hash
from haploop.calibration import Check, Drive
from haploop.exchange import csv_file, mat_file
from haploop.exchange.views import Channel, PressTable, Signals
from tests.exchange.conftest import Files

KINDS = ("recording", "representative", "drive", "check", "button")


def expected(files: Files, kind: str) -> dict[str, tuple[np.ndarray, str]]:
    """Some channels of a kind's file, as haploop itself reads it: values and unit."""
    if kind == "recording":
        r = files.presses
        names = {f"acceleration_{x}": (row, "m/s^2") for x, row in zip("xyz", r.acceleration, strict=True)}
        return names | {"force": (r.force, "N"), "activation": (r.activation, "1")}
    if kind == "representative":
        return {"acceleration": (files.press.acceleration, "m/s^2"), "force": (files.press.force, "N")}
    if kind == "check":
        check = Check.load(files.check)
        return {"target": (check.target, "m/s^2"), "play_2": (check.accelerations[1], "m/s^2")}
    drive = Drive.load(files.drive)
    return {"volts": (drive.volts[0], "V"), "target": (drive.target, "m/s^2")}


def exported(files: Files, kind: str, format: str, tmp_path: Path, suffix: str) -> Path:
    out = tmp_path / f"{kind}{suffix}"
    done = haploop.export_file(getattr(files, kind), format, out)
    assert (done.kind, done.files[0], done.simulated) == (kind, out, True)
    return out


@pytest.mark.parametrize("kind", KINDS)
def test_a_table_opens_in_pandas(files, tmp_path, kind):
    pandas = pytest.importorskip("pandas")
    out = exported(files, kind, "csv", tmp_path, ".csv")
    table = pandas.read_csv(out)
    about = json.loads(out.with_name(out.name + ".json").read_text(encoding="utf-8"))["about"]
    assert about["simulated"] and about["content_hash"] == content_hash(getattr(files, kind))
    rate = round(1 / table["time [s]"][1])
    assert rate == (5000 if kind in ("recording", "representative", "check") else 50_000)
    for name, (values, unit) in expected(files, kind).items():
        np.testing.assert_allclose(table[f"{name} [{unit}]"], values, rtol=1e-8, atol=1e-12)
    assert set(table.dtypes) == {np.dtype(float)}  # also of a column of 0 and 1, or of its first rows alone


@pytest.mark.parametrize("kind", KINDS)
def test_a_float_wav_opens_in_libsndfile(files, tmp_path, kind):
    soundfile = pytest.importorskip("soundfile")
    out = exported(files, kind, "wav", tmp_path, ".wav")
    found, rate = soundfile.read(out, dtype="float32")
    labels = json.loads(out.with_name(out.name + ".json").read_text(encoding="utf-8"))
    assert (rate, soundfile.info(out).subtype) == (labels["rate_hz"], "FLOAT")
    names = [channel["name"] for channel in labels["channels"]]
    units = {channel["name"]: channel["unit"] for channel in labels["channels"]}
    for name, (values, unit) in expected(files, kind).items():
        assert units[name] == unit
        np.testing.assert_array_equal(found[:, names.index(name)], values.astype(np.float32))


@pytest.mark.parametrize(("kind", "main"), [("representative", "acceleration"), ("drive", "volts")])
def test_a_sound_card_s_wav_opens_in_libsndfile(files, tmp_path, kind, main):
    soundfile = pytest.importorskip("soundfile")
    out = exported(files, kind, "wav48", tmp_path, ".wav")
    found, rate = soundfile.read(out, dtype="int16")
    assert (rate, found.ndim, soundfile.info(out).subtype) == (48_000, 1, "PCM_16")
    labels = json.loads(out.with_name(out.name + ".json").read_text(encoding="utf-8"))
    (unit_per_count,) = labels["unit_per_count"]
    values, unit = expected(files, kind)[main]
    assert labels["channels"][0]["unit"] == unit
    own = expected_rate(kind)
    # Between samples, by an interpolation that is not the exporter's.
    again = np.interp(np.arange(len(values)) / own, np.arange(len(found)) / rate, found * unit_per_count)
    assert np.linalg.norm(again - values) < 0.03 * np.linalg.norm(values)
    assert 0.88 < np.abs(found).max() / 32767 < 0.90


def expected_rate(kind: str) -> float:
    return 5000.0 if kind == "representative" else 50_000.0


@pytest.mark.parametrize("kind", KINDS)
def test_matlab_files(files, tmp_path, kind):
    out = exported(files, kind, "mat", tmp_path, ".mat")
    found = loadmat(out, squeeze_me=True, simplify_cells=True)
    for name, (values, unit) in expected(files, kind).items():
        np.testing.assert_array_equal(found[name], values)
        assert found["units"][name] == unit
    assert found["about"]["simulated"] == 1


@pytest.mark.parametrize("kind", KINDS)
def test_uff_opens_in_pyuff(files, tmp_path, kind):
    """pyuff writes it too; the numbers and types of the text are looked at here."""
    pyuff = pytest.importorskip("pyuff")
    out = exported(files, kind, "uff", tmp_path, ".uff")
    file = pyuff.UFF(str(out))
    assert list(file.get_set_types()[:2]) == [151, 164]
    sets = {s["id1"].strip(): s for s in file.read_sets() if s["type"] == 58}
    for name, (values, unit) in expected(files, kind).items():
        one = sets[name]
        assert (one["func_type"], one["abscissa_spec_data_type"]) == (1, 17)
        assert one["ordinate_spec_data_type"] == {"m/s^2": 12, "N": 13, "V": 1, "1": 0}[unit]
        np.testing.assert_allclose(one["data"], values, rtol=1e-10, atol=1e-14)
        assert one["x"][1] - one["x"][0] == pytest.approx(1 / (50_000 if "volts" in sets else 5000))
        assert one["id5"].startswith("Simulated")


def test_a_table_of_presses(files, tmp_path):
    """Several recordings: one row a press; the same one twice has twice the rows."""
    done = haploop.export_file([files.recording, files.recording], "csv", tmp_path / "presses.csv")
    assert done.kind == "study"
    with (tmp_path / "presses.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    verdicts = files.presses.verdicts
    assert len(rows) == 2 * len(verdicts)
    for row, verdict in zip(rows, verdicts, strict=False):
        assert (int(row["press"]), int(row["attempt"])) == (verdict.number, verdict.attempt)
        assert row["accepted"] == str(verdict.accepted) and row["simulated"] == "True"
        assert float(row["force_at_activation_n"]) == pytest.approx(verdict.force, rel=0.02)
        assert float(row["activation_s"]) * 5000 == pytest.approx(verdict.activation, abs=2)
        assert float(row["peak_force_n"]) >= float(row["force_at_activation_n"]) * 0.9
        assert 50 < float(row["centroid_hz"]) < 600


def test_what_does_not_fit_is_one_sentence(files, tmp_path):
    with pytest.raises(haploop.ConfigurationError, match=r"recording cannot .*'ahap'.*representative press"):
        haploop.export_file(files.recording, "ahap", tmp_path / "a.ahap")
    with pytest.raises(haploop.ConfigurationError, match="choose csv, mat, uff"):
        haploop.export_file(files.calibration, "wav", tmp_path / "a.wav")
    with pytest.raises(haploop.ConfigurationError, match="Several recordings cannot be exported as 'wav'"):
        haploop.export_file([files.recording, files.recording], "wav", tmp_path / "a.wav")
    with pytest.raises(haploop.ConfigurationError, match="write to another place"):
        haploop.export_file(files.representative, "csv", "")
    (tmp_path / "a.wav.json").write_text("mine")
    with pytest.raises(haploop.ConfigurationError, match="already exists"):
        haploop.export_file(files.drive, "wav", tmp_path / "a.wav")
    assert [p.name for p in tmp_path.iterdir()] == ["a.wav.json"]


@pytest.mark.parametrize(
    ("kind", "format", "last"),
    [
        ("drive", "csv", "haploop.exchange.csv_file.np.savetxt"),
        ("drive", "wav", "scipy.io.wavfile.write"),
        ("calibration", "csv", "haploop.exchange.csv_file.np.savetxt"),
    ],
)
def test_an_export_that_is_interrupted_leaves_no_file(files, kind, format, last, tmp_path, monkeypatch):
    """A sidecar alone would refuse the same command."""

    def interrupt(*_: object, **_more: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(last, interrupt)
        haploop.export_file(getattr(files, kind), format, tmp_path / "a")
    assert not [*tmp_path.iterdir()]
    assert len(haploop.export_file(getattr(files, kind), format, tmp_path / "a").files) == 2


def test_channels_with_names_alike_are_all_in_the_matlab_file(tmp_path):
    names = ["time", "foo-bar", "foo_bar", "a" * 31 + "1", "a" * 31 + "2"]
    channels = tuple(Channel(name, "N", np.arange(3.0) + 10 * n) for n, name in enumerate(names))
    mat_file.write_signals(Signals("x", 5000.0, channels, "time", {"simulated": False}), tmp_path / "a.mat")
    found = loadmat(tmp_path / "a.mat", squeeze_me=True, simplify_cells=True)
    assert len(found["units"]) == 6 and np.allclose(found["time"], np.arange(3) / 5000)
    firsts = {float(value[0]) for name, value in found.items() if name in found["units"]}
    assert firsts == {0.0, 10.0, 20.0, 30.0, 40.0}


def test_no_text_of_a_table_is_a_formula(tmp_path):
    table = PressTable("x", {"rig": "", "force": "N"}, ({"rig": "=1+1", "force": -1.0},), {})
    csv_file.write_presses(table, tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text().split() == ["rig,force", "'=1+1,-1.0"]
