"""Read a measured frequency response of a sensor: a CSV file with columns of Hz, gain and degrees."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from ...base.errors import ConfigurationError
from ...base.toml_lines import read_text

_MOST = 10_000
"""Largest number of rows."""


def read_frf(path: Path) -> dict[str, Any]:
    """Keys of a measured response. Raises ConfigurationError, which names the file and the line."""
    text = read_text(path, f"There is no file {path}, which [sensors] names as frf: correct its name.")
    rows: list[tuple[float, float, float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.replace(";", ",").replace("\t", ",").split(",")
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            hz, gain, degrees = (float(word) for word in words)
        except ValueError:
            if not rows and number < 10:  # headings
                continue
            hz = math.nan
        if not (math.isfinite(hz) and hz > 0 and gain > 0 and math.isfinite(gain + degrees)):
            raise ConfigurationError(
                f"{path}, line {number}: a measured response has rows of Hz, gain (1 where the sensor's "
                "scale holds) and degrees, all numbers with a decimal point, the first two above 0."
            )
        if (rows and hz <= rows[-1][0]) or len(rows) >= _MOST:
            raise ConfigurationError(
                f"{path}, line {number}: the frequencies must rise, and be at most {_MOST}: sort the rows."
            )
        rows.append((hz, gain, degrees))
    if len(rows) < 2:
        raise ConfigurationError(
            f"{path} holds no measured response: give it rows of Hz, gain and degrees, separated by commas."
        )
    hz_, gain_, degrees_ = zip(*rows, strict=True)
    return {"hz": hz_, "gain": gain_, "degrees": degrees_, "file": path.name}
