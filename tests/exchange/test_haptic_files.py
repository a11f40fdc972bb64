"""Files for phones and headsets follow their formats' published rules, and mean the press.

No independent reader of these formats is on PyPI or in Debian: published_rules.py has what is published of
each field, and the envelope is read back by a few lines that share nothing with the writer.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

import haploop
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


def resemble(times: list[float], amplitude: list[float], files: Files, least: float) -> None:
    """The envelope follows the rms of the press over 7 ms, computed without any filter of the writer."""
    press = files.press.acceleration
    own = np.sqrt(np.convolve(press**2, np.ones(35) / 35, "same"))
    found = np.interp(np.arange(len(press)) / 5000, times, amplitude)
    assert np.corrcoef(own, found)[0, 1] > least
    assert max(amplitude) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("format", RULES)
def test_every_field_is_as_published(files, tmp_path, format, kind):
    found = json.dumps(read(files, tmp_path, format, kind))
    RULES[format].model_validate_json(found)


BAND = ("perceptions", 0, "channels", 0, "bands", 0)


@pytest.mark.parametrize(
    ("format", "place", "value"),
    [
        ("ahap", ("Pattern", 0, "Event", "EventDuration"), 31.0),
        ("ahap", ("Pattern", 1, "ParameterCurve", "ParameterCurveControlPoints", 0, "ParameterValue"), -0.1),
        ("haptic", ("signals", "continuous", "envelopes", "frequency", 0, "frequency"), 1.5),
        ("android", ("amplitudes", 0), 256),
        ("hjif", ("version",), "1"),
        ("hjif", (*BAND, "curve_type"), "Unknown"),
        ("hjif", (*BAND, "effects", 0, "keyframes", 0, "frequency_modulation"), 200.5),
    ],
)
def test_another_field_is_refused(files, tmp_path, format, place, value):
    """So that the rules say something."""
    found = inner = read(files, tmp_path, format)
    for step in place[:-1]:
        inner = inner[step]
    inner[place[-1]] = value
    with pytest.raises(ValidationError):
        RULES[format].model_validate_json(json.dumps(found))


def test_the_frequency_is_the_press_s(files, tmp_path):
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


def test_the_envelope_is_the_press_in_each_format_and_its_scale_is_said(files, tmp_path):
    """AHAP has 16 points a curve at most, and Android's steps of 5 ms have whole numbers."""
    found = read(files, tmp_path, "ahap")
    event, *curves = (next(iter(one.values())) for one in found["Pattern"])
    assert {curve["ParameterID"] for curve in curves} == {"HapticIntensityControl", "HapticSharpnessControl"}
    for curve in curves:
        points = curve["ParameterCurveControlPoints"]
        assert curve["Time"] == 0 and points[-1]["Time"] == pytest.approx(event["EventDuration"])
        if curve["ParameterID"].startswith("HapticI"):
            resemble([p["Time"] for p in points], [p["ParameterValue"] for p in points], files, 0.95)
    peak = float(found["Metadata"]["Description"].split("Amplitude 1 is ")[1].split(" m/s^2")[0])
    assert 0.5 < peak / np.abs(files.press.acceleration).max() < 1.2
    envelopes = read(files, tmp_path, "haptic")["signals"]["continuous"]["envelopes"]
    points = envelopes["amplitude"]
    assert points[0]["time"] == envelopes["frequency"][0]["time"] == 0
    resemble([p["time"] for p in points], [p["amplitude"] for p in points], files, 0.98)
    found = read(files, tmp_path, "hjif")
    keyframes = found["perceptions"][0]["channels"][0]["bands"][0]["effects"][0]["keyframes"]
    ticks = [keyframe["relative_position"] / found["timescale"] for keyframe in keyframes]
    resemble(ticks, [k["amplitude_modulation"] for k in keyframes], files, 0.98)
    found = read(files, tmp_path, "android")
    assert sum(found["timings"]) == pytest.approx(1000 * files.press.duration, abs=5)
    loudest = int(np.argmax(found["amplitudes"]))
    assert sum(found["timings"][:loudest]) / 1000 == pytest.approx(0.3, abs=0.01), "where the press snaps"
    still = replace(files.press, acceleration=np.zeros(3000))
    still.save(tmp_path / "still.h5")
    with pytest.raises(haploop.DataError, match="no motion"):
        haploop.export_file(tmp_path / "still.h5", "ahap", tmp_path / "still.ahap")


def test_a_step_of_android_has_the_mean_of_the_envelope_within_it(tmp_path):
    line = np.array([0.0, 1.0])
    about: Any = {"simulated": True, "software": "", "source": ""}
    envelope = Envelope("a ramp of 50 ms", 0.05 * line, line, 100 * line, 3.0, about)
    write_android(envelope, tmp_path / "ramp.json")
    found = json.loads((tmp_path / "ramp.json").read_text(encoding="utf-8"))
    assert found["timings"] == [5] * 10
    assert found["amplitudes"] == [13, 38, 64, 89, 115, 140, 166, 191, 217, 242]  # 25.5 (k + 1/2)


@pytest.mark.parametrize("format", ["ahap", "haptic", "hjif", "android"])
def test_a_button_has_the_level_of_the_table_or_that_of_its_press(files, tmp_path, format):
    button = DigitalButton.load(files.button)
    said = []
    for of, acceleration in (("table", button.drive.target), ("press", button.press.acceleration)):
        haploop.export_file(files.button, format, tmp_path / of, of=of)
        words = (tmp_path / of).read_text(encoding="utf-8").split("Amplitude 1 is ")[1]
        level = float(words.split(" m/s^2")[0])
        # The envelope of a click is averaged over 2 ms.
        assert 0.5 < level / np.abs(acceleration).max() < 1.2
        said.append(level)
    assert said[0] != pytest.approx(said[1], rel=0.05)
    with pytest.raises(haploop.ConfigurationError, match="of a digital button"):
        haploop.export_file(files.drive, format, tmp_path / "drive", of="press")
