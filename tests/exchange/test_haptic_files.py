"""Files for phones and headsets follow their formats' published rules, and mean the press.

No independent reader of these formats is on PyPI or in Debian: published_rules.py has what is published of
each field, and the envelope is read back by a few lines that share nothing with the writer.
"""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

import haploop
from haploop.acquisition import Representative
from haploop.calibration import DigitalButton
from haploop.exchange.haptic_files import write_android
from haploop.exchange.views import Envelope
from tests.exchange.conftest import Files
from tests.exchange.published_rules import RULES

KINDS = ("representative", "drive", "check", "button")


def read(files: Files, tmp_path: Path, format: str, kind: str = "representative") -> Any:
    out = tmp_path / f"{kind}.{format}"
    done = haploop.export_file(getattr(files, kind), format, out)
    text = out.read_text(encoding="utf-8")
    assert done.simulated and "Simulated" in text
    return json.loads(text)


def rises(values: list[float]) -> bool:
    return all(a < b for a, b in itertools.pairwise(values))


def resemble(times: list[float], amplitude: list[float], files: Files, least: float) -> None:
    """The envelope follows the rms of the press over 7 ms, computed without any filter of the writer."""
    press = files.press.acceleration
    own = np.sqrt(np.convolve(press**2, np.ones(35) / 35, "same"))
    found = np.interp(np.arange(len(press)) / 5000, times, amplitude)
    assert np.corrcoef(own, found)[0, 1] > least
    assert max(amplitude) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("format", RULES)
def test_every_field_is_as_published(files: Files, tmp_path: Path, format: str, kind: str) -> None:
    found = json.dumps(read(files, tmp_path, format, kind))
    RULES[format].model_validate_json(found)


BAND = ("perceptions", 0, "channels", 0, "bands", 0)


@pytest.mark.parametrize(
    ("format", "place", "value"),
    [
        ("ahap", ("Pattern", 0, "Event", "EventDuration"), 31.0),
        ("ahap", ("Pattern", 0, "Event", "EventParameters", 0, "ParameterValue"), 1.1),
        ("ahap", ("Pattern", 1, "ParameterCurve", "ParameterCurveControlPoints", 0, "ParameterValue"), -0.1),
        ("haptic", ("signals", "continuous", "envelopes", "amplitude"), []),
        ("haptic", ("signals", "continuous", "envelopes", "frequency", 0, "frequency"), 1.5),
        ("haptic", ("version", "major"), 2),
        ("android", ("amplitudes", 0), 256),
        ("android", ("timings", 0), 2.5),
        ("android", ("repeat",), 1_000_000),
        ("hjif", ("version",), "1"),
        ("hjif", ("date",), ""),
        ("hjif", ("timescale",), 48001),
        ("hjif", ("perceptions", 0, "channels", 0, "mixing_weight"), 1.0),
        ("hjif", (*BAND, "curve_type"), "Unknown"),
        ("hjif", (*BAND, "upper_frequency_limit"), 100),
        ("hjif", (*BAND, "effects", 0, "keyframes", 0, "frequency_modulation"), 200.5),
    ],
)
def test_another_field_is_refused(
    files: Files, tmp_path: Path, format: str, place: tuple[str | int, ...], value: object
) -> None:
    """So that the rules say something."""
    found = inner = read(files, tmp_path, format)
    for step in place[:-1]:
        inner = inner[step]
    inner[place[-1]] = value
    with pytest.raises(ValidationError):
        RULES[format].model_validate_json(json.dumps(found))


@pytest.mark.parametrize("kind", KINDS)
def test_ahap(files: Files, tmp_path: Path, kind: str) -> None:
    """Apple, "Representing haptic patterns in AHAP files"."""
    found = read(files, tmp_path, "ahap", kind)
    assert found["Version"] == 1.0
    event = found["Pattern"][0]["Event"]
    assert event["EventType"] == "HapticContinuous" and 0 < event["EventDuration"] <= 30
    curves = {c["ParameterCurve"]["ParameterID"]: c["ParameterCurve"] for c in found["Pattern"][1:]}
    assert set(curves) == {"HapticIntensityControl", "HapticSharpnessControl"}
    for name, curve in curves.items():
        points = curve["ParameterCurveControlPoints"]
        times = [point["Time"] for point in points]
        assert curve["Time"] == 0 and 2 <= len(points) <= 16 and rises(times)
        assert times[-1] == pytest.approx(event["EventDuration"])
        low = 0.0 if name.startswith("HapticI") else -1.0
        assert all(low <= point["ParameterValue"] <= 1 for point in points)
    if kind == "representative":
        points = curves["HapticIntensityControl"]["ParameterCurveControlPoints"]
        resemble([p["Time"] for p in points], [p["ParameterValue"] for p in points], files, 0.95)


@pytest.mark.parametrize("kind", KINDS)
def test_meta_haptic(files: Files, tmp_path: Path, kind: str) -> None:
    """The data model's validation rules: ordered times, values from 0 to 1, not empty."""
    found = read(files, tmp_path, "haptic", kind)
    assert found["version"] == {"major": 1, "minor": 0, "patch": 0}
    envelopes = found["signals"]["continuous"]["envelopes"]
    for name in ("amplitude", "frequency"):
        points = envelopes[name]
        assert len(points) >= 2 and rises([point["time"] for point in points])
        assert points[0]["time"] == 0 and points[-1]["time"] > 0
        assert all(0 <= point[name] <= 1 for point in points)
    if kind == "representative":
        points = envelopes["amplitude"]
        resemble([p["time"] for p in points], [p["amplitude"] for p in points], files, 0.98)


def test_the_frequency_is_the_press_s(files: Files, tmp_path: Path) -> None:
    """A drive of 235 Hz: 0.723 of the way from 65 to 300 Hz, wherever it is felt."""
    envelopes = read(files, tmp_path, "haptic", "drive")["signals"]["continuous"]["envelopes"]
    strong = [
        f["frequency"]
        for a, f in zip(envelopes["amplitude"], envelopes["frequency"], strict=True)
        if a["amplitude"] > 0.2
    ]
    assert strong and max(abs(f - (235 - 65) / (300 - 65)) for f in strong) < 0.02
    effect = read(files, tmp_path, "hjif", "drive")["perceptions"][0]["channels"][0]["bands"][0]["effects"][0]
    strong = [k["frequency_modulation"] for k in effect["keyframes"] if k["amplitude_modulation"] > 0.2]
    assert strong and all(abs(f - 235) < 5 for f in strong)


def test_android(files: Files, tmp_path: Path) -> None:
    """VibrationEffect.createWaveform: as many amplitudes as timings, 0 to 255, no negative time."""
    found = read(files, tmp_path, "android")
    timings, amplitudes = found["timings"], found["amplitudes"]
    assert len(timings) == len(amplitudes) and found["repeat"] == -1
    assert all(isinstance(t, int) and t > 0 for t in timings)
    assert all(isinstance(a, int) and 0 <= a <= 255 for a in amplitudes)
    assert sum(timings) == pytest.approx(1000 * files.press.duration, abs=5)
    loudest = int(np.argmax(amplitudes))
    assert sum(timings[:loudest]) / 1000 == pytest.approx(0.3, abs=0.01)  # where the press was made to snap


def test_hjif(files: Files, tmp_path: Path) -> None:
    found = read(files, tmp_path, "hjif")
    (perception,) = found["perceptions"]
    (channel,) = perception["channels"]
    (band,) = channel["bands"]
    (effect,) = band["effects"]
    keyframes = effect["keyframes"]
    ticks = [keyframe["relative_position"] for keyframe in keyframes]
    scale = found["timescale"]
    resemble([t / scale for t in ticks], [k["amplitude_modulation"] for k in keyframes], files, 0.98)


def test_the_scale_is_said(files: Files, tmp_path: Path) -> None:
    said = read(files, tmp_path, "ahap", "button")["Metadata"]["Description"]
    press = DigitalButton.load(files.button).press
    peak = float(said.split("Amplitude 1 is ")[1].split(" m/s^2")[0])
    assert 0.5 * np.abs(press.acceleration).max() < peak < 1.2 * np.abs(press.acceleration).max()


def test_a_press_without_motion_is_refused(files: Files, tmp_path: Path) -> None:
    from dataclasses import replace

    still: Representative = replace(files.press, acceleration=np.zeros(3000))
    still.save(tmp_path / "still.h5")
    with pytest.raises(haploop.DataError, match="no motion"):
        haploop.export_file(tmp_path / "still.h5", "ahap", tmp_path / "still.ahap")


def test_a_step_of_android_has_the_mean_of_the_envelope_within_it(tmp_path: Path) -> None:
    line = np.array([0.0, 1.0])
    about: Any = {"simulated": True, "software": "", "source": ""}
    envelope = Envelope("a ramp of 50 ms", 0.05 * line, line, 100 * line, 3.0, about)
    write_android(envelope, tmp_path / "ramp.json")
    found = json.loads((tmp_path / "ramp.json").read_text(encoding="utf-8"))
    assert found["timings"] == [5] * 10
    assert found["amplitudes"] == [13, 38, 64, 89, 115, 140, 166, 191, 217, 242]  # 25.5 (k + 1/2)
