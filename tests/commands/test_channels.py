"""`calibrate --since`: how channels scatter."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from haploop.calibration import Calibration, Waveforms
from tests.command_line import Demo, Run


def test_earlier_calibrations_tell_how_a_channel_scatters(demo: Demo, run: Run, tmp_path: Path) -> None:
    table = demo.folder / "calibration.h5"
    first = Calibration.load(table)
    earlier = []
    for number, gain in enumerate((0.998, 1.0, 1.003)):
        response = replace(first.response, velocity=gain * first.response.velocity)
        earlier += ["--since", tmp_path / f"{number}.h5"]
        replace(first, response=response).save(tmp_path / f"{number}.h5")
    out = tmp_path / "table.h5"
    made = run("calibrate", *earlier, "--out", out, "--json")
    assert made.exit_code == 0, made.stderr
    channel = json.loads(made.stdout)["channel"]
    again = Calibration.load(out)
    assert channel["changes"] == 3 and again.scatter.gain == channel["gain"] == pytest.approx(
        0.0036, abs=0.0005
    )
    assert Waveforms.load(Waveforms.beside(out)).calibration == again.digest

    few = run("calibrate", "--since", table, "--out", tmp_path / "few.h5")
    assert few.exit_code == 2 and "--since needs 3 earlier calibrations" in " ".join(few.stderr.split())
    assert not (tmp_path / "few.h5").exists()
