"""Universal File Format 58: signals over time, and frequency responses with their coherence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..calibration import write_uff
from ..calibration.response import read_uff_sets, write_uff_sets
from ..instruments import DataError
from ..terminal.progress import SIMULATED
from .views import About, Channel, Responses, Signals

_TIME_RESPONSE, _FRF = 1, 4
_SECONDS = 17
_DATA_TYPES = {"m": 8, "m/s": 11, "m/s^2": 12, "N": 13, "V": 1}
_UNITS = {8: "m", 11: "m/s", 12: "m/s^2", 13: "N", 9: "N"}
_LINE = 80


def write_responses(found: Responses, path: Path) -> None:
    """As `haploop.write_uff`."""
    write_uff(path, found.responses)


def write_signals(signals: Signals, path: Path) -> None:
    """A time response a channel, after data sets 151 and 164, in ASCII with twelve digits."""
    about = signals.about
    write_uff_sets(
        path,
        [
            {
                "type": 58,
                "binary": 0,
                "func_type": _TIME_RESPONSE,
                "id1": channel.name[:_LINE],
                "id2": signals.title[:_LINE],
                "id3": (str(about.get("started", "")) or "NONE")[:_LINE],
                "id4": f"{about['source']}, sha256 {about['content_hash']}"[:_LINE],
                "id5": SIMULATED if about["simulated"] else "Measured.",
                "rsp_ent_name": "NONE",
                "rsp_node": number,
                "rsp_dir": 3,
                "ref_ent_name": "NONE",
                "ref_node": 0,
                "ref_dir": 0,
                "abscissa_spacing": 1,
                "abscissa_spec_data_type": _SECONDS,
                "abscissa_axis_units_lab": "s",
                "ordinate_spec_data_type": _DATA_TYPES.get(channel.unit, 0),
                "ordinate_axis_lab": channel.name[:20],
                "ordinate_axis_units_lab": channel.unit[:20] or "NONE",
                # pyuff does not write the set without this one.
                "orddenom_spec_data_type": 0,
                "data": channel.values,
                "x": signals.time,
            }
            for number, channel in enumerate(signals.channels, 1)
        ],
    )


def has_responses(path: Path) -> bool:
    """True when a file holds a frequency response. Raises DataError for a damaged file."""
    return any(function["func_type"] == _FRF for function in _functions(path))


def read_signals(path: Path, rate_hz: float | None) -> Signals:
    """Read the time responses of a file; `rate_hz` is not needed. Raises DataError."""
    found = [function for function in _functions(path) if function["func_type"] == _TIME_RESPONSE]
    lengths = {len(function["data"]) for function in found}
    steps = {float(f"{np.mean(np.diff(function['x'])):.4g}") for function in found if len(function["x"]) > 1}
    if len(lengths) != 1 or len(steps) != 1:
        raise DataError(
            f"{path} holds {len(found) or 'no'} time responses (data set 58, type 1)"
            + (", of several rates or lengths: export one measurement." if found else ".")
        )
    step = float(np.mean(np.diff(found[0]["x"])))
    if not 0 < step < np.inf or any(np.iscomplexobj(f["data"]) for f in found):
        raise DataError(f"{path} holds no real values at a constant rate: export what was measured.")
    channels = tuple(
        Channel(str(f["id1"]).strip(), _unit(f), np.asarray(f["data"], dtype=np.float64)) for f in found
    )
    simulated = any(str(f["id5"]).startswith(SIMULATED[:9]) for f in found)
    about: About = {"simulated": simulated, "source": path.name}
    # The step has six digits.
    return Signals(path.stem, float(f"{1 / step:.5g}"), channels, channels[0].name, about)


def _functions(path: Path) -> list[dict[str, Any]]:
    found = [one for one in read_uff_sets(path) if one["type"] == 58]
    if any("data" not in one or "x" not in one for one in found):
        raise DataError(f"{path} has a data set 58 without its values: export it again.")
    return found


def _unit(function: dict[str, Any]) -> str:
    said = str(function["ordinate_axis_units_lab"]).strip()
    return _UNITS.get(int(function["ordinate_spec_data_type"]), "" if said == "NONE" else said)
