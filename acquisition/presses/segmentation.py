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

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...base.arrays import BoolArray, FloatArray
from ...base.parts import Parted
from ..recording import Recording
from .filtering import Above, smoothed
from .force_at import BEHIND, Instant, Snaps, force_at
from .pressing import Levels, levels_of, pressing, shaken
from .segmentation_settings import Segmentation, fast_enough, segmentation_for

_STEP = 1 << 14
"""Samples that are searched at once for the beginning and the end of a press."""


class Span(NamedTuple):
    """A detected press: first sample, end (exclusive), and the value at rest (N, with force) at that time."""

    first: int
    end: int
    rest: float


class Detector:
    """Finds presses in a force, travel or vibration that arrives in blocks (`pressing.py`).

    `spans` holds the presses that have ended; `pressing` is True during one.
    """

    def __init__(
        self, rate_hz: float, parameters: Segmentation | None = None, levels: Levels | None = None
    ) -> None:
        p = parameters or Segmentation()
        self._levels = levels or levels_of("force", p)
        self._bin = max(1, round(p.bin * rate_hz))
        self._quiet = max(1, round(self._levels.quiet * rate_hz))
        self._gain = self._bin / (p.follow * rate_hz)
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
        """Process the next (samples,) of the force (N), or of what else tells presses."""
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
            if above > self._levels.pressed:
                self._first, self._last, self._peak = begin, self._at, above
            else:
                # The force of a hand that rests lightly on the cap is tracked more slowly.
                slower = 1.0 if above < self._levels.released else 3.0
                self._rest += above * self._gain / slower
            return
        self._peak = max(self._peak, above)
        if above > self._levels.released:
            self._last = self._at
        elif self._at - self._last >= self._quiet:
            self._end()

    def _end(self) -> None:
        assert self._first is not None
        if self._peak >= self._levels.least_peak:
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
    """Index of the largest force; of the largest travel or vibration where no force is measured."""
    release: int
    """Index at which the force is back at its rest."""
    stop: int
    """End of the window (exclusive)."""
    activation: float | None
    """Instant of the contact's first change, in either direction; without a contact, of the snap in the force
    or the click in the motion (`force_at.py`); None without any."""
    opened: float | None
    """Instant at which the contact changed back during the same press (momentary buttons); None otherwise."""
    force_at_activation: float | None
    """N above the rest just before this press; None where it was not measured, or too slowly (`rates.py`)."""
    force_uncertainty: float | None
    """N: half-width about `force_at_activation` that holds the true force of 98 of 100 simulated presses or
    more, the sensor's own gain aside (`force_at.py`)."""
    first_stage: float | None
    """Instant (samples) of a click before the one at the activation, as in a latch with two stages; None
    without one."""
    saturated: bool
    """True when a sensor reached the end of its range between onset and release."""
    activated_by: str = "activation"
    """What told the activation: "activation" (the contact), "force", "displacement", "velocity" or
    "acceleration"."""


def find_presses(recording: Recording, parameters: Segmentation | None = None) -> tuple[ButtonPress, ...]:
    """Find every press of a recording, in order; `parameters` default to those of its button.

    Raises DataError when the file is damaged, or no sensor shows presses.
    """
    p = parameters or segmentation_for(recording.button)
    _, signal, levels = pressing(recording, p, recording.quiet)
    detector = Detector(recording.rate_hz, p, levels)
    for part in signal.parts():
        detector.feed(signal[part])
    detector.finish()
    spans = detector.spans
    if not spans:
        return ()
    finder = _Finder(recording, p, signal, levels)
    found = []
    for number, span in enumerate(spans):
        low = spans[number - 1].end if number else 0
        high = spans[number + 1].first if number + 1 < len(spans) else len(signal)
        found.append(finder.press(span, low, high, number == 0, number + 1 == len(spans)))
    return tuple(found)


class _Finder:
    """Finds the events of presses in a recording's signals."""

    def __init__(self, recording: Recording, p: Segmentation, signal: Parted, levels: Levels) -> None:
        self._recording, self._p, self._signal, self._levels = recording, p, signal, levels
        rate_hz = recording.rate_hz
        self._smooth = smoothed(signal, max(1, round(p.bin * rate_hz)))
        vertical = recording.in_parts("vertical") if recording.motion else None
        self._shaken = None if vertical is None else shaken(vertical, rate_hz, p.stage_high_pass)

    def press(self, span: Span, low: int, high: int, first: bool, last: bool) -> ButtonPress:
        """The press in a span; its neighbours end at `low` and begin at `high`."""
        p, recording, rate_hz = self._p, self._recording, self._recording.rate_hz
        margin = round(p.margin * rate_hz)
        quiet = _before(self._signal, span, low, margin)
        rest = float(quiet.mean()) if len(quiet) else span.rest
        above = Above(self._smooth, rest)
        onset, release = _edges(above, span, low, high, self._levels)
        start = max(onset - margin, 0 if first else (low + onset) // 2)
        stop = min(release + margin, len(self._signal) if last else (release + high) // 2)
        force = above if recording.has("force") else None
        by: str | None = "activation"
        if recording.has("activation"):
            activation, opened = _switching(recording, start, onset, stop, p)
        else:
            found = Snaps(recording, p, self._shaken).activation(force, above, start, onset, release)
            activation, by, opened = (*found, None) if found else (None, None, None)
        at_activation, uncertainty = self._force_at(activation, by, quiet, rest)
        stage = None
        if activation is not None:
            pressed = None if force is None or at_activation is None else (force, at_activation)
            stage = self._first_stage(pressed, start, onset, activation)
        return ButtonPress(
            start=start,
            onset=onset,
            peak=onset + int(np.argmax(self._smooth[onset : release + 1])),
            release=release,
            stop=stop,
            activation=activation,
            opened=opened,
            force_at_activation=at_activation,
            force_uncertainty=uncertainty,
            first_stage=stage,
            saturated=bool(np.any(recording.in_parts("saturated")[onset : release + 1])),
            activated_by=by or "",
        )

    def _force_at(
        self, activation: float | None, by: str | None, quiet: FloatArray, rest: float
    ) -> tuple[float | None, float | None]:
        """The force (N) at the activation and its uncertainty; None where it was not measured, or too slowly.

        `quiet` is the force before the press, and `rest` its value at rest.
        """
        recording, p, rate_hz = self._recording, self._p, self._recording.rate_hz
        measured_hz = recording.measured_hz
        if activation is None or not recording.has("force"):
            return None, None
        if not fast_enough("force at activation", measured_hz):
            return None, None
        at = activation - recording.delay("force") * rate_hz
        behind = 0.0 if by == "activation" else BEHIND * rate_hz
        noise = float(quiet.std()) if len(quiet) else 0.0
        instant = Instant(at, max(1.0, rate_hz / measured_hz), rate_hz, behind)
        found = force_at(self._signal, instant, p.fit * rate_hz, noise)
        return (None, None) if found is None else (found[0] - rest, found[1])

    def _first_stage(
        self, force: tuple[Above, float] | None, start: int, onset: int, activation: float
    ) -> float | None:
        """Find the instant of the first click in the acceleration; None without one.

        The search starts where the force (above its rest, and at the activation) shows that the cap is
        pressed, and at the onset without a force.
        """
        recording, shaken, p = self._recording, self._shaken, self._p
        if shaken is None:
            return None
        rate_hz = recording.rate_hz
        late = recording.delay(recording.motion or "acceleration") * rate_hz
        with_it = round(activation - late - p.stage_gap * rate_hz)
        begin = max(onset, with_it - round((p.stage_lead - p.stage_gap) * rate_hz))
        if force is not None:
            pressed = np.flatnonzero(force[0][onset:with_it] > p.stage_force * force[1])
            if not len(pressed):
                return None
            begin = max(begin, onset + int(pressed[0]))
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


def _before(force: Parted, span: Span, low: int, margin: int) -> FloatArray:
    """The force (N) before a press, without its rise and the fall of the preceding press; empty if short."""
    quiet = force[max(low + margin // 5, span.first - margin) : max(0, span.first - margin // 5)]
    return quiet if len(quiet) >= margin // 5 else quiet[:0]


def _edges(above: Above, span: Span, low: int, high: int, p: Levels) -> tuple[int, int]:
    """Indices at which the smoothed signal leaves its rest and returns to it, between its neighbours."""
    onset, release = low, high - 1
    for end in range(span.first, low, -_STEP):
        begin = max(low, end - _STEP)
        if len(before := np.flatnonzero(above[begin:end] < p.onset)):
            onset = begin + int(before[-1]) + 1
            break
    for begin in range(span.end, high, _STEP):
        if len(after := np.flatnonzero(above[begin : min(high, begin + _STEP)] < p.released)):
            release = begin + int(after[0])
            break
    return onset, release


def _switching(
    recording: Recording, start: int, onset: int, stop: int, p: Segmentation
) -> tuple[float | None, float | None]:
    """Instants (samples) at which the contact leaves its initial state and returns to it."""
    state = recording.in_parts("activation")[start:stop] > 0.5
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
