import shutil
from datetime import UTC, datetime
from pathlib import Path

import pytest

from haploop.calibration.drive.button import build_button
from haploop.calibration.recalibration.adoption import adopt
from haploop.calibration.recalibration.history import History
from haploop.calibration.recalibration.recalibration import recalibrate
from tests.calibration.conftest import Calibrated, make_press

WHEN = datetime(2026, 7, 31, 2, 15, tzinfo=UTC)


@pytest.fixture(scope="session")
def first(calibrated: Calibrated, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A history with one generation, of one button, and one look."""
    button = build_button(calibrated.rig, make_press(), calibrated.calibration, iterations=0)
    folder = tmp_path_factory.mktemp("history") / "calibrations"
    history = History(folder)
    adopt(history, [button], actor="a test", reason="it begins", when=WHEN)
    # The look that knows how the laser is when all is well.
    assert recalibrate(calibrated.rig, history, when=WHEN).kind == "unchanged"
    return folder


@pytest.fixture
def history(first: Path, tmp_path: Path) -> History:
    return History(shutil.copytree(first, tmp_path / "calibrations"))
