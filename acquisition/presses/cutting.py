"""Cutting presses out of a recording's signals, so that their contacts change at the same samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from ...instruments.arrays import FloatArray
from ..recording import Recording
from .segmentation import ButtonPress

__all__ = ["Activated", "common_opening", "cut_out"]

Activated = tuple[ButtonPress, float]
"""A press, and the instant of its activation (samples)."""

_BETWEEN = 0.6
"""Part of the time between activation and opening in which time is stretched."""
_LATER = 0.8 * _BETWEEN * 8 / 15
"""How much later a press's opening can be moved, over the common opening: the steepest slope of the stretch
is 15/8 of the mean one, and time must not run backwards."""
_SHORT = 0.5
"""Shortest time for which a contact is closed, over the median of the presses."""


def common_opening(openings: Sequence[float]) -> tuple[float, float]:
    """Samples after the activation at which all contacts will open, and below which a press is too short.

    That is the median of the presses' own `openings`, or as much earlier as is needed to stretch the shortest
    to it; 0 where no contact opens.
    """
    if not openings:
        return 0.0, 0.0
    median = float(np.median(openings))
    least = _SHORT * median
    shortest = min(opening for opening in openings if opening >= least)
    return min(median, shortest / (1 - _LATER)), least


def cut_out(
    recording: Recording,
    signals: FloatArray,
    presses: Sequence[Activated],
    before: int,
    after: int,
    opening: float,
) -> FloatArray:
    """Cut the presses (presses, 3, samples) out of acceleration and force (2, samples): these, and the
    activation, aligned at the activation.

    Presses are stretched so that each contact opens `opening` samples after the activation.
    """
    rate_hz = recording.rate_hz
    force = signals[1]
    rows = tuple(zip(signals, (recording.delay("acceleration"), recording.delay("force")), strict=True))
    lags = np.arange(-before, after, dtype=np.float64)
    curves = []
    for press, at in presses:
        late = 0.0 if press.opened is None else press.opened - at - opening
        instants = at + lags + _stretch(lags, late, opening)
        curve = [_sampled(row, instants - delay * rate_hz) for row, delay in rows]
        curve[1] = curve[1] - np.mean(force[press.start : max(press.start + 1, press.onset)])
        closed = np.where(lags < 0, 0.0, 1.0)
        if press.opened is not None:
            closed[instants >= press.opened] = 0.0
        curves.append(np.array([*curve, closed]))
    return np.array(curves)


def _stretch(lags: FloatArray, late: float, opening: float) -> FloatArray:
    """Shift to add to lags (samples), so that an event `late` samples after `opening` moves to `opening`.

    The holding time of a finger varies by more than a warp can follow. Time is stretched between the two
    clicks only, so neither changes its frequency.
    """
    if opening <= 0:
        return np.zeros(len(lags))
    x = np.clip((lags / opening - 0.25) / _BETWEEN, 0.0, 1.0)
    return max(late, -_LATER * opening) * x**3 * (10 - 15 * x + 6 * x**2)


def _sampled(row: FloatArray, instants: FloatArray) -> FloatArray:
    """Interpolate a signal at instants (samples); constant beyond both ends."""
    low = max(0, int(instants[0]) - 8)
    high = min(len(row), int(instants[-1]) + 9)
    part = scipy.interpolate.CubicSpline(np.arange(low, high), row[low:high])
    return np.asarray(part(np.clip(instants, low, high - 1)))
