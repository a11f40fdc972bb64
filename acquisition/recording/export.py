"""Convert a recording to an xarray Dataset or a pandas DataFrame, when these packages are installed."""

from __future__ import annotations

import importlib
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.errors import ConfigurationError
from .streams import AlongReading

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from .recording import Recording

_UNITS = {
    "force": "N",
    "acceleration": "m/s^2",
    "travel": "m",
    "velocity": "m/s",
    "activation": "1",
    "saturated": "1",
}
_SENSORS = {"travel": "displacement"}
"""Name of the sensor, where a signal has another."""


def dataset(recording: Recording) -> xr.Dataset:
    """See `Recording.to_xarray`."""
    xarray = _library("xarray")
    variables: dict[str, Any] = {
        name: (
            ("axis", "time") if name == "acceleration" else ("time",),
            getattr(recording, name),
            {"units": unit}
            | ({} if name == "saturated" else {"delay": recording.delay(_SENSORS.get(name, name))}),
        )
        for name, unit in _measured(recording).items()
    }
    for name, sensor in recording.sensors.extra.items():
        about = {"units": sensor.unit, "long_name": sensor.name or name, "delay": recording.delay(name)}
        variables[name] = (("time",), recording.extra[name], about)
    coordinates: dict[str, Any] = {
        "time": ("time", _time(recording), {"units": "s"}),
        "axis": _axes(recording),
    }
    for name, readings in _readings(recording).items():
        time = np.array([reading.sample for reading in readings]) / recording.rate_hz
        values = np.array([reading.value for reading in readings])
        coordinates[f"{name}_time"] = (f"{name}_time", time, {"units": "s"})
        variables[name] = ((f"{name}_time",), values, {"units": readings[0].unit})
    found: xr.Dataset = xarray.Dataset(variables, coordinates, _about(recording))
    return found


def data_frame(recording: Recording) -> pd.DataFrame:
    """See `Recording.to_pandas`."""
    pandas = _library("pandas")
    columns: dict[str, Any] = {}
    units = {"time": "s"}
    for name, unit in _measured(recording).items():
        if name == "acceleration":
            rows = zip(_axes(recording), recording.acceleration, strict=True)
            found = {f"acceleration_{axis}": row for axis, row in rows}
        else:
            found = {name: getattr(recording, name)}
        columns |= found
        units |= dict.fromkeys(found, unit)
    columns |= recording.extra
    units |= {name: sensor.unit for name, sensor in recording.sensors.extra.items()}
    for name, readings in _readings(recording).items():
        columns[name] = np.full(len(recording.saturated), np.nan)
        for reading in readings:
            # Requested after that many samples: the reading belongs to the last of them.
            columns[name][max(0, reading.sample - 1) : reading.sample] = reading.value
        units[name] = readings[0].unit
    table: pd.DataFrame = pandas.DataFrame(columns, index=pandas.Index(_time(recording), name="time"))
    table.attrs = _about(recording) | {"units": units}
    return table


def _measured(recording: Recording) -> dict[str, str]:
    """Units of the signals that a recording has."""
    return {
        name: unit
        for name, unit in _UNITS.items()
        if name == "saturated" or recording.has(_SENSORS.get(name, name))
    }


def _axes(recording: Recording) -> list[str]:
    sensor = recording.sensors.acceleration
    return [] if sensor is None else list(sensor.axes)


def _time(recording: Recording) -> Any:
    return np.arange(len(recording.saturated)) / recording.rate_hz


def _readings(recording: Recording) -> dict[str, list[AlongReading]]:
    """Group the readings by name: one unit per name, and no name of a channel."""
    found: dict[str, list[AlongReading]] = {}
    for reading in recording.readings:
        name = f"{reading.instrument}_{reading.name}"
        if name in recording.sensors.extra:
            name += "_read"
        if name in found and found[name][0].unit != reading.unit:
            name += f"_{reading.unit}"
        found.setdefault(name, []).append(reading)
    return found


def _about(recording: Recording) -> dict[str, Any]:
    """Source of the data, in types that every file format of xarray and pandas can store."""
    header = recording.header
    return {
        "source": recording.path.name,
        "content_hash": recording.content_hash,
        "button": header.button,
        "participant": header.participant,
        "study": header.study,
        "session": header.session,
        "rate_hz": header.rate_hz,
        "simulated": int(header.simulated),
        "files": json.dumps([file._asdict() for file in recording.files]),
    }


def _library(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise ConfigurationError(f"{name} is not installed: install it with `pip install {name}`.") from None
