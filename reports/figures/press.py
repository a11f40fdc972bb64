"""Figure of one press of each recording, like the paper's figure 6."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ...acquisition import ButtonPress, Recording, high_pass
from ...acquisition.presses import bandwidth_of
from ...base.errors import DataError
from .plotting import Columns
from .profiles import Profile, force_over_travel, profiles


def recording_figure(
    recordings: Sequence[tuple[Recording, tuple[ButtonPress, ...]]], columns: Columns = 2
) -> Figure:
    """Draw, of each recording, its press with the median force at activation. Raises DataError."""
    return profiles([_press_of(one, _median_press(one, found)) for one, found in recordings], columns)


def travel_figure(recording: Recording, found: Sequence[ButtonPress], columns: Columns = 2) -> Figure:
    """Draw the force over the travel of presses of a recording that has both."""
    return force_over_travel([_press_of(recording, press) for press in found], columns)


def _median_press(recording: Recording, found: tuple[ButtonPress, ...]) -> ButtonPress:
    """The press with the median force at activation, or the middle one without forces.

    Raises DataError when none has an activation.
    """
    whole = [p for p in found if p.activation is not None]
    if not whole:
        raise DataError(
            f"{recording.path} holds no accepted press with an activation, so there is nothing to plot."
        )
    return sorted(whole, key=lambda p: p.force_at_activation or 0.0)[len(whole) // 2]


def _press_of(recording: Recording, press: ButtonPress) -> Profile:
    """One press of a recording, to draw; its time begins at its activation, or at its onset without one."""
    zero = press.onset if press.activation is None else press.activation
    part = slice(press.start, press.stop)
    time = np.asarray((np.arange(press.start, press.stop) - zero) / recording.rate_hz)
    moved, bandwidth_hz = np.zeros(len(time)), None
    if recording.motion:
        moved = high_pass(recording.vertical, recording.rate_hz)[part]
        bandwidth_hz = min(bandwidth_of(recording), recording.motion_hz or np.inf)
    activation = np.asarray(time >= 0, dtype=np.float64)
    if recording.has("activation"):
        # A maintained button opens at every other press: plot the change of state.
        activation = np.abs(recording.activation[part] - recording.activation[press.start])
    return Profile(
        button=recording.button,
        time=time,
        acceleration=moved,
        force=recording.force[part] if recording.has("force") else None,
        activation=activation,
        rate_hz=recording.rate_hz,
        bandwidth_hz=bandwidth_hz if bandwidth_hz and np.isfinite(bandwidth_hz) else None,
        travel=recording.travel[part] if recording.has("displacement") else None,
        motion=recording.motion or "",
        activated_by=press.activated_by,
        participant=recording.participant,
    )
