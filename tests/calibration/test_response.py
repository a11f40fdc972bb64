from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calibration
from calibration import measure_response
from instruments import Aim, ConfigurationError, DataError, InstrumentError, Rig
from tests.calibration.conftest import Calibrated, tamper
from tests.conftest import OpenRig

SHORT: dict[str, Any] = {"repeats": 2, "duration": 1.5, "tail": 0.3, "shares": ()}


def difference(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def true_velocity(rig: Rig, frequencies: np.ndarray) -> np.ndarray:
    if rig.simulation is None:
        pytest.skip("only a simulation knows the truth")
    return np.asarray(rig.simulation.truth.velocity_response("A", "button", frequencies))


def test_the_response_is_the_plates_own(open: OpenRig) -> None:
    """In gain and phase up to the band's end: a delay or a skew of 14 us that was left in would show."""
    rig = open(hysteresis=0)
    seen: list[tuple[float, float]] = []
    response = measure_response(rig, progress=lambda done, total: seen.append((done, total)), shares=())
    truth = true_velocity(rig, response.frequencies)
    assert difference(response.velocity, truth) < 0.006
    high = response.frequencies > 400
    assert difference(response.velocity[high], truth[high]) < 0.012
    assert difference(response.acceleration, truth * 2j * np.pi * response.frequencies) < 0.006
    assert difference(response.displacement * 2j * np.pi * response.frequencies, truth) < 0.006
    assert seen[-1][0] == pytest.approx(seen[-1][1]) == pytest.approx(3 * 8.2)
    assert response.simulated and response.rig == "simulated" and '"seed"' in response.rig_file


def test_hysteresis_changes_the_gain_and_adds_no_harmonics(calibrated: Calibrated) -> None:
    response = calibrated.calibration.response
    truth = true_velocity(calibrated.rig, response.frequencies)
    gain = np.vdot(truth, response.velocity) / np.vdot(truth, truth)
    assert difference(response.velocity / gain, truth) < 0.004
    assert abs(gain) == pytest.approx(1, abs=0.02)
    assert np.angle(gain) < -0.05


def test_noise_coherence_and_path_are_what_the_rig_has(calibrated: Calibrated) -> None:
    response = calibrated.calibration.response
    assert np.all((response.coherence >= 0) & (response.coherence <= 1))
    assert response.coherence_min(255, 272) > 0.999
    with pytest.raises(DataError, match="700"):
        response.coherence_min(700, 800)
    assert np.abs(response.path).max() < 1.03
    # Half a step of the staircase and the amplifier's pole.
    late = -np.polyfit(2 * np.pi * response.frequencies, np.unwrap(np.angle(response.path)), 1)[0]
    assert 30e-6 < late < 60e-6
    if calibrated.rig.simulated:
        # hardware.md, section 5a: 0.02 um/s per sqrt(Hz) in the 20 mm/s range, and the converter's own.
        assert 0.018e-6 < np.median(response.noise) < 0.03e-6


def test_a_laser_that_sees_nothing_is_no_response(open: OpenRig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = open()
    noise = np.random.default_rng(1)
    tamper(rig, monkeypatch, laser=lambda v: 1e-3 * noise.standard_normal(len(v)))
    with pytest.raises(DataError, match="does not follow patch A"):
        measure_response(rig, **SHORT)


def test_a_drive_that_does_not_arrive_is_said(open: OpenRig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = open()
    tamper(rig, monkeypatch, drive=lambda v: 0.01 * v)
    with pytest.raises(InstrumentError, match="drive monitor"):
        measure_response(rig, **SHORT)


def test_a_laser_out_of_range_is_said(open: OpenRig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = open()
    tamper(rig, monkeypatch, laser=lambda v: 100 * v)
    with pytest.raises(InstrumentError, match="range of 20 mm/s"):
        measure_response(rig, **SHORT)


def test_nothing_is_measured_that_the_operator_did_not_confirm(
    open: OpenRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = open()
    monkeypatch.setattr(rig.operator, "confirm", lambda request: not isinstance(request, Aim))
    with pytest.raises(InstrumentError, match="Aim the laser"):
        measure_response(rig, **SHORT)


def test_what_a_response_needs_is_asked_for(open: OpenRig) -> None:
    rig = open()
    with pytest.raises(ConfigurationError, match="2 repeats"):
        measure_response(rig, repeats=1)
    sensors = rig.sensors.model_copy(update={"drive": None})
    rig.file = rig.file.model_copy(update={"sensors": sensors})
    with pytest.raises(ConfigurationError, match=r"sensors\.drive"):
        measure_response(rig, **SHORT)


def test_a_vibrometer_without_light_is_said(open: OpenRig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = open()
    monkeypatch.setattr(rig.vibrometer, "signal_level", lambda: 0.02)
    with pytest.raises(InstrumentError, match="2% of its light"):
        measure_response(rig, **SHORT)


def test_estimators_see_only_what_a_lab_would_see() -> None:
    for source in Path(calibration.__file__).parent.glob("*.py"):
        assert not re.search(r"\.simulation\b|\btruth\b|\bmocks\b", source.read_text(encoding="utf-8")), (
            source
        )


def test_a_response_is_a_value(calibrated: Calibrated) -> None:
    with pytest.raises(AttributeError):
        calibrated.calibration.response.patch = "B"  # type: ignore[misc]
    assert replace(calibrated.calibration.response, patch="B").patch == "B"
