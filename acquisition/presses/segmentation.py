"""Find presses in a force signal: their beginning and end, and the instant at which the button switched.

Model: the force is a rest that drifts slowly, and presses that rise above it. A press lasts from the first
average over `bin` above a threshold (`pressed`) until the force has stayed below a lower one (`released`)
for `quiet`; its peak tells it from a touch (`least_peak`). When the button switched is asked of its contact
and not of the force: the first change that lasts for most of `settle`, midway between two samples. A click
before that is found in the vertical acceleration, high-passed above a hand's motion.

Assumptions: between presses the finger leaves, for longer than `quiet`; the rest follows within `follow` s;
a contact bounces for less than `settle`. What breaks them: two presses within `quiet` are one; a hand that
rests on the cap with more than `pressed` is a press; hum on the force (an average over 5 ms passes nine
tenths of 50 Hz) moves the onset once it exceeds `onset`; an offset of the force that begins suddenly.
Source of the figures: docs/hardware.md, "Force sensor" and "Buttons and people".

The same detector runs while recording, block by block, and over a whole file afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import scipy

from ...instruments.arrays import BoolArray, FloatArray
from ..recording import Recording

__all__ = [
    "SEGMENTATIONS",
    "ButtonPress",
    "Detector",
    "Segmentation",
    "Span",
    "find_presses",
    "segmentation_for",
]


@dataclass(frozen=True)
class Segmentation:
    """Parameters of the press detection. Forces (N) are relative to the rest, whose drift is tracked."""

    pressed: float = 0.30
    """A press begins when the force, averaged over `bin`, rises above this."""
    released: float = 0.15
    """A press ends when the force has stayed below this for `quiet`."""
    quiet: float = 0.10
    """s. A shorter absence of the finger does not end the press. While recording, the longer
    `haploop.acquisition.presses.protocol.Protocol.quiet` applies."""
    least_peak: float = 0.5
    """Smallest peak of a press; a lower peak is a touch."""
    onset: float = 0.06
    """The onset is the last sample at which the force was below this: ten sigma of the average over `bin`,
    with 0.03 N of noise."""
    bin: float = 0.005
    """s: averaging time of the force before it is compared with these thresholds."""
    follow: float = 1.0
    """s: time constant of the tracking of the rest between presses. A drift of 0.05 N/min
    (docs/hardware.md, "Force sensor") leaves an error of 0.001 N."""
    settle: float = 0.005
    """s: a contact has switched when it is in the new state for most of this time; the instant of switching
    lies at most this long before. Contacts bounce for 0.1 to 5 ms (docs/hardware.md, "Buttons and
    people")."""
    fit: float = 0.0015
    """s: length of the force fit on each side of the activation."""
    margin: float = 0.25
    """s: margin of a press's window before its onset and after its release; less when a neighbour is near."""
    stage_lead: float = 0.15
    """s: longest search before the activation for a first click, which comes 30 to 100 ms before in a latch
    (docs/hardware.md, "Buttons and people")."""
    stage_gap: float = 0.012
    """s: shortest time between a first click and the activation; later motion belongs to the main click."""
    stage_share: float = 0.15
    """Smallest peak acceleration of a first click, as a fraction of the main click's; only noise
    (`stage_noise`) moves the cap otherwise."""
    stage_noise: float = 8.0
    """Smallest peak acceleration of a first click, in multiples of the rms before the onset."""
    stage_force: float = 0.25
    """Smallest force at a first click, as a fraction of the force at activation: a finger that lands on the
    cap also knocks, but at almost no force."""
    stage_high_pass: float = 60.0
    """Hz: above the motion of a hand and below a click (100 to 500 Hz)."""


SEGMENTATIONS: Mapping[str, Segmentation] = MappingProxyType(
    {
        "latch": Segmentation(least_peak=1.0),
        "toggle": Segmentation(least_peak=0.4),
        "push": Segmentation(),
    }
)
"""The parameters of the paper's buttons. A latch takes 5 to 10 N, a toggle 1 to 4 N and a push button 2 to
5 N to switch (docs/hardware.md, "Buttons and people"): a peak below about a quarter of that is a touch."""


def segmentation_for(button: str) -> Segmentation:
    """Parameters of a button; the defaults for a button that is not in `SEGMENTATIONS`."""
    return SEGMENTATIONS.get(button, Segmentation())


class Span(NamedTuple):
    """A detected press: first sample, end (exclusive), and the rest force (N) at that time."""

    first: int
    end: int
    rest: float


class Detector:
    """Finds presses in a force signal that arrives in blocks.

    `spans` holds the presses that have ended; `pressing` is True during one.
    """

    def __init__(self, rate_hz: float, parameters: Segmentation | None = None) -> None:
        self._p = parameters or Segmentation()
        self._bin = max(1, round(self._p.bin * rate_hz))
        self._quiet = max(1, round(self._p.quiet * rate_hz))
        self._gain = self._bin / (self._p.follow * rate_hz)
        self._left: FloatArray = np.zeros(0)
        self._at = 0
        self._rest = 0.0
        self._first: int | None = None
        self._last = 0
        self._peak = 0.0
        self.spans: list[Span] = []

    @property
    def pressing(self) -> bool:
        """True while a press has begun and not ended."""
        return self._first is not None

    def feed(self, force: FloatArray) -> None:
        """Process the next (samples,) of force (N)."""
        force = np.concatenate([self._left, force])
        bins = len(force) // self._bin
        self._left = force[bins * self._bin :]
        for mean in force[: bins * self._bin].reshape(bins, self._bin).mean(axis=1).tolist():
            self._step(mean)

    def finish(self) -> None:
        """End the signal, and with it a press that has begun."""
        if self._first is not None:
            self._end()

    def _step(self, mean: float) -> None:
        begin, self._at = self._at, self._at + self._bin
        above = mean - self._rest
        if self._first is None:
            if above > self._p.pressed:
                self._first, self._last, self._peak = begin, self._at, above
            else:
                # The force of a hand that rests lightly on the cap is tracked more slowly.
                slower = 1.0 if above < self._p.released else 3.0
                self._rest += above * self._gain / slower
            return
        self._peak = max(self._peak, above)
        if above > self._p.released:
            self._last = self._at
        elif self._at - self._last >= self._quiet:
            self._end()

    def _end(self) -> None:
        assert self._first is not None
        if self._peak >= self._p.least_peak:
            self.spans.append(Span(self._first, self._last, self._rest))
        self._first = None


@dataclass(frozen=True)
class ButtonPress:
    """One press. Indices count samples from the recording's start.

    `activation` and `opened` are instants on the sample clock, in samples: midway between the last sample
    before a change of the contact and the first one after it, corrected for the channel's sampling delay.
    """

    start: int
    """First sample of the press's window, including the quiet before the press."""
    onset: int
    """Index at which the force leaves its rest."""
    peak: int
    """Index of the largest force."""
    release: int
    """Index at which the force is back at its rest."""
    stop: int
    """End of the window (exclusive)."""
    activation: float | None
    """Instant of the contact's first change, in either direction; None without a change."""
    opened: float | None
    """Instant at which the contact changed back during the same press (momentary buttons); None otherwise."""
    force_at_activation: float | None
    """N above the rest just before this press."""
    first_stage: float | None
    """Instant (samples) of a click before the one at the activation, as in a latch with two stages; None
    without one."""
    saturated: bool
    """True when a sensor reached the end of its range between onset and release."""


def find_presses(recording: Recording, parameters: Segmentation | None = None) -> tuple[ButtonPress, ...]:
    """Find every press of a recording, in order; `parameters` default to those of its button.

    Raises DataError when the file is damaged.
    """
    p = parameters or segmentation_for(recording.button)
    rate_hz = recording.rate_hz
    force = recording.force
    detector = Detector(rate_hz, p)
    detector.feed(force)
    detector.finish()
    width = max(1, round(p.bin * rate_hz))
    smooth = np.asarray(scipy.ndimage.uniform_filter1d(force, width)) if len(force) else force
    margin = round(p.margin * rate_hz)
    spans = detector.spans
    shaken = _shaken(recording, p) if spans else force
    presses = []
    for number, span in enumerate(spans):
        low = spans[number - 1].end if number else 0
        high = spans[number + 1].first if number + 1 < len(spans) else len(force)
        rest = _rest_before(force, span, low, margin)
        onset, release = _edges(smooth - rest, span, low, high, p)
        start = max(onset - margin, (low + onset) // 2 if number else 0)
        stop = min(release + margin, (release + high) // 2 if number + 1 < len(spans) else len(force))
        activation, opened = _switching(recording, start, onset, stop, p)
        at_activation = None
        if activation is not None:
            instant = activation - recording.delay("force") * rate_hz
            at_activation = _value_at(force, instant, p.fit * rate_hz) - rest
        presses.append(
            ButtonPress(
                start=start,
                onset=onset,
                peak=onset + int(np.argmax(smooth[onset : release + 1])),
                release=release,
                stop=stop,
                activation=activation,
                opened=opened,
                force_at_activation=at_activation,
                first_stage=None
                if activation is None or at_activation is None
                else _first_stage(
                    recording, shaken, smooth - rest, start, onset, activation, at_activation, p
                ),
                saturated=bool(np.any(recording.saturated[onset : release + 1])),
            )
        )
    return tuple(presses)


def _rest_before(force: FloatArray, span: Span, low: int, margin: int) -> float:
    """Mean force (N) before a press, excluding its rise and the fall of the preceding press."""
    quiet = force[max(low + margin // 5, span.first - margin) : max(0, span.first - margin // 5)]
    return float(quiet.mean()) if len(quiet) >= margin // 5 else span.rest


def _edges(above: FloatArray, span: Span, low: int, high: int, p: Segmentation) -> tuple[int, int]:
    """Indices at which the smoothed force leaves its rest and returns to it."""
    before = np.flatnonzero(above[low : span.first] < p.onset)
    after = np.flatnonzero(above[span.end : high] < p.released)
    onset = low + int(before[-1]) + 1 if len(before) else low
    release = span.end + int(after[0]) if len(after) else high - 1
    return onset, release


def _switching(
    recording: Recording, start: int, onset: int, stop: int, p: Segmentation
) -> tuple[float | None, float | None]:
    """Instants (samples) at which the contact leaves its initial state and returns to it."""
    state = recording.activation[start:stop] > 0.5
    if not len(state):
        return None, None
    before = state[: max(1, onset - start)]
    changed = state != (np.count_nonzero(before) * 2 > len(before))
    window = max(1, round(p.settle * recording.rate_hz))
    first = _first_lasting(changed, 0, window)
    if first is None:
        return None, None
    back = _first_lasting(~changed, first + window, window)
    # The contact changed between the sample before and this one: half a sample early, on average.
    shift = start - 0.5 + recording.delay("activation") * recording.rate_hz
    return first + shift, None if back is None else back + shift


def _shaken(recording: Recording, p: Segmentation) -> FloatArray:
    """Magnitude (samples,) of the vertical acceleration without the hand's motion.

    The high-pass filter is causal, so that no click appears before its instant: a Butterworth filter of
    second order by the bilinear transform (Oppenheim and Schafer, Discrete-Time Signal Processing, 3rd ed.,
    7.2.2), settled at the first sample. Its recursion is the solution of a banded triangular system, because
    scipy.signal would load scipy.stats, half a second in the middle of a session.
    """
    vertical = recording.acceleration[2]
    moved = vertical - vertical[:1]
    k = np.tan(np.pi * min(p.stage_high_pass / recording.rate_hz, 0.45))
    scale = 1 / (1 + np.sqrt(2) * k + k**2)
    bands = np.ones((3, len(moved)))
    bands[1], bands[2] = 2 * (k**2 - 1) * scale, (1 - np.sqrt(2) * k + k**2) * scale
    driven = scale * np.convolve(moved, [1.0, -2.0, 1.0])[: len(moved), None]
    return np.asarray(np.abs(scipy.linalg.lapack.dtbtrs(bands, driven, uplo="L")[0][:, 0]))


def _first_stage(
    recording: Recording,
    shaken: FloatArray,
    above: FloatArray,
    start: int,
    onset: int,
    activation: float,
    force: float,
    p: Segmentation,
) -> float | None:
    """Find the instant of the first click in the acceleration; None without one.

    The search starts where the force (`above` its rest) shows that the cap is pressed.
    """
    rate_hz = recording.rate_hz
    late = recording.delay("acceleration") * rate_hz
    with_it = round(activation - late - p.stage_gap * rate_hz)
    pressed = np.flatnonzero(above[onset:with_it] > p.stage_force * force)
    if not len(pressed):
        return None
    begin = max(onset + int(pressed[0]), with_it - round((p.stage_lead - p.stage_gap) * rate_hz))
    before, main = shaken[begin:with_it], shaken[with_it : with_it + round(0.04 * rate_hz)]
    if not len(before) or not len(main):
        return None
    quiet = shaken[start:onset]
    noise = float(np.sqrt(np.mean(quiet**2))) if len(quiet) else 0.0
    largest = int(np.argmax(before))
    if before[largest] <= max(p.stage_share * float(main.max()), p.stage_noise * noise):
        return None
    # The click begins where the signal near its largest swing first exceeds the noise.
    near = max(0, largest - round(0.008 * rate_hz))
    level = max(0.15 * float(before[largest]), 3 * noise)
    return begin + near + int(np.argmax(before[near : largest + 1] > level)) - 0.5 + late


def _first_lasting(state: BoolArray, begin: int, window: int) -> int | None:
    """First index from `begin` on of a lasting `state`, bounces included.

    A state lasts when it holds for most of the next `window` samples. Earlier samples in that state,
    within `window` before, are bounces of the same change.
    """
    total = np.concatenate([[0], np.cumsum(state)])
    starts = np.arange(begin, len(state))
    ends = np.minimum(starts + window, len(state))
    stays = np.flatnonzero(state[begin:] & (2 * (total[ends] - total[starts]) > ends - starts))
    if not len(stays):
        return None
    since = max(begin, begin + int(stays[0]) - window)
    return since + int(np.argmax(state[since:]))


def _value_at(signal: FloatArray, instant: float, reach: float) -> float:
    """Estimate a noisy signal's value at an instant (samples) by two straight lines that meet there, fitted
    over `reach` samples on each side.

    The force has a kink where the button snaps, and one straight line through it would be biased by
    a quarter of the kink times `reach`.
    """
    low = max(0, int(np.ceil(instant - reach)))
    high = min(len(signal), int(np.floor(instant + reach)) + 1)
    t = np.arange(low, high) - instant
    basis = np.stack([np.ones_like(t), np.minimum(t, 0.0), np.maximum(t, 0.0)], axis=1)
    return float(np.linalg.lstsq(basis, signal[low:high], rcond=None)[0][0])
