"""Scales that instruments report, compared with what the rig file says of the same channels.

An instrument with an analog output (a charge amplifier, a high-voltage amplifier with a monitor) may have an
attribute `scales`: the scale of each DAQ channel that it is wired to. A rig whose file says another is not
opened, because everything that it recorded would be scaled wrongly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..base.errors import ConfigurationError
from .sensors import Scale, Sensors

_TOLERANCE = 1e-3
"""Relative tolerance: rig files give four digits or more."""


def compare_scales(role: str, instrument: Any, sensors: Sensors, rig: str) -> None:
    """Compare the scales that an instrument reports, if any, with its rig file's sensors.

    Raises ConfigurationError for the first channel that differs, and for one that no sensor reads.
    """
    scales = getattr(instrument, "scales", {})
    if not isinstance(scales, Mapping) or not all(isinstance(scale, Scale) for scale in scales.values()):
        raise ConfigurationError(
            f"The 'scales' of the {role} of the rig {rig!r} map no channels to haploop.instruments.Scale: "
            "ask the author of its driver, or of its twin."
        )
    for channel, reported in scales.items():
        told = f"The {role} of the rig {rig!r} reports {reported} on the channel {channel!r}, and"
        found = sensors.scale_of(channel)
        if found is None:
            raise ConfigurationError(
                f"{told} [sensors] has none with that channel and one scale: add one, or correct [{role}]."
            )
        table, filed = found
        if reported.unit != filed.unit or not math.isclose(
            reported.per_volt, filed.per_volt, rel_tol=_TOLERANCE
        ):
            raise ConfigurationError(
                f"{told} [sensors.{table}] says {filed}: set the instrument, or correct the rig file."
            )
