"""MATLAB files (level 5), which GNU Octave and scipy read too."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from ..base.arrays import FloatArray
from ..base.files import new_file
from .views import Responses, Signals


def write_signals(signals: Signals, path: Path) -> None:
    """`time`, `rate_hz`, each channel by its name, and the structures `units`, `delays` and `about`."""
    values: dict[str, Any] = {"time": signals.time, "rate_hz": signals.rate_hz, "title": signals.title}
    names = _variables([c.name for c in signals.channels])
    for name, channel in zip(names, signals.channels, strict=True):
        values[name] = channel.values
    values["units"] = {name: c.unit for name, c in zip(names, signals.channels, strict=True)} | {"time": "s"}
    values["delays"] = {name: c.delay for name, c in zip(names, signals.channels, strict=True)}
    _write(path, values | {"about": dict(signals.about)})


def write_responses(found: Responses, path: Path, more: Mapping[str, Any] | None = None) -> None:
    """`frequency`, `velocity` (responses, lines), `patches` and `points`, a row of text each; `more` beside.

    Where they were measured `coherence` too; of a map `rows` and `columns` of its points, from 0.
    """
    responses = found.responses
    values: dict[str, Any] = {
        "title": found.title,
        "frequency": responses[0].frequencies,
        "velocity": np.stack([r.velocity for r in responses]),
        "patches": np.array([r.patch for r in responses], dtype=object),
        "points": np.array([r.point for r in responses], dtype=object),
        "units": {"frequency": "Hz", "velocity": "(m/s)/V"},
        "about": dict(found.about),
    }
    if all(len(r.coherence) for r in responses):
        values["coherence"] = np.stack([r.coherence for r in responses])
        values["units"]["coherence"] = "1"
    if found.grid is not None:
        values |= {"rows": found.grid[:, 0], "columns": found.grid[:, 1]}
    _write(path, values | dict(more or {}))


def _variables(names: list[str]) -> list[str]:
    """Names of variables, each different from the others and from those of our own."""
    taken = {"time", "rate_hz", "title", "units", "delays", "about"}
    found = []
    for name in names:
        own = plain = _variable(name)
        number = 2
        while own in taken:
            own, number = f"{plain[:27]}_{number}", number + 1
        taken.add(own)
        found.append(own)
    return found


def _variable(name: str) -> str:
    """A name of a MATLAB variable: letters, digits and underscores."""
    plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in name)
    return (plain if plain[:1].isalpha() else f"c_{plain}")[:31]


def _write(path: Path, values: dict[str, Any]) -> None:
    columns = {k: v[:, None] if _is_vector(v) else v for k, v in values.items()}
    with new_file(path) as part:
        scipy.io.savemat(str(part), columns, appendmat=False, long_field_names=True)


def _is_vector(value: object) -> bool:
    array: FloatArray | object = value
    return isinstance(array, np.ndarray) and array.ndim == 1
