"""A recording as the labelled arrays and tables of xarray and pandas, where those are installed."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import numpy as np

from haploop.instruments import ConfigurationError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from haploop.acquisition.recording.recording import Recording

__all__ = ["to_pandas", "to_xarray"]

_UNITS = {"force": "N", "acceleration": "m/s^2", "activation": "1", "saturated": "1"}


def to_xarray(recording: Recording) -> xr.Dataset:
    """`force`, `activation`, `saturated` over `time`, and `acceleration` over `axis` and `time`.

    Each variable says its `units` and its `delay` (s from the time of a sample to its own instant).
    Raises ConfigurationError when xarray is not installed.
    """
    xarray = _library("xarray")
    variables = {
        name: (
            ("axis", "time") if name == "acceleration" else ("time",),
            getattr(recording, name),
            {"units": unit} | ({} if name == "saturated" else {"delay": recording.delay(name)}),
        )
        for name, unit in _UNITS.items()
    }
    coordinates = {"time": ("time", _time(recording), {"units": "s"}), "axis": list("xyz")}
    found: xr.Dataset = xarray.Dataset(variables, coordinates, _about(recording))
    return found


def to_pandas(recording: Recording) -> pd.DataFrame:
    """A column each for `force`, `acceleration_x`, `_y` and `_z`, `activation` and `saturated`; `time` (s) is
    the index.

    `attrs` has the units. Raises ConfigurationError when pandas is not installed.
    """
    pandas = _library("pandas")
    columns: dict[str, Any] = {"force": recording.force}
    columns |= {f"acceleration_{axis}": row for axis, row in zip("xyz", recording.acceleration, strict=True)}
    columns |= {"activation": recording.activation, "saturated": recording.saturated}
    table: pd.DataFrame = pandas.DataFrame(columns, index=pandas.Index(_time(recording), name="time"))
    table.attrs = _about(recording) | {"units": _UNITS | {"time": "s"}}
    return table


def _time(recording: Recording) -> Any:
    return np.arange(len(recording.force)) / recording.rate_hz


def _about(recording: Recording) -> dict[str, Any]:
    """What the numbers came from, in types that every file format of xarray and pandas can keep."""
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
    }


def _library(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise ConfigurationError(f"{name} is not installed: install it with `pip install {name}`.") from None
