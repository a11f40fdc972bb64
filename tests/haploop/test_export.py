"""Calibrations for other programs, and from them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from haploop.calibration import Calibration
from tests.haploop.conftest import Demo, Run


def test_a_response_goes_out_and_comes_back(demo: Demo, run: Run, tmp_path: Path) -> None:
    universal, back = tmp_path / "a.uff", tmp_path / "b.h5"
    assert run("export", demo.folder / "calibration.h5", "--to", universal).exit_code == 0
    result = run("import", universal, "--out", back, "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["source"].startswith("imported from a.uff, sha256 ")
    own, imported = Calibration.load(demo.folder / "calibration.h5"), Calibration.load(back)
    np.testing.assert_allclose(imported.response.velocity, own.response.velocity, rtol=1e-4)
    assert imported.model.resonance_hz == pytest.approx(own.model.resonance_hz, abs=0.01)
    assert imported.response.simulated


def test_a_model_goes_to_matlab(demo: Demo, run: Run, tmp_path: Path) -> None:
    assert run("export", demo.folder / "calibration.h5", "--to", tmp_path / "a.mat").exit_code == 0
    assert loadmat(tmp_path / "a.mat")["A"].ndim == 2


@pytest.mark.parametrize(
    ("args", "sentence"),
    [
        (["export", "calibration.h5", "--to", "a.txt"], "use a name that ends with .uff or .mat"),
        (["import", "report.html", "--out", "b.h5"], "report.html"),
        (["import", "nothing.uff", "--out", "b.h5"], "nothing.uff"),
    ],
)
def test_what_will_not_do_is_refused(
    demo: Demo, run: Run, tmp_path: Path, args: list[str], sentence: str
) -> None:
    names = [demo.folder / arg if "." in arg and not arg.startswith(("a.", "b.")) else arg for arg in args]
    names = [tmp_path / arg if str(arg).startswith(("a.", "b.")) else arg for arg in names]
    result = run(*names)
    assert result.exit_code == 2
    assert sentence in result.stderr
