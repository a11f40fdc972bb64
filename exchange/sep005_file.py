"""SEP-005: signals as SDyPy's packages exchange them, one dictionary a channel, here as JSON.

The standard (https://github.com/sdypy/sdypy/blob/main/docs/seps/sep-0005.rst) is about dictionaries in
memory: `json.load(open("OUT.json"))` gives them.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from ..base.errors import DataError
from .views import Channel, Signals, even_rate, write_json

_QUANTITIES = {"N": "f", "m/s^2": "a", "m/s": "v", "m": "d"}


def write_signals(signals: Signals, path: Path) -> None:
    """One dictionary a channel; `haploop`, an entry of our own, keeps the origin."""
    started = str(signals.about.get("started", ""))
    write_json(
        path,
        [
            {
                "name": c.name,
                "data": [float(f"{value:.9g}") for value in c.values.tolist()],
                "fs": signals.rate_hz,
                "unit_str": c.unit,
                "group": signals.title,
                **({"quantity": _QUANTITIES[c.unit]} if c.unit in _QUANTITIES else {}),
                **({"start_timestamp": started} if started else {}),
                "haploop": dict(signals.about) | {"delay_s": c.delay},
            }
            for c in signals.channels
        ],
    )


def read_signals(path: Path, rate_hz: float | None) -> Signals:
    """Read channels of one rate and length. Raises DataError."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        found = [found] if isinstance(found, dict) else found
        channels = tuple(
            Channel(str(c["name"]), str(c["unit_str"]), np.asarray(c["data"], dtype=np.float64).ravel())
            for c in found
        )
        rates = {_rate(path, c) for c in found}
        about = found[0].get("haploop", {}) if found else {}
        if not isinstance(about, dict):
            raise TypeError("haploop: no object")
    except (ArithmeticError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise DataError(f"{path} does not follow SEP-005 ({type(error).__name__}: {error}).") from None
    if len(rates) != 1 or len({len(c.values) for c in channels}) != 1:
        raise DataError(f"{path} holds channels of several rates or lengths: export one group at a time.")
    return Signals(path.stem, rates.pop(), channels, channels[0].name, about)


def _rate(path: Path, channel: dict[str, object]) -> float:
    if channel.get("fs"):
        return float(str(channel["fs"]))
    return even_rate(path, np.asarray(channel["time"], dtype=np.float64).ravel())
