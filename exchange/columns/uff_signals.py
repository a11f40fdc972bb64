"""The columns of a UFF file: its time responses (data set 58, type 1)."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...base.errors import DataError
from ...calibration.response import ordinate_of, read_uff_sets, units_of
from ...terminal.progress import SIMULATED
from ..views import About
from .start_times import instant
from .table import Column, Table, together
from .units import SI, unit_of
from .units import units_of as names_of

_TIME_RESPONSE = 1
_TIMES = (0, 1, 17)
"""Data types of an abscissa that may be a time: unknown, general, time."""
_OWN = re.compile(r", sha256 ([0-9a-f]+)")
"""In the fourth line of haploop's own files."""
_AXES = {1: "x", 2: "y", 3: "z"}


def read_table(path: Path) -> Table:
    """Read a file's columns. Raises DataError."""
    sets = read_uff_sets(path)
    units = units_of(path, sets)
    found = [one for one in sets if one["type"] == 58 and one["func_type"] == _TIME_RESPONSE]
    if not found:
        raise DataError(f"{path} holds no time responses (data set 58, type 1).")
    if any(one.get("data") is None for one in found):
        raise DataError(f"{path} has a data set 58 without its values: export it again.")
    if any(np.iscomplexobj(one["data"]) for one in found):
        raise DataError(f"{path} holds no real values of time: export what was measured.")
    if len({len(one["data"]) for one in found}) > 1 and len({_step(path, one) for one in found}) > 1:
        raise DataError(
            f"{path} holds {len(found)} time responses (data set 58, type 1), of several rates or lengths: "
            "export one measurement."
        )
    names = Counter(_name(one) for one in found)
    columns = [_column(path, one, units, names[_name(one)] > 1) for one in found]
    columns, notes = together(path, columns)
    about: About = {
        "simulated": any(str(one["id5"]).startswith(SIMULATED[:9]) for one in found),
        "source": path.name,
    }
    if all((own := _OWN.search(str(one["id4"]))) is not None for one in found) and own is not None:
        about = {**about, "content_hash": own[1]}
    start = instant(str(found[0]["id3"]))
    return Table(
        path, "UFF 58", tuple(columns), about=about, notes=tuple(notes),
        starts=() if start is None else ((0, start),),
    )  # fmt: skip


def _column(
    path: Path, function: Mapping[str, Any], units: Mapping[str, Any] | None, several: bool
) -> Column:
    ordinate = ordinate_of(function, units)
    name, direction = _name(function), int(function["rsp_dir"])
    if several:
        name = f"{name} {function['rsp_node']}{_AXES.get(abs(direction), '')}"
    sign = -1.0 if direction < 0 else 1.0
    values = sign * np.asarray(function["data"], dtype=np.float64)
    unit, doubt = ordinate.label, ""
    if ordinate.doubt and ordinate.si:
        unit, doubt = "", ordinate.doubt
    elif ordinate.si and not names_of(unit):  # a unit of data set 164 that has no name
        unit, values = ordinate.si, ordinate.factor * values
    step = _step(path, function)
    x = _seconds(path, function) * np.asarray(function["x"], dtype=np.float64)
    return Column(
        name,
        unit,
        values,
        # The step has six digits.
        rate_hz=float(f"{1 / step:.5g}") if step else None,
        start_s=float(x[0]) if step else None,
        times=None if step else x,
        doubt=doubt,
        quantity=next((name for name, si in SI.items() if si == ordinate.si and name != "voltage"), ""),
    )


def _name(function: Mapping[str, Any]) -> str:
    said = str(function["id1"]).strip()
    return "" if said.upper() == "NONE" else said


def _step(path: Path, function: Mapping[str, Any]) -> float:
    """S between samples; 0 for abscissae that are listed. Raises DataError."""
    if int(function["abscissa_spacing"]) != 1:
        return 0.0
    step = _seconds(path, function) * float(function["abscissa_inc"])
    if not 0 < step < np.inf:
        raise DataError(f"{path} states a step of {step:g} s, which is no constant rate: export it again.")
    return step


def _seconds(path: Path, function: Mapping[str, Any]) -> float:
    """Seconds per unit of the abscissa. Raises DataError for another quantity than time."""
    kind, label = int(function["abscissa_spec_data_type"]), str(function["abscissa_axis_units_lab"]).strip()
    stated = None if label.upper() in ("", "NONE") else unit_of(label, "time")
    if kind in _TIMES and stated is not None:
        return stated.factor
    if kind == 17 and label.upper() in ("", "NONE"):
        return 1.0
    raise DataError(
        f"{path} has a time response over an abscissa of data type {kind} in {label or 'no unit'!r}, which "
        "is no time: export it over time in s."
    )
