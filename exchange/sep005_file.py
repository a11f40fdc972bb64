"""SEP-005: signals as SDyPy's packages exchange them, one dictionary a channel, read from JSON.

The standard: https://github.com/sdypy/sdypy/blob/main/docs/seps/sep-0005.rst.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from ..base.errors import DataError
from .views import Channel, Signals, even_rate


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
        starts = {str(c.get("start_timestamp") or "") for c in found}
    except (ArithmeticError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise DataError(f"{path} does not follow SEP-005 ({type(error).__name__}: {error}).") from None
    if len(rates) != 1 or len({len(c.values) for c in channels}) != 1:
        raise DataError(f"{path} holds channels of several rates or lengths: export one group at a time.")
    if len(starts) > 1:
        raise DataError(
            f"{path} holds channels that begin at different times ({', '.join(sorted(starts))}): export "
            "those that belong together."
        )
    return Signals(path.stem, rates.pop(), channels, channels[0].name, {"start_timestamp": starts.pop()})


def _rate(path: Path, channel: dict[str, object]) -> float:
    if channel.get("fs"):
        return float(str(channel["fs"]))
    return even_rate(path, np.asarray(channel["time"], dtype=np.float64).ravel())
