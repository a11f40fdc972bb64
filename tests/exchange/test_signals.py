"""Signals, read back by programs that are not ours: the same values, in the same units."""

from __future__ import annotations

import csv
import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

import haploop
from haploop.calibration import Check, Drive
from haploop.exchange import csv_file, mat_file
from haploop.exchange.views import Channel, PressTable, Signals
from tests.exchange.conftest import Files

KINDS = ("recording", "representative", "drive", "check", "button")


def expected(files: Files, kind: str) -> dict[str, tuple[np.ndarray, str]]:
    """Some channels of a kind's file, as haploop itself reads it: values and unit."""
    if kind == "recording":
        r = files.presses
        names = {
            f"acceleration_{axis}": (row, "m/s^2") for axis, row in zip("xyz", r.acceleration, strict=True)
        }
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
def test_a_table_opens_in_pandas(files: Files, tmp_path: Path, kind: str) -> None:
    pandas = pytest.importorskip("pandas")
    out = exported(files, kind, "csv", tmp_path, ".csv")
    table = pandas.read_csv(out)
    about = json.loads(out.with_name(out.name + ".json").read_text(encoding="utf-8"))["about"]
    assert about["simulated"] and about["content_hash"] == haploop.content_hash(getattr(files, kind))
    rate = round(1 / table["time [s]"][1])
    assert rate == (5000 if kind in ("recording", "representative", "check") else 50_000)
    for name, (values, unit) in expected(files, kind).items():
        np.testing.assert_allclose(table[f"{name} [{unit}]"], values, rtol=1e-8, atol=1e-12)
    assert set(table.dtypes) == {np.dtype(float)}  # also of a column of 0 and 1, or of its first rows alone


@pytest.mark.parametrize("kind", KINDS)
def test_a_float_wav_opens_in_libsndfile(files: Files, tmp_path: Path, kind: str) -> None:
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
def test_a_sound_card_s_wav_opens_in_libsndfile(files: Files, tmp_path: Path, kind: str, main: str) -> None:
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
def test_matlab_files(files: Files, tmp_path: Path, kind: str) -> None:
    out = exported(files, kind, "mat", tmp_path, ".mat")
    found = loadmat(out, squeeze_me=True, simplify_cells=True)
    for name, (values, unit) in expected(files, kind).items():
        np.testing.assert_array_equal(found[name], values)
        assert found["units"][name] == unit
    assert found["about"]["simulated"] == 1


@pytest.mark.parametrize("kind", KINDS)
def test_uff_opens_in_pyuff(files: Files, tmp_path: Path, kind: str) -> None:
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


@pytest.mark.parametrize("kind", KINDS)
def test_sep005_is_valid(files: Files, tmp_path: Path, kind: str) -> None:
    sep005 = pytest.importorskip("sdypy_sep005.sep005")
    channels = json.loads(exported(files, kind, "sep005", tmp_path, ".json").read_text(encoding="utf-8"))
    sep005.assert_sep005(channels)
    found = {channel["name"]: channel for channel in channels}
    for name, (values, unit) in expected(files, kind).items():
        assert found[name]["unit_str"] == unit
        np.testing.assert_allclose(found[name]["data"], values, rtol=1e-8, atol=1e-12)


def test_pyfrf_takes_sep005(files: Files, tmp_path: Path) -> None:
    """Force and acceleration of a recording as excitation and response: it computes their FRF."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own
        pyfrf = pytest.importorskip("pyFRF")
        channels = json.loads(exported(files, "recording", "sep005", tmp_path, ".json").read_text("utf-8"))
        found = {channel["name"]: channel for channel in channels}
        one = pyfrf.FRF(sampling_freq=5000, exc_type="f", resp_type="a", fft_len=4096)
        one.add_data(found["force"], found["acceleration_z"])
        assert np.isfinite(one.get_H1()[..., 1:]).all()  # it divides by zero at 0 Hz


@pytest.mark.parametrize("kind", KINDS)
def test_netcdf_opens_in_libnetcdf(files: Files, tmp_path: Path, kind: str) -> None:
    netcdf = pytest.importorskip("netCDF4")
    with netcdf.Dataset(exported(files, kind, "netcdf", tmp_path, ".nc")) as file:
        assert file.Conventions.startswith("CF-") and file.simulated == 1
        time = file["elapsed_time"]
        assert time.units == "s" and np.diff(time[:2]) == pytest.approx(1 / file.sample_rate_hz)
        for name, (values, unit) in expected(files, kind).items():
            np.testing.assert_array_equal(np.asarray(file[name][:]), values)
            assert file[name].units == {"m/s^2": "m s-2"}.get(unit, unit)


@pytest.mark.parametrize("kind", [*KINDS, "calibration"])
def test_netcdf_keeps_the_conventions_that_it_names(files: Files, tmp_path: Path, kind: str) -> None:
    """The checker of the ocean sites (IOOS): neither errors nor warnings."""
    runner = pytest.importorskip("compliance_checker.runner")
    out = exported(files, kind, "netcdf", tmp_path, ".nc")
    report = str(tmp_path / "report.json")
    runner.CheckSuite.load_all_available_checkers()
    runner.ComplianceChecker.run_checker(
        str(out), ["cf:1.11"], 0, "strict", output_filename=report, output_format="json"
    )
    (found,) = json.loads(Path(report).read_text("utf-8")).values()
    problems = [one["msgs"] for one in found["all_priorities"] if one["msgs"]]
    assert found["scored_points"] > 0 and not problems


def test_parquet_opens_in_pandas(files: Files, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    pandas = pytest.importorskip("pandas")
    table = pandas.read_parquet(exported(files, "representative", "parquet", tmp_path, ".parquet"))
    np.testing.assert_array_equal(table["acceleration"], files.press.acceleration)


def test_nwb_passes_the_inspector(files: Files, tmp_path: Path) -> None:
    pytest.importorskip("pynwb")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the inspector's own
        inspector = pytest.importorskip("nwbinspector")
        out = exported(files, "recording", "nwb", tmp_path, ".nwb")
        found = list(inspector.inspect_nwbfile(nwbfile_path=out))
    worse = [m for m in found if m.importance.name in ("ERROR", "PYNWB_VALIDATION", "CRITICAL")]
    assert not worse, worse
    import h5py  # its own reader, beneath pynwb

    with h5py.File(out) as file:
        z = file["acquisition/acceleration_z"]
        np.testing.assert_array_equal(z["data"][:], files.presses.acceleration[2])
        assert z["data"].attrs["unit"] == "m/s^2"
        assert len(file["intervals/trials/id"]) == len(files.presses.verdicts)


def test_the_library_beneath_nwb_meets_no_full_disk(
    files: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where one system call after another failed, it crashed as the program ended."""
    pytest.importorskip("pynwb")

    def full(_path: Path, _data: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(haploop.DataError, match=r"a\.nwb cannot be written: No space left on device"):
        haploop.export_file(files.recording, "nwb", tmp_path / "a.nwb")
    assert not list(tmp_path.iterdir())


def test_a_table_of_presses(files: Files, tmp_path: Path) -> None:
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


def test_what_does_not_fit_is_one_sentence(files: Files, tmp_path: Path) -> None:
    with pytest.raises(haploop.ConfigurationError, match=r"recording cannot .*'ahap'.*representative press"):
        haploop.export_file(files.recording, "ahap", tmp_path / "a.ahap")
    with pytest.raises(haploop.ConfigurationError, match="choose csv, mat, netcdf, parquet, uff"):
        haploop.export_file(files.calibration, "wav", tmp_path / "a.wav")
    with pytest.raises(haploop.ConfigurationError, match="Several recordings cannot be exported as 'wav'"):
        haploop.export_file([files.recording, files.recording], "wav", tmp_path / "a.wav")
    with pytest.raises(haploop.ConfigurationError, match="write to another place"):
        haploop.export_file(files.representative, "csv", "")
    (tmp_path / "a.wav.json").write_text("mine")
    with pytest.raises(haploop.ConfigurationError, match="already exists"):
        haploop.export_file(files.drive, "wav", tmp_path / "a.wav")
    assert [p.name for p in tmp_path.iterdir()] == ["a.wav.json"]


def test_a_missing_library_is_named(files: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(haploop.ConfigurationError, match=r'pip install "haploop\[parquet\]"'):
        haploop.export_file(files.drive, "parquet", tmp_path / "a.parquet")
    assert not list(tmp_path.iterdir())


def test_channels_with_names_alike_are_all_in_the_matlab_file(tmp_path: Path) -> None:
    names = ["time", "foo-bar", "foo_bar", "a" * 31 + "1", "a" * 31 + "2"]
    channels = tuple(Channel(name, "N", np.arange(3.0) + 10 * n) for n, name in enumerate(names))
    mat_file.write_signals(Signals("x", 5000.0, channels, "time", {"simulated": False}), tmp_path / "a.mat")
    found = loadmat(tmp_path / "a.mat", squeeze_me=True, simplify_cells=True)
    assert len(found["units"]) == 6 and np.allclose(found["time"], np.arange(3) / 5000)
    firsts = {float(value[0]) for name, value in found.items() if name in found["units"]}
    assert firsts == {0.0, 10.0, 20.0, 30.0, 40.0}


def test_no_text_of_a_table_is_a_formula(tmp_path: Path) -> None:
    table = PressTable("x", {"rig": "", "force": "N"}, ({"rig": "=1+1", "force": -1.0},), {})
    csv_file.write_presses(table, tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text().split() == ["rig,force", "'=1+1,-1.0"]
