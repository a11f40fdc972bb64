"""Limits of the drive at a patch, from the amplifier, the relay, the actuator and the rig file."""

from __future__ import annotations

import numpy as np

from ..limits import Limits
from ..safety import Figures
from .roles import Instruments

_VOLTS = (-100.0, -1.0, 1.0, 50.0, 400.0)
"""Volts at the patch at which the amplifier's gain is noted."""


def ratings(rig: Instruments, patches: int) -> dict[str, Limits]:
    """Collect the limits for `patches` patches in parallel, by owner."""
    relay = Limits(min=-rig.relay.rating, max=rig.relay.rating)
    return {
        "the amplifier": rig.amplifier.limits(patches),
        "the relay": relay,
        "the actuator": rig.actuator.limits(patches),
        "the rig file's [limits]": rig.file.limits.limits(),
    }


def figures(rig: Instruments) -> Figures:
    """All that the limits of a play rest on, now. Raises ConfigurationError for a rig that cannot play."""
    each = {count: ratings(rig, count) for count in range(len(rig.table.patches) + 1)}
    return Figures(each, tuple(map(float, rig.amplifier.to_input(np.array(_VOLTS)))), rig.file.digest)
