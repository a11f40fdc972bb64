"""Jobs of digital buttons: make one, play one again, adopt one."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from ...acquisition import load_press
from ...base.errors import ConfigurationError
from ...base.files import check_destination, reserved
from ...calibration import (
    DigitalButton,
    Drift,
    Loudness,
    VibrationMap,
    adopt,
    build_button,
    load_calibrations,
    load_elsewhere,
    play_button,
    sizes,
    trade_for,
    with_map,
)
from ...instruments import Rig
from ..data_folder import clean, whole
from .job import Tools, Work, files, number, words

ACTOR = "the console"
_PLAYS = 8
"""Plays of a check."""


def make(tools: Tools, wanted: Mapping[str, Any]) -> Work:
    """A button of recordings, as loud as is asked for, and what other points are to do meanwhile."""
    presses = files(tools.data, wanted.get("recordings"))
    if not presses:
        raise ConfigurationError("Choose at least one recording.")
    calibrated = files(tools.data, wanted.get("calibrations"))
    if not calibrated:
        raise ConfigurationError("Choose at least one calibration.")
    also, times, quiet_at = *_also(tools, wanted), words(wanted.get("quiet_at"))
    chosen = str(wanted.get("map") or "")
    map_folder = tools.data.path(chosen) if chosen else None
    if chosen and not (also or quiet_at):
        raise ConfigurationError(
            "The map is for other points: name those that are to be silent or to play a second button, or "
            "choose no map."
        )
    loudness = _loudness(wanted)
    iterations = whole(wanted.get("iterations", 5), "The number of corrections", 0, 20)
    path = tools.data.path(f"buttons/{clean(wanted.get('name') or '', 'The name', 1)}.h5")
    check_destination(path)

    def work(rig: Rig) -> dict[str, Any]:
        tools.board.progress("Compute the drive", 0, 1, "")
        elsewhere = load_elsewhere(also, quiet_at, times)
        press, calibrations = load_press(presses), load_calibrations(calibrated)
        if map_folder is not None:
            calibrations = with_map(calibrations, VibrationMap.load(map_folder), elsewhere)
        with reserved(path, size=sizes.of_button(iterations, len(elsewhere))):
            made = build_button(
                rig,
                press,
                calibrations,
                trade=trade_for(press, calibrations, rig, loudness, elsewhere=elsewhere),
                elsewhere=elsewhere,
                iterations=iterations,
                progress=tools.board.progress,
            )
            made.save(path)
        return {"file": tools.data.name(path), "verdict": made.check.verdict}

    return work


def _loudness(wanted: Mapping[str, Any]) -> Loudness:
    """How loud it is to be: a page sends percent and dB, or nothing."""
    error = number(wanted.get("error"), "The error", "%")
    drift = number(wanted.get("drift"), "The drift", "%")
    return Loudness(
        None if error is None else error / 100,
        number(wanted.get("level"), "The level", "dB"),
        None if drift is None else Drift.usual(drift / 100),
    )


def _also(tools: Tools, wanted: Mapping[str, Any]) -> tuple[list[tuple[str, str]], list[tuple[str, float]]]:
    """The second button's point, with each of its recordings, and with its size."""
    points, recordings = words(wanted.get("also_at")), files(tools.data, wanted.get("also"))
    if recordings and len(points) != 1:
        raise ConfigurationError("Name the one point at which the second button is to play, for example 57.")
    if points and not recordings:
        raise ConfigurationError("Choose recordings of the second button, or leave its point empty.")
    size = number(wanted.get("size"), "The size of the second button", "times the first one's")
    if size is not None and not recordings:
        raise ConfigurationError("Choose recordings of the second button, or leave its size empty.")
    return [(points[0], str(path)) for path in recordings], [] if size is None else [(points[0], size)]


def check(tools: Tools, wanted: Mapping[str, Any]) -> Work:
    """Play a button again; the new check stands beside it."""
    path = tools.data.path(wanted.get("button", ""))
    button = DigitalButton.load(path)

    def work(rig: Rig) -> dict[str, Any]:
        now = datetime.now(UTC)
        saved = tools.data.path(f"checks/{path.stem}-{now:%Y%m%dT%H%M%S}.h5")
        with reserved(saved, size=sizes.of_check(_PLAYS)):
            result = play_button(rig, button, plays=_PLAYS, progress=tools.board.progress)
            result.save(saved)
        # The button's file is never changed: the new check stands beside it.
        return {"file": tools.data.name(path), "check": tools.data.name(saved), "verdict": result.verdict}

    return work


def adopt_button(tools: Tools, wanted: Mapping[str, Any]) -> Work:
    """Make a button's calibration the active one."""
    button = DigitalButton.load(tools.data.path(wanted.get("button", "")))
    reason = clean(wanted.get("reason", ""), "The reason", 3)

    def work(_: Rig) -> dict[str, Any]:
        history = tools.data.history
        return {"generation": adopt(history, [button], actor=ACTOR, reason=reason, rig=tools.file).name}

    return work
