import os
from pathlib import Path

import pytest

from haploop.base import hdf5
from haploop.base.errors import DataError
from haploop.calibration import Calibration, Drive
from tests.calibration.conftest import Calibrated
from tests.raising import raises


@pytest.fixture
def saved(calibrated: Calibrated, tmp_path: Path) -> Path:
    path = tmp_path / "calibration.h5"
    calibrated.calibration.save(path)
    return path


def test_what_was_measured_is_never_overwritten(calibrated, saved):
    before = saved.read_bytes()
    raises(DataError, "not overwritten", calibrated.calibration.save, saved)
    assert saved.read_bytes() == before


def test_a_newer_file_stays(calibrated, tmp_path, monkeypatch):
    path = tmp_path / "calibration.h5"
    path.write_text("another process")
    monkeypatch.setattr(os.path, "lexists", lambda _path: False)
    raises(DataError, "not overwritten", calibrated.calibration.save, path)
    assert path.read_text() == "another process"
    assert len(list(tmp_path.iterdir())) == 1


def test_files_that_are_none_say_so(saved, calibrated):
    text, cut = saved.with_name("text.h5"), saved.with_name("cut.h5")
    text.write_text("hello")
    cut.write_bytes(saved.read_bytes()[:-3000])
    for says, read in (
        ("There is no file", lambda: Calibration.load(saved.with_name("missing.h5"))),
        ("not a haploop drive", lambda: Drive.load(saved)),
        ("is text, and no file of haploop", lambda: Calibration.load(text)),
        ("is truncated: it has", lambda: Calibration.load(cut)),
        (
            "cannot be written",
            lambda: calibrated.calibration.save(saved.parent / "no" / "such" / "folder.h5"),
        ),
    ):
        raises(DataError, says, read)


def test_another_format(calibrated, tmp_path, monkeypatch):
    saved = tmp_path / "calibration.h5"
    with monkeypatch.context() as another:
        another.setattr(hdf5, "VERSION", 99)
        calibrated.calibration.save(saved)
    raises(DataError, "format 99", Calibration.load, saved)
