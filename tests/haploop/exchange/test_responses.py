"""Responses of calibrations for other programs, and from them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

import haploop
from haploop.calibration import Calibration
from tests.haploop.conftest import Run
from tests.haploop.exchange.conftest import FREQUENCIES, Files, velocity


def test_a_response_goes_out_and_comes_back(files: Files, run: Run, tmp_path: Path) -> None:
    universal, back = tmp_path / "a.uff", tmp_path / "b.h5"
    assert run("export", files.calibration, "--to", "uff", "--out", universal).exit_code == 0
    result = run("import", universal, "--out", back, "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["source"].startswith("imported from a.uff, sha256 ")
    imported = Calibration.load(back)
    np.testing.assert_allclose(imported.response.velocity, velocity(), rtol=1e-4)
    assert imported.model.resonance_hz == pytest.approx(263.5, abs=0.1)
    assert imported.response.simulated


def test_a_model_goes_to_matlab(files: Files, run: Run, tmp_path: Path) -> None:
    result = run("export", files.calibration, "--to", "mat", "--out", tmp_path / "a.mat", "--json")
    assert json.loads(result.stdout) == {
        "kind": "calibration", "to": "mat", "files": [str(tmp_path / "a.mat")], "simulated": True,
    }  # fmt: skip
    assert loadmat(tmp_path / "a.mat")["A"].ndim == 2


def test_a_response_as_a_table(files: Files, tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    haploop.export_file(files.calibration, "csv", tmp_path / "a.csv")
    table = pandas.read_csv(tmp_path / "a.csv")
    np.testing.assert_allclose(table["frequency [Hz]"], FREQUENCIES)
    name = "patch A point button velocity"
    found = table[f"{name} real [(m/s)/V]"] + 1j * table[f"{name} imaginary [(m/s)/V]"]
    np.testing.assert_allclose(found, velocity(), rtol=1e-7)


def test_a_response_in_libnetcdf(files: Files, tmp_path: Path) -> None:
    netcdf = pytest.importorskip("netCDF4")
    haploop.export_file(files.calibration, "netcdf", tmp_path / "a.nc")
    with netcdf.Dataset(tmp_path / "a.nc") as file:
        found = np.asarray(file["velocity_real"][0] + 1j * file["velocity_imaginary"][0])
        np.testing.assert_array_equal(found, velocity())
        assert file["velocity_real"].units == "m s-1 V-1"
        assert b"".join(file["point"][0]).decode() == "button"
