"""Figure of one press of each recording, like the paper's figure 6."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ...acquisition import ButtonPress, Recording, high_pass
from ...instruments import DataError
from .paper import Profile, profiles
from .plotting import Columns

__all__ = ["recording_figure"]


def recording_figure(
    recordings: Sequence[tuple[Recording, tuple[ButtonPress, ...]]], columns: Columns = 2
) -> Figure:
    """Draw, of each recording, that of the presses with the median force at activation. Raises DataError."""
    return profiles([_press_of(one, _median_press(one, found)) for one, found in recordings], columns)


def _median_press(recording: Recording, found: tuple[ButtonPress, ...]) -> ButtonPress:
    """The press with the median force at activation. Raises DataError when none has an activation."""
    whole = [p for p in found if p.activation is not None and p.force_at_activation is not None]
    if not whole:
        raise DataError(
            f"{recording.path} holds no accepted press with an activation, so there is nothing to plot."
        )
    return sorted(whole, key=lambda p: p.force_at_activation or 0.0)[len(whole) // 2]


def _press_of(recording: Recording, press: ButtonPress) -> Profile:
    """One press of a recording, to draw; its time begins at its activation, or at its onset without one."""
    zero = press.onset if press.activation is None else press.activation
    acceleration = high_pass(recording.acceleration[2], recording.rate_hz)
    part = slice(press.start, press.stop)
    sensor = recording.sensors.acceleration
    return Profile(
        button=recording.button,
        time=np.asarray((np.arange(press.start, press.stop) - zero) / recording.rate_hz),
        acceleration=acceleration[part],
        force=recording.force[part],
        # A maintained button opens at every other press: plot the change of state.
        activation=np.abs(recording.activation[part] - recording.activation[press.start]),
        rate_hz=recording.rate_hz,
        bandwidth_hz=sensor.bandwidth_hz if sensor else None,
    )
