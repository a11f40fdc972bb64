"""Universal File Format 58: signals over time, and frequency responses with their coherence."""

from __future__ import annotations

from pathlib import Path

from ..calibration import write_uff
from ..calibration.response import read_uff_sets, write_uff_sets
from ..terminal.progress import SIMULATED
from .views import Responses, Signals

_TIME_RESPONSE, _FRF = 1, 4
_SECONDS = 17
_DATA_TYPES = {"m": 8, "m/s": 11, "m/s^2": 12, "N": 13, "V": 1}
_LINE = 80


def write_responses(found: Responses, path: Path) -> None:
    """As `haploop.calibration.write_uff`."""
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
    return any(one["type"] == 58 and one["func_type"] == _FRF for one in read_uff_sets(path))
