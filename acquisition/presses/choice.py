"""Presses of recordings that an average may use, why each other one is left out, and their cutting out.

A press in which the button clicked once more than in the participant's others is one of them. A click is a
burst of the acceleration's envelope. Of presses aligned at their activation, the median envelope holds each
usual burst, whatever a minority does; a press may have it earlier or later by as much as a warp reaches, and
be louder or softer as a whole. A burst beyond the usual ones, in a press that misses none of them, is one
click more: a finger that bounced, or pressed twice. (One that misses one is only slower.) Such a press has no
place in an average: a warp can neither remove the second click nor share it.

Assumed: less than half of the presses have it, and their clicks come within the reach of each other. A second
click within the reach of a usual one, or of less than a third of the loudest, is not told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy

from ...base.arrays import BoolArray, FloatArray
from ..recording import Recording
from .quality import Protocol, accepted_presses, is_of
from .segmentation import ButtonPress
from .sensor_faults import axis_fault, left_range, signal_fault, upside_down

_LEAST = 4
"""Presses from which the usual ones are told."""
_BURST = 0.004
"""s: averaging time of the envelope."""
_MORE, _SHARE, _APART = 1.6, 0.3, 0.4
"""A burst is beyond the usual ones when it exceeds this multiple of them by this part of the loudest, and no
usual one of this part is near: clicks that overlap otherwise than usual are louder."""
_REACH = 0.02
"""s: by how much a click may come early or late."""


def double_clicks(accelerations: FloatArray, rate_hz: float) -> FloatArray:
    """Instant (sample) of the click that each press has too many, (presses,); NaN for a press without one.

    `accelerations` is (presses, samples), aligned at the activation, of one participant.
    """
    reach = round(_REACH * rate_hz)
    found = np.full(len(accelerations), np.nan)
    if len(accelerations) < _LEAST:
        return found
    width = max(1, round(_BURST * rate_hz))
    envelopes = np.sqrt(np.maximum(scipy.ndimage.uniform_filter1d(accelerations**2, width, axis=1), 0.0))
    usual = np.median(envelopes, axis=0)
    near = scipy.ndimage.maximum_filter1d(usual, 2 * reach + 1)
    least = _SHARE * usual.max()
    for number, envelope in enumerate(envelopes):
        # As loud as the others, by the loudest burst that it shares with them.
        loud = max(float(np.max(envelope * (usual > 0.5 * usual.max()))) / usual.max(), 0.5)
        more = np.where(near < _APART * usual.max(), envelope / loud - _MORE * near, 0.0)
        less = usual - _MORE * scipy.ndimage.maximum_filter1d(envelope / loud, 2 * reach + 1)
        if more.max() > least and less.max() < least:
            found[number] = float(np.argmax(more))
    return found


def usable(recording: Recording, left_out: list[str]) -> list[Activated]:
    """Presses with their activation instants (samples); the others are added to `left_out`.

    A press that was judged as it was recorded, and shown so, is not judged again; one of a recording without
    verdicts is judged here.
    """
    good = []
    accepted = accepted_presses(recording)
    left_out += [
        f"{recording.participant}, press {bad.number}, attempt {bad.attempt}: {bad.reason}"
        for bad in recording.verdicts
        if not bad.accepted
    ]
    unjudged = Protocol.from_json(recording.header.protocol) is None
    for number, press in enumerate(accepted, start=1):
        wrong = _fault(recording, press) if unjudged else ""
        if press.activation is None:
            wrong = _unswitched(recording)
        if wrong:
            left_out.append(f"{recording.participant}, press {number}: {wrong}")
        elif press.activation is not None:
            good.append((press, press.activation))
    left_out += [
        f"{recording.participant}, press {verdict.number}, attempt {verdict.attempt}: it is not found with "
        "the recording's segmentation"
        for verdict in recording.accepted
        if not any(is_of(verdict, press) for press in accepted)
    ]
    return good


def _unswitched(recording: Recording) -> str:
    return "the contact did not change" if recording.has("activation") else "it shows no snap"


def _fault(recording: Recording, press: ButtonPress) -> str:
    """Why the signals of a press are wrong, and cannot be corrected, as a clause; empty for right ones."""
    within = slice(press.onset, press.release + 1)
    if beyond := recording.saturated_in(within):
        return left_range(beyond)
    rest = recording.rest
    wrong = "" if upside_down(recording, rest) else axis_fault(recording, rest)
    return wrong or signal_fault(recording, rest, within, recording.vertical[rest])


def held(
    recording: Recording, presses: Sequence[Activated], least: float, left_out: list[str]
) -> list[Activated]:
    """The presses whose contact was closed for `least` samples; the others are added to `left_out`."""
    long = []
    for press, at in presses:
        if press.opened is None or press.opened - at >= least:
            long.append((press, at))
        else:
            left_out.append(
                f"{recording.participant}, press at {at / recording.rate_hz:.2f} s: it was held for less "
                "than half the time of the others"
            )
    return long


def single(
    accelerations: FloatArray, rate_hz: float, at: int, presses: Sequence[str]
) -> tuple[BoolArray, list[str]]:
    """(presses,): True for the presses of a participant without a second click; and sentences on the others.

    `accelerations` is (presses, samples) with the activation at sample `at`.
    """
    clicks = double_clicks(accelerations, rate_hz)
    told = [
        f"{press}: it clicked twice, once {abs(click - at) / rate_hz * 1e3:.0f} ms "
        f"{'after' if click > at else 'before'} the activation, where the others do not"
        for press, click in zip(presses, clicks, strict=True)
        if np.isfinite(click)
    ]
    return np.isnan(clicks), told


def few(sentences: Sequence[str]) -> str:
    """The first three of these, and how many more there are."""
    more = [f"and {len(sentences) - 3} more"] if len(sentences) > 3 else []
    return "; ".join([*sentences[:3], *more])


# Cutting presses out of a recording's signals, so that their contacts change at the same samples.

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
