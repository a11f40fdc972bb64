"""Files for phones and headsets: Apple AHAP, Meta .haptic, Android's waveform, and MPEG hjif.

All hold amplitude and frequency over time, and none a waveform in SI units; what their numbers stand for is
said in each file. Frequencies from 65 to 300 Hz become sharpness 0 to 1 in AHAP and .haptic, as in MPEG's
reference encoder (https://github.com/MPEGGroup/HapticReferenceSoftware, AhapEncoder.h): neither Apple nor
Meta states a relation.
"""

from __future__ import annotations

from datetime import date
from pathlib import Path

import numpy as np

from ..base.arrays import FloatArray
from ..base.errors import DataError
from .views import Envelope, write_json

_SHARPNESS_HZ = (65.0, 300.0)
_MAPPED = "Frequency 0 to 1 is {:g} to {:g} Hz, linear, clipped.".format(*_SHARPNESS_HZ)
_AHAP_POINTS = 16
"""Largest number of control points of an AHAP curve."""
_AHAP_SECONDS = 30.0
"""Longest event in AHAP."""
_ANDROID_MS = 5
"""Step of Android's waveform (ms): a motor follows no faster."""
_TICKS = 8000
"""Ticks a second in hjif."""


def write_ahap(envelope: Envelope, path: Path) -> None:
    """One continuous event, with a curve of intensity and one of sharpness.

    Raises DataError for more than 30 s.
    """
    duration = float(envelope.times[-1])
    if duration > _AHAP_SECONDS:
        raise DataError(f"An AHAP event lasts {_AHAP_SECONDS:g} s at most, and this press {duration:.0f} s.")
    # The curves begin with the event, so that a reader that takes their times as absolute is right too.
    curves = [
        {
            "ParameterCurve": {
                "ParameterID": name,
                "Time": 0.0,
                "ParameterCurveControlPoints": [
                    {"Time": _digits(t), "ParameterValue": _digits(v)}
                    for t, v in _thinned(envelope.times, values, _AHAP_POINTS)
                ],
            }
        }
        for name, values in (
            ("HapticIntensityControl", envelope.amplitude),
            ("HapticSharpnessControl", _sharpness(envelope) - 0.5),
        )
    ]
    # A sharpness curve adds to the event's own sharpness; an intensity curve multiplies its intensity.
    event = {
        "Event": {
            "Time": 0.0,
            "EventType": "HapticContinuous",
            "EventDuration": _digits(duration),
            "EventParameters": [
                {"ParameterID": "HapticIntensity", "ParameterValue": 1.0},
                {"ParameterID": "HapticSharpness", "ParameterValue": 0.5},
            ],
        }
    }
    about = {"Project": envelope.title, "Description": envelope.mapping(_MAPPED), **_origin(envelope)}
    write_json(path, {"Version": 1.0, "Metadata": about, "Pattern": [event, *curves]})


def write_meta(envelope: Envelope, path: Path) -> None:
    """Meta's (once Lofelt's) `.haptic`, version 1: breakpoints of amplitude and frequency from 0 to 1."""
    times = [_digits(t) for t in envelope.times]
    amplitude, frequency = envelope.amplitude, _sharpness(envelope)
    write_json(
        path,
        {
            "version": {"major": 1, "minor": 0, "patch": 0},
            "metadata": {
                "editor": str(envelope.about["software"]),
                "source": str(envelope.about["source"]),
                "project": envelope.title,
                "tags": ["simulated"] if envelope.about["simulated"] else [],
                "description": envelope.mapping(_MAPPED),
            },
            "signals": {
                "continuous": {
                    "envelopes": {
                        "amplitude": [
                            {"time": t, "amplitude": _digits(a)}
                            for t, a in zip(times, amplitude, strict=True)
                        ],
                        "frequency": [
                            {"time": t, "frequency": _digits(f)}
                            for t, f in zip(times, frequency, strict=True)
                        ],
                    }
                }
            },
        },
    )


def write_android(envelope: Envelope, path: Path) -> None:
    """Arguments of `VibrationEffect.createWaveform(timings, amplitudes, repeat)`: ms, and 0 to 255."""
    steps = max(1, round(1e3 * float(envelope.times[-1]) / _ANDROID_MS))
    middles = (np.arange(steps) + 0.5) * _ANDROID_MS * 1e-3
    levels = np.rint(255 * np.interp(middles, envelope.times, envelope.amplitude)).astype(int).tolist()
    timings, amplitudes = [0], levels[:1]
    for level in levels:
        if level != amplitudes[-1]:
            timings.append(0)
            amplitudes.append(level)
        timings[-1] += _ANDROID_MS
    words = envelope.mapping("The motor sets the frequency.")
    origin = _origin(envelope) | {"description": words}
    write_json(path, {"timings": timings, "amplitudes": amplitudes, "repeat": -1, "haploop": origin})


def write_hjif(envelope: Envelope, path: Path) -> None:
    """MPEG haptics (ISO/IEC 23090-31:2025), interchange format: one vectorial wave, its keyframes in Hz.

    Fields and values are those that its reference software (IOJson.cpp) asks for: it drops a channel with a
    field too few, and refuses a file of no known edition or without a date.
    """
    ticks = np.rint(_TICKS * envelope.times).astype(int).tolist()
    frequencies = np.rint(envelope.frequency_hz).astype(int).tolist()
    keyframes = [
        {"relative_position": tick, "amplitude_modulation": _digits(a), "frequency_modulation": f}
        for tick, a, f in zip(ticks, envelope.amplitude, frequencies, strict=True)
    ]
    effect = {
        "effect_type": "Basis",
        "position": 0,
        "phase": 0.0,
        "base_signal": "Sine",
        "keyframes": keyframes,
    }
    band = {
        "band_type": "VectorialWave",
        "lower_frequency_limit": 0,
        "upper_frequency_limit": 1000,
        "effects": [effect],
    }
    channel = {
        "id": 0,
        "description": "fingertip",
        "gain": 1.0,
        "mixing_coefficient": 1.0,
        "body_part_mask": 0,
        "bands": [band],
    }
    perception = {
        "id": 0,
        "avatar_id": 0,
        "description": envelope.title,
        "perception_modality": "Vibrotactile",
        "unit_exponent": -3,
        "perception_unit_exponent": 0,
        "reference_devices": [],
        "effect_library": [],
        "channels": [channel],
    }
    write_json(
        path,
        {
            "version": "2025",
            "profile": "Main",
            "level": 1,
            "date": str(envelope.about.get("started") or date.today()),
            "description": envelope.mapping("Keyframes are in Hz."),
            "timescale": _TICKS,
            "avatars": [],
            "perceptions": [perception],
            "syncs": [{"timestamp": 0, "timescale": _TICKS}],
        },
    )


def _sharpness(envelope: Envelope) -> FloatArray:
    """(points,) 0 to 1."""
    low, high = _SHARPNESS_HZ
    return np.asarray(np.clip((envelope.frequency_hz - low) / (high - low), 0.0, 1.0))


def _thinned(times: FloatArray, values: FloatArray, most: int) -> list[tuple[float, float]]:
    """At most `most` of the breakpoints: the ends, then whichever is worst approximated without it."""
    kept = [0, len(times) - 1]
    while len(kept) < min(most, len(times)):
        error = np.abs(np.interp(times, times[kept], values[kept]) - values)
        kept = sorted([*kept, int(np.argmax(error))]) if error.max() > 0 else kept
        if error.max() == 0:
            break
    return [(float(times[k]), float(values[k])) for k in kept]


def _digits(value: float) -> float:
    return round(float(value), 5)


def _origin(envelope: Envelope) -> dict[str, str | float | int | bool]:
    return {"source": envelope.about["source"], "simulated": envelope.about["simulated"]}
