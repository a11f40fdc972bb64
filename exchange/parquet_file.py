"""Parquet, with the units in each column's metadata (optional: `pip install "haploop[parquet]"`)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..base.extras import optional
from ..base.files import new_file
from .views import About, PressTable, Responses, Signals


def write_signals(signals: Signals, path: Path) -> None:
    """A column a channel, the time first."""
    columns = {"time": signals.time} | {c.name: c.values for c in signals.channels}
    _write(path, columns, {"time": "s"} | {c.name: c.unit for c in signals.channels}, signals.about)


def write_responses(found: Responses, path: Path) -> None:
    """A row a response and line: patch, point, frequency, and the velocity per volt in two parts."""
    lines, responses = len(found.responses[0].frequencies), found.responses
    columns: dict[str, Any] = {
        "patch": np.repeat([r.patch for r in responses], lines),
        "point": np.repeat([r.point for r in responses], lines),
        "frequency": np.concatenate([r.frequencies for r in responses]),
        "velocity_real": np.concatenate([r.velocity.real for r in responses]),
        "velocity_imaginary": np.concatenate([r.velocity.imag for r in responses]),
    }
    units = {"frequency": "Hz", "velocity_real": "(m/s)/V", "velocity_imaginary": "(m/s)/V"}
    if all(len(r.coherence) for r in responses):
        columns["coherence"] = np.concatenate([r.coherence for r in responses])
    if found.grid is not None:
        columns |= {name: np.repeat(found.grid[:, k], lines) for k, name in enumerate(("row", "column"))}
    _write(path, columns, {name: units.get(name, "") for name in columns}, found.about)


def write_presses(table: PressTable, path: Path) -> None:
    """A row a press; an unknown value is null."""
    columns = {name: [row[name] for row in table.rows] for name in table.units}
    _write(path, columns, table.units, table.about)


def _write(path: Path, columns: Mapping[str, Any], units: Mapping[str, str], about: About) -> None:
    arrow = optional("pyarrow", "parquet", "The format parquet")
    parquet = optional("pyarrow.parquet", "parquet", "The format parquet")
    arrays = [arrow.array(values) for values in columns.values()]
    fields = [
        arrow.field(name, array.type, metadata={"unit": units[name]})
        for name, array in zip(columns, arrays, strict=True)
    ]
    schema = arrow.schema(fields, metadata={"haploop": json.dumps(dict(about))})
    with new_file(path) as part:
        parquet.write_table(arrow.Table.from_arrays(arrays, schema=schema), part)
