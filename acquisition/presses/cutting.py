"""Cutting presses out of a recording's signals, so that their contacts change at the same samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy

from ...base.arrays import FloatArray
from ..recording import Recording
from .segmentation import ButtonPress

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


@dataclass(frozen=True, eq=False)
class Cuttable:
    """Signals of a recording to cut presses out of: (signals, samples), with each one's delay (s).

    The first is the acceleration; the others are measured from their rest before each press.
    """

    signals: FloatArray
    delays: tuple[float, ...]
    rate_hz: float

    @classmethod
    def of(cls, recording: Recording, acceleration: FloatArray) -> Self:
        """The acceleration (samples,) of a recording, and its force and travel as far as there are any."""
        slow = slow_signals(recording)
        source = recording.motion
        assert source is not None
        delays = (recording.delay(source), *(recording.delay(name) for name in slow))
        return cls(np.stack([acceleration, *slow.values()]), delays, recording.rate_hz)


def slow_signals(recording: Recording) -> dict[str, FloatArray]:
    """Force (N) and travel (m) of a recording, as far as they were measured, by what measured them."""
    found = {"force": recording.force} if recording.has("force") else {}
    return found | ({"displacement": recording.travel} if recording.has("displacement") else {})


def cut_out(
    cuttable: Cuttable, presses: Sequence[Activated], before: int, after: int, opening: float
) -> FloatArray:
    """Cut the presses (presses, signals + 1, samples) out of signals: these, and the activation.

    Presses are aligned at the activation, and stretched so that each contact opens `opening` samples after
    it.
    """
    rate_hz = cuttable.rate_hz
    rows = tuple(zip(cuttable.signals, cuttable.delays, strict=True))
    lags = np.arange(-before, after, dtype=np.float64)
    curves = []
    for press, at in presses:
        late = 0.0 if press.opened is None else press.opened - at - opening
        instants = at + lags + _stretch(lags, late, opening)
        curve = [_sampled(row, instants - delay * rate_hz) for row, delay in rows]
        still = slice(press.start, max(press.start + 1, press.onset))
        for number, signal in enumerate(cuttable.signals[1:], start=1):
            curve[number] = curve[number] - np.mean(signal[still])
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
