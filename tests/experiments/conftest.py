"""Digital buttons for tests: made once, in haste, on the simulated table."""

from __future__ import annotations

from pathlib import Path

import pytest

import haploop


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with latch.h5 and push.h5, which pass their checks."""
    folder = tmp_path_factory.mktemp("buttons")
    with haploop.open_rig("simulated") as rig:
        calibration = haploop.calibrate(rig, patch="A", point="button")
        for name in ("latch", "push"):
            recording = haploop.record(rig, button=name, participant="P01", presses=3, out=folder)
            press = haploop.representative([recording])
            button = haploop.build_button(rig, press, calibration, iterations=2, plays=3)
            assert button.passed
            button.save(folder / f"{name}.h5")
    return folder
