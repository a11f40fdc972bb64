"""NetCDF with CF attributes: classic format, which libnetcdf, xarray, MATLAB and Octave read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from ..base.files import new_file
from .views import About, Responses, Signals

_UDUNITS = {"m/s^2": "m s-2", "m/s": "m s-1", "(m/s)/V": "m s-1 V-1"}
"""Units whose names differ in UDUNITS, which CF asks for."""


def write_signals(signals: Signals, path: Path) -> None:
    """A variable a channel over `elapsed_time` (s from the first sample), with units and delay.

    CF asks of a coordinate called `time` for a date that it counts from, which an average of presses has not.
    """
    with _file(path, signals.title, signals.about) as file:
        file.createDimension("elapsed_time", len(signals.time))
        time = file.createVariable("elapsed_time", "f8", ("elapsed_time",))
        time[:] = signals.time
        time.units, time.long_name = "s", "time since the first sample"
        file.sample_rate_hz = _number(signals.rate_hz)
        for channel in signals.channels:
            variable = file.createVariable(channel.name, "f8", ("elapsed_time",))
            variable[:] = channel.values
            variable.units = _UDUNITS.get(channel.unit, channel.unit).encode()
            variable.long_name = channel.name.replace("_", " ").encode()
            variable.delay_s = _number(channel.delay)


def write_responses(found: Responses, path: Path) -> None:
    """`velocity_real` and `velocity_imaginary` over `response`, `frequency`; `patch`, `point` as text.

    Of a map also `row` and `column` of each point, from 0.
    """
    responses = found.responses
    with _file(path, found.title, found.about) as file:
        file.createDimension("frequency", len(responses[0].frequencies))
        file.createDimension("response", len(responses))
        frequency = file.createVariable("frequency", "f8", ("frequency",))
        frequency[:] = responses[0].frequencies
        frequency.units, frequency.long_name = "Hz", "frequency"
        velocity = np.stack([r.velocity for r in responses])
        for name, part in (("real", velocity.real), ("imaginary", velocity.imag)):
            variable = file.createVariable(f"velocity_{name}", "f8", ("response", "frequency"))
            variable[:] = part
            variable.units = _UDUNITS["(m/s)/V"]
            variable.long_name = f"{name} part of velocity per volt at the patch"
        if all(len(r.coherence) for r in responses):
            coherence = file.createVariable("coherence", "f8", ("response", "frequency"))
            coherence[:] = np.stack([r.coherence for r in responses])
            coherence.units, coherence.long_name = "1", "coherence"
        cells = () if found.grid is None else (("row", found.grid[:, 0]), ("column", found.grid[:, 1]))
        for name, numbers in cells:
            cell = file.createVariable(name, "i4", ("response",))
            cell[:] = numbers
            cell.units, cell.long_name = "1", f"{name} of the point on the table, from 0"
        for name, texts in (("patch", [r.patch for r in responses]), ("point", [r.point for r in responses])):
            raw = np.array([text.encode() for text in texts])
            file.createDimension(f"{name}_length", raw.dtype.itemsize)
            text = file.createVariable(name, "c", ("response", f"{name}_length"))
            text[:] = raw.view("S1").reshape(len(raw), -1)


def _number(value: Any) -> Any:
    """A float that keeps its digits: scipy stores Python's own in single precision."""
    return np.float64(value) if isinstance(value, float) else value


@contextmanager
def _file(path: Path, title: str, about: About) -> Iterator[Any]:
    # 64-bit offsets: the oldest format ends at 2 GB.
    with new_file(path) as part, scipy.io.netcdf_file(part, "w", version=2) as opened:
        file: Any = opened  # its attributes are the file's
        file.Conventions = "CF-1.11"
        file.title = title.encode()
        file.history = f"Exported from {about['source']} by {about['software']}".encode()
        for name, value in about.items():
            kept = int(value) if isinstance(value, bool) else _number(value)
            setattr(file, name, kept.encode() or b" " if isinstance(kept, str) else kept)
        yield file
