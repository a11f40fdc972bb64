"""One file of each kind: a recording from the twin, the rest made of known numbers."""

import io
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import haploop
from haploop.acquisition import Recording, Representative
from haploop.calibration import Calibration, Check, DigitalButton, Drive, Learning, Response
from haploop.calibration.drive.agreement import SharedPower
from haploop.calibration.drive.checked import Above, ThirdOctaves, Tones
from haploop.calibration.map.measuring import map_plan, measure_map
from haploop.exchange.columns import contained
from tests.calibration.conftest import make_press

FREQUENCIES = np.arange(40.0, 600.0, 2.0)


def velocity() -> np.ndarray:
    """Two modes: 120 and 263.5 Hz."""
    s = 2j * np.pi * FREQUENCIES
    return np.asarray(
        sum(
            a * s / (s**2 + 2 * z * 2 * np.pi * f * s + (2 * np.pi * f) ** 2)
            for f, z, a in ((120.0, 0.01, 0.2), (263.5, 0.01, 0.5))
        )
    )


def make_response(rig_file: str) -> Response:
    none = np.zeros(0)
    return Response(
        patch="A", point="button", frequencies=FREQUENCIES, velocity=velocity(), deviation=none,
        coherence=np.linspace(0.9, 0.99, len(FREQUENCIES)),
        path=np.ones(len(FREQUENCIES), dtype=np.complex128), noise=none, distortion=np.zeros((0, 0)),
        repeats=1, level=10.0, levels=none, level_gain=none.astype(np.complex128), pickup_range=0.02,
        excitation="made for a test", source="measured", rig="simulated", rig_file=rig_file, simulated=True,
        created="2026-11-22T10:00:00+00:00",
    )  # fmt: skip


def make_drive() -> Drive:
    t = np.arange(5000) / 50_000
    return Drive(button="push", patches=("A",), point="button", rate_hz=50_000.0,
        volts=np.asarray(20 * np.sin(2 * np.pi * 235 * t) * np.hanning(len(t)))[None],
        target=np.asarray(3 * np.cos(2 * np.pi * 235 * t) * np.hanning(len(t))), scale=0.5,
        method="modulated", carrier_hz=235.0, band=(75.0, 600.0), in_band=0.9, known=(40.0, 600.0),
        predicted_error=0.05, unreached="", rig="simulated", simulated=True,
        sources=(("P01-push.h5", "0" * 64),), calibration="0" * 64)  # fmt: skip


def make_check(drive: Drive) -> Check:
    target = drive.target[::10]
    plays = np.stack([target * 1.01, target * 0.99])
    octaves = np.array([100.0, 125.0, 160.0, 200.0, 250.0])
    error, level = SharedPower(0.015**2, 1e-5, 1e-4, 2), np.zeros(5)
    return Check(
        drive=drive, rate_hz=5000.0, target=target, accelerations=plays, judged_hz=1000.0,
        whole=error, within=error, outside=error, above=Above(error), correlation=0.99,
        envelope_correlation=0.99,
        octaves=ThirdOctaves(octaves, level, level, level - 40), drift=0.0, tones=Tones(np.zeros(0), 0.0),
        drive_measured_peak=20.0, overload=False, tolerance=0.2, verdict="pass", reasons=(), notes=(),
        simulated=True,
    )  # fmt: skip


@dataclass(frozen=True)
class Files:
    """Paths of one file of each kind, and what some of them hold."""

    folder: Path
    recording: Path
    representative: Path
    drive: Path
    check: Path
    calibration: Path
    button: Path

    @property
    def presses(self) -> Recording:
        return Recording.open(self.recording)

    @property
    def press(self) -> Representative:
        return Representative.load(self.representative)


@pytest.fixture(scope="session")
def measured_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Points 3 and 17 of the table by patches A and B."""
    folder = tmp_path_factory.mktemp("exchange") / "map"
    with haploop.open_rig("simulated") as rig:
        measure_map(rig, folder, map_plan(rig, points=(3, 17), patches=("A", "B"), period=0.5))
    return folder


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    folder = tmp_path_factory.mktemp("exchange")
    with haploop.open_rig("simulated") as rig:
        recording = haploop.record(rig, button="push", participant="P01", presses=2, out=folder)
        rig_file = rig.file.model_dump_json()
    found = Files(
        folder,
        recording.path,
        *(folder / f"{name}.h5" for name in ("press", "drive", "check", "calibration", "button")),
    )
    press, drive = make_press(), make_drive()
    check, calibration = make_check(drive), Calibration.of(make_response(rig_file))
    learning = Learning((), 0, 0.1, 0.1, "made for a test", drive)
    press.save(found.representative)
    drive.save(found.drive)
    check.save(found.check)
    calibration.save(found.calibration)
    DigitalButton(press, (calibration,), learning, check, "2026-11-22", "haploop").save(found.button)
    assert replace(press).simulated
    return found


@pytest.fixture
def read_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files that libraries read are read in this process, as starting another takes half a second."""

    def answered(_module: str, path: Path, *, pace: int) -> bytes:
        said = io.BytesIO()
        with monkeypatch.context() as patch:
            patch.setattr(contained, "allow_memory", lambda _: None)
            patch.setattr(sys, "argv", ["", str(path)])
            patch.setattr(sys, "stdout", SimpleNamespace(buffer=said))
            contained._in_child()
        return said.getvalue()

    monkeypatch.setattr(contained, "answer_of", answered)
