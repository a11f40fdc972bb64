"""A digital button as JSON: verdicts, waveforms and spectra of a check, at the point that is looked at."""

from __future__ import annotations

import glob
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...acquisition import Representative
from ...base.arrays import FloatArray
from ...base.errors import DataError
from ...calibration import Check, DigitalButton, Drive, check_feeling
from ...calibration.spectra import resample, third_octaves
from ...reports.contents import (
    check_glance,
    crosstalk_facts,
    one_style,
    other_facts,
    silence_facts,
    text_of,
)
from ...reports.figures import activation_time
from ..data_folder import DataFolder
from .shown_routes import glance_json

_SHOWN_HZ = 5000.0
"""Samples per second of the waveforms of a check that are sent."""


def button_shown(data: DataFolder, asked: Mapping[str, str]) -> Any:
    """A digital button with its own check, or another check of it: waveforms, spectra, levels.

    `point` is that of the button that is looked at, where several are played at once.
    """
    path = data.path(asked.get("file", ""))
    button = DigitalButton.load(path)
    whole = Check.load(data.path(asked["check"])) if asked.get("check") else button.check
    check, press = _seen(button, whole, asked.get("point", ""))
    feeling = check_feeling(check, press)
    drive = check.drive
    recorded = _recorded(press, check)
    low, high = check.octaves.hz[0], check.octaves.hz[-1]
    begin, end = _loud(check.target)
    step = max(1, round(check.rate_hz / _SHOWN_HZ))
    at = _times(begin, end, step, check.rate_hz)
    drives = {p: np.round(np.interp(at, _clock(drive), own), 3) for p, own in drive.by_patch.items()}
    loudest, volts = max(drive.by_patch.items(), key=lambda own: float(np.abs(own[1]).max()))
    return {
        "name": press.button,
        "simulated": check.simulated,
        "created": button.created,
        "point": drive.point,
        "points": [one.drive.point for one in (whole, *whole.others)],
        "each_point": _each_point(whole, (button.press, *button.others)),
        "glance": glance_json(check_glance(check, feeling, press)),
        "check": check.summary() | {"reasons": _styled(check.reasons), "notes": _styled(check.notes)},
        "error_said": check.whole.said,
        "outside_said": check.outside.brief,
        "felt": one_style(feeling.sentence),
        "loudness_db": feeling.loudness_db,
        "in_band": drive.in_band,
        "notes": _styled(feeling.notes),
        "step_s": step / check.rate_hz,
        "recorded": np.round(recorded[begin:end:step], 4),
        "target": np.round(check.target[begin:end:step], 4),
        "measured": np.round(check.measured[begin:end:step], 4),
        "drives": drives,
        "loudest": loudest,
        "octaves_hz": check.octaves.hz,
        "recorded_db": third_octaves(recorded, check.rate_hz, low * 0.99, high * 1.01)[1],
        "drive_db": third_octaves(volts, drive.rate_hz, low * 0.99, high * 1.01)[1],
        "target_db": check.octaves.target_db,
        "measured_db": check.octaves.measured_db,
        "floor_db": check.octaves.floor_db,
        "checks": data.found(f"checks/{glob.escape(path.stem)}-*.h5"),
    }


def _styled(sentences: Sequence[str]) -> list[str]:
    return [one_style(one) for one in sentences]


def _seen(button: DigitalButton, check: Check, point: str) -> tuple[Check, Representative]:
    """The check and the press of the button at a point; "" is the drive's own."""
    seen = zip((check, *check.others), (button.press, *button.others), strict=False)
    for one, press in seen:
        if point in ("", one.drive.point):
            return one, press
    raise DataError(f"The digital {button.press.button} plays no button at the {point[:20]!r} point.")


def _each_point(check: Check, presses: Sequence[Representative]) -> list[dict[str, Any]]:
    """A row for each button, silent point and crosstalk, where a drive is for more points than one."""
    if not check.drive.elsewhere:
        return []
    rows: list[dict[str, Any]] = []
    own = f"error {check.whole.said}"
    errors = [own, *(text_of(known.lines[1]) for known in other_facts(check, presses[1:]))]
    for one, press, error in zip((check, *check.others), presses, errors, strict=False):
        rows.append(
            {
                "label": f"{press.button} at the {one.drive.point} point",
                "verdict": one.verdict,
                "said": one_style(f"{error}. {check_feeling(one, press).sentence}"),
            }
        )
    for known in (*silence_facts(check), *crosstalk_facts(check)):
        rows.append({"label": known.label, "said": one_style(text_of(known.lines[0]))})
    return rows


def _recorded(press: Representative, check: Check) -> FloatArray:
    """The recorded press at the times of a check, scaled as its target; zeros before and after."""
    samples = round(len(press.acceleration) * check.rate_hz / press.rate_hz)
    finer = check.drive.scale * resample(press.acceleration, samples)
    first = round(
        (activation_time(press, check.drive) - press.activation_index / press.rate_hz) * check.rate_hz
    )
    found = np.zeros(len(check.target))
    begin, end = max(0, first), min(len(found), first + samples)
    if begin < end:
        found[begin:end] = finer[begin - first : end - first]
    return found


def _loud(target: FloatArray) -> tuple[int, int]:
    """The part of a target that holds its motion, with a margin."""
    loud = np.flatnonzero(np.abs(target) > 0.01 * np.abs(target).max())
    if not len(loud):
        return 0, len(target)
    margin = max(1, (loud[-1] - loud[0]) // 10)
    return max(0, int(loud[0] - margin)), min(len(target), int(loud[-1] + margin))


def _times(begin: int, end: int, step: int, rate_hz: float) -> FloatArray:
    return np.arange(begin, end, step) / rate_hz


def _clock(drive: Drive) -> FloatArray:
    return np.arange(len(drive.target)) / drive.rate_hz
