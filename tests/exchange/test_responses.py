"""Responses of calibrations for other programs, and from them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

import haploop
from haploop.acquisition import content_hash
from haploop.calibration import Calibration, VibrationMap, read_uff, write_uff
from haploop.exchange import import_response, is_response_file
from tests.exchange.conftest import FREQUENCIES, velocity


def test_a_response_goes_out_and_comes_back(files, run, tmp_path):
    universal, back = tmp_path / "a.uff", tmp_path / "b.h5"
    run("export", files.calibration, "--to", "uff", "--out", universal, ends=0)
    assert run.json("import", universal, "--out", back)["source"].startswith("imported from a.uff, sha256 ")
    imported = Calibration.load(back)
    np.testing.assert_allclose(imported.response.velocity, velocity(), rtol=1e-4)
    assert imported.model.resonance_hz == pytest.approx(263.5, abs=0.1)
    assert imported.response.simulated


@pytest.mark.long
@pytest.mark.parametrize("to", ["csv", "mat", "uff"])
def test_what_is_exported_of_responses_is_read_back(to, files, measured_map, run, tmp_path):
    path, back = tmp_path / f"a.{to}", tmp_path / "b.h5"
    run("export", files.calibration, "--to", to, "--out", path, ends=0)
    run("import", path, "--out", back, ends=0)
    found, whole = Calibration.load(back).response, Calibration.load(files.calibration).response
    rtol = 1e-5 if to == "uff" else 1e-8
    np.testing.assert_allclose(found.frequencies, whole.frequencies, rtol=rtol)
    np.testing.assert_allclose(found.velocity, whole.velocity, rtol=1e-4 if to == "uff" else 1e-8)
    np.testing.assert_allclose(found.coherence, whole.coherence, rtol=1e-5)
    assert (found.patch, found.point, found.simulated) == (whole.patch, whole.point, True)
    if to == "uff":  # of a map see below
        return
    path = path.with_stem("map")
    run("export", measured_map, "--to", to, "--out", path, ends=0)
    run("import", path, "--out", tmp_path / "c.h5", says="A at 3, A at 17, B at 3, B at 17")
    found = import_response(path, haploop.load_rig_file("simulated"), "B", "17")
    np.testing.assert_allclose(found.velocity, own(measured_map, found.frequencies)[3], rtol=1e-8)


def test_a_sidecar_that_fits_no_more_is_one_sentence(files, run, tmp_path):
    path = tmp_path / "a.csv"
    run("export", files.calibration, "--to", "csv", "--out", path, ends=0)
    text = path.read_text()
    for changed in (text.replace("patch", "p", 1), text[: len(text) // 2] + "x", "", text.replace("1", "a")):
        path.write_text(changed)
        run("import", path, "--out", tmp_path / "b.h5", says="export it again")


def test_a_model_goes_to_matlab(files, run, tmp_path):
    assert run.json("export", files.calibration, "--to", "mat", "--out", tmp_path / "a.mat") == {
        "kind": "calibration", "to": "mat", "files": [str(tmp_path / "a.mat")], "simulated": True,
    }  # fmt: skip
    found = loadmat(tmp_path / "a.mat", simplify_cells=True)
    assert found["A"].ndim == 2 and found["units"]["velocity"] == "(m/s)/V"
    assert found["about"]["content_hash"] == content_hash(files.calibration)


def own(path: Path, f: np.ndarray) -> np.ndarray:
    """Velocities of the map's four responses, (response, frequency), as haploop computes them."""
    found = VibrationMap.load(path)
    return np.concatenate([found.velocity(patch, f) for patch in ("A", "B")])


PLACES = [("A", "3", 0, 3), ("A", "17", 1, 5), ("B", "3", 0, 3), ("B", "17", 1, 5)]


def test_a_map_opens_in_pandas(measured_map, tmp_path):
    pandas = pytest.importorskip("pandas")
    done = haploop.export_file(measured_map, "csv", tmp_path / "a.csv")
    assert done.files == (tmp_path / "a.csv", tmp_path / "a.csv.json") and done.simulated
    table = pandas.read_csv(tmp_path / "a.csv")
    beside = json.loads((tmp_path / "a.csv.json").read_text(encoding="utf-8"))
    assert [tuple(one.values()) for one in beside["responses"]] == PLACES
    assert beside["about"]["simulated"] is True and beside["about"]["source"] == "map"
    wanted = own(measured_map, table["frequency [Hz]"].to_numpy())
    for (patch, point, *_), values in zip(PLACES, wanted, strict=True):
        name = f"patch {patch} point {point} velocity"
        np.testing.assert_allclose(table[f"{name} real [(m/s)/V]"], values.real, rtol=1e-8)
        np.testing.assert_allclose(table[f"{name} imaginary [(m/s)/V]"], values.imag, rtol=1e-8)


def test_a_map_in_pyuff(measured_map, tmp_path):
    pyuff = pytest.importorskip("pyuff")
    haploop.export_file(measured_map, "uff", tmp_path / "a.uff")
    sets = [s for s in pyuff.UFF(str(tmp_path / "a.uff")).read_sets() if s["type"] == 58]
    for one, (patch, point, *_), values in zip(sets, PLACES, own(measured_map, sets[0]["x"]), strict=True):
        assert (one["rsp_ent_name"].strip(), one["ref_ent_name"].strip()) == (point, patch)
        assert (one["rsp_node"], one["ref_node"]) == (int(point) + 1, " AB".index(patch))
        kinds = ("func_type", "ordinate_spec_data_type", "orddenom_spec_data_type")
        assert [one[kind] for kind in kinds] == [4, 11, 1]
        units = (one["ordinate_axis_units_lab"].strip(), one["orddenom_axis_units_lab"].strip())
        assert units == ("m/s", "V") and one["abscissa_spec_data_type"] == 18 and one["rsp_dir"] == 3
        np.testing.assert_allclose(one["data"], values, rtol=1e-4)


def test_frequencies_in_uff_have_the_digits_that_fit(tmp_path, files):
    """Lines of a period of 0.6 s: 620.0000 Hz is written, and so is 1.6666667."""
    response = replace(Calibration.load(files.calibration).response, frequencies=FREQUENCIES / 1.2)
    write_uff(tmp_path / "a.uff", [response])
    (found,) = read_uff(tmp_path / "a.uff")
    assert np.abs(found.frequencies / response.frequencies - 1).max() < 1e-6 / 2
    np.testing.assert_allclose(found.velocity, response.velocity, rtol=1e-9)
    np.testing.assert_allclose(found.coherence, response.coherence, rtol=1e-9)


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize(
    ("unit", "factor", "power"),
    [("(m/s)/V", 1.0, 0), ("mm/s/V", 1e-3, 0), ("g/V", 9.80665, -1), ("um/V", 1e-6, 1)],
)
def test_a_complex_array_over_frequencies_is_a_response(tmp_path, unit, factor, power):
    own = velocity()
    path, rig = tmp_path / "a.mat", haploop.load_rig_file("simulated")
    savemat(path, {"H": own / factor / (2j * np.pi * FREQUENCIES) ** power, "freq": FREQUENCIES})
    with pytest.raises(haploop.ConfigurationError, match="what its frequency response 'H' is in"):
        import_response(path, rig, "A", "button")
    with pytest.raises(haploop.ConfigurationError, match="no unit of a response to a patch"):
        import_response(path, rig, "A", "button", "m/s^2/N")
    found = import_response(path, rig, "A", "button", unit)
    assert (found.patch, found.point) == ("A", "button") and is_response_file(path)
    np.testing.assert_allclose(found.velocity, own, rtol=1e-12)
    savemat(path, {"FRF_laser": own, "FRF_accelerometer": 2 * own, "freq": FREQUENCIES})
    with pytest.raises(haploop.ConfigurationError, match="FRF_laser at 1, FRF_accelerometer at 1"):
        import_response(path, rig, unit="(m/s)/V")
    np.testing.assert_allclose(import_response(path, rig, "FRF_laser", unit="(m/s)/V").velocity, own)
    savemat(path, {"H": own, "force": np.arange(400.0), "fs": 5000.0})
    assert not is_response_file(path)


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("engine", ["scipy", "h5netcdf"])
def test_two_parts_over_frequency_in_netcdf_are_a_response(tmp_path, engine):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip(engine)
    own, path = velocity(), tmp_path / "a.nc"
    parts = {"H_real": own.real, "H_imag": own.imag}
    unit = {"units": "m s-1 V-1"}  # as CF asks for
    xarray.Dataset(
        {name: ("frequency", part, unit) for name, part in parts.items()},
        coords={"frequency": ("frequency", FREQUENCIES, {"units": "Hz"})},
    ).to_netcdf(path, engine=engine)
    found = import_response(path, haploop.load_rig_file("simulated"), "A", "button")
    assert is_response_file(path) and (found.patch, found.point) == ("A", "button")
    np.testing.assert_allclose(found.velocity, own, rtol=1e-12)


@pytest.mark.parametrize(("unit", "hertz"), [("Hz", 1.0), ("kHz", 1e3), ("1/min", 1 / 60)])
def test_frequencies_are_in_the_unit_that_the_file_states(unit, hertz, tmp_path):
    path, units = tmp_path / "a.mat", {"f": unit, "H": "(m/s)/V"}
    savemat(path, {"f": FREQUENCIES / hertz, "H": velocity(), "units": units})
    found = import_response(path, haploop.load_rig_file("simulated"), "A", "button")
    np.testing.assert_allclose(found.frequencies, FREQUENCIES, rtol=1e-12)
    savemat(path, {"f": FREQUENCIES, "H": velocity(), "units": {**units, "f": "rad/s"}})
    with pytest.raises(haploop.DataError, match="'f' in 'rad/s': save frequencies in Hz"):
        import_response(path, haploop.load_rig_file("simulated"), "A", "button")
