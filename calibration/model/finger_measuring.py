"""Calibrating for a finger on a rig: who is asked for what, and where the laser looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np

from ...base.errors import ConfigurationError
from ...base.progress import Progress, prefixed, silent
from ...instruments.operator import RestFinger
from ..response import quick_response
from ..resting_finger import TableForce, refuse_force, resting
from .finger import under_finger
from .finger_finding import Look, PlateModes, find_finger

if TYPE_CHECKING:
    from ...instruments import Rig, RigFile
    from .calibration import Calibration


def calibrate_finger(
    rig: Rig,
    bare: Calibration,
    participant: str,
    *,
    force: float = 1.0,
    beside: str | Sequence[str] = (),
    plate: PlateModes | None = None,
    progress: Progress = silent,
) -> Calibration:
    """Measure what a participant's resting fingertip does to a calibration: two seconds a point.

    A multisine is played. The operator is asked to rest the fingertip at the calibration's point, and to lift
    it afterwards. The laser sees the point from the other side of the pane, or looks at points `beside`,
    whose bare responses are measured first. `plate` are the modes of a map (`VibrationMap.plate_modes`); with
    it and without `beside` the laser looks at the grid points next to the finger. The carrier stays the bare
    table's. Where the force sensor carries the table, the force is the one that it reads.

    Raises ConfigurationError for a calibration that is a finger's already, for another rig's, for points that
    are not beside the finger's, and for a force that no finger rests with; InstrumentError when nobody rests
    a finger; DataError when what rests is no fingertip, or nothing rests; and what `measure_response` raises.

    For example:

        >>> calibration = haploop.Calibration.load("calibration.h5")
        >>> under = haploop.calibration.calibrate_finger(rig, calibration, "P01")
        >>> len(under.model.resonances) > 0
        True
    """
    response = bare.response
    if bare.finger is not None:
        raise ConfigurationError("Give a calibration of the bare table: this one is a finger's already.")
    if (response.rig, response.simulated) != (rig.name, rig.simulated):
        raise ConfigurationError(f"The calibration is of another rig, {response.rig!r}: calibrate this one.")
    from ...acquisition import refuse_name  # noqa: PLC0415 - a calibration that is shown needs no recording

    refuse_name(participant)
    refuse_force(force)
    points = tuple(dict.fromkeys([beside] if isinstance(beside, str) else beside))
    if plate is not None and not points:
        points = neighbours(rig.file, response.point, plate.points)
    _refuse_points(rig.file, response.point, points)
    law, patch = bare.hysteresis, response.patch
    at_rest = {
        point: quick_response(rig, patch, point, prefixed(progress, f"bare, point {point}"), hysteresis=law)
        for point in points
    }
    weighed = TableForce.at_rest(rig)
    asked, looks, felt = RestFinger(participant, response.point, force), [], []
    with resting(rig, asked):
        for point in points or (response.point,):
            felt += [weighed.found(asked)] if weighed else []
            told = prefixed(progress, f"under the finger, point {point}")
            under = quick_response(rig, patch, point, told, hysteresis=law)
            looks.append(Look(at_rest.get(point, response), under))
        felt += [weighed.found(asked)] if weighed else []
    if felt:
        asked = replace(asked, force=float(np.mean(felt)))
        refuse_force(asked.force)
    made = under_finger(bare, find_finger(bare, looks, asked, plate))
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return replace(made, response=replace(made.response, created=now))


def neighbours(file: RigFile, point: str, measured: Sequence[str]) -> tuple[str, ...]:
    """Grid points next to a point, of those that were measured: left, right, above and below."""
    table = file.table
    assert table is not None  # a response was measured on it
    row, column = divmod(_number(file, point), table.columns)
    beside = [(row, column - 1), (row, column + 1), (row - 1, column), (row + 1, column)]
    there = [str(r * table.columns + c) for r, c in beside if 0 <= r < table.rows and 0 <= c < table.columns]
    found = tuple(one for one in there if one in measured)
    if not found:
        raise ConfigurationError(f"The map has no point next to the {point} point: name points beside it.")
    return found


def _refuse_points(file: RigFile, own: str, points: Sequence[str]) -> None:
    table = file.table
    assert table is not None
    count = table.rows * table.columns
    for point in points:
        if point not in map(str, range(count)):
            raise ConfigurationError(
                f"There is no point {point!r} beside the finger: the grid has points from 0 to {count - 1}."
            )
        if int(point) == _number(file, own):
            raise ConfigurationError(
                f"Point {point} is the one under the finger: name others, or leave --beside out where the "
                "laser sees it from the other side of the pane."
            )


def _number(file: RigFile, point: str) -> int:
    assert file.table is not None
    return file.table.button_point if point == "button" else int(point)
