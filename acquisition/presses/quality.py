"""Check the quality of a press as soon as it has ended, against the protocol of its recording.

The seconds around the press are segmented like a small recording, so the live verdict equals the verdict
computed from the finished file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Self

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import DataError
from ...base.parts import Parted
from ...base.wording import capital
from ...instruments import LinearSensor, Sensors
from ...instruments.sensors import Restorer
from ..recording import BLOCK, EVENT, FLAGS, VERDICT, Contents, Header, PressVerdict, Recording, to_codes
from .filtering import running_mean
from .pressing import Levels, press_quantity, pressing
from .segmentation import ButtonPress, Span, find_presses
from .segmentation_settings import Segmentation
from .sensor_faults import axis_fault, crept, doubt, hum_of, left_range, signal_fault

# The protocol of a recording: timing of the prompts, and acceptance limits of a press.


@dataclass(frozen=True)
class Protocol:
    """Timing of the prompts and acceptance limits. Times in s of the stream, not of the wall clock."""

    block: float = 0.05
    """Length of a block."""
    rest: float = 0.5
    """Duration of hands off at the beginning, in which the sensors' rest is measured."""
    rest_spread: float = 0.15
    """N: largest peak-to-peak force within `rest` that counts as hands off (noise: 0.03 N)."""
    patience: float = 15.0
    """Longest wait for hands off, for a press to begin, and for it to end."""
    wait: float = 0.0
    """Total extra wait of a session, beyond `patience`, for hands off and for presses to begin."""
    pause: float = 0.0
    """Total time for which the operator may pause a session; it counts as no waiting."""
    quiet: float = 0.3
    """Time without force before a press counts as over and the next is asked for."""
    trail: float = 0.5
    """Recorded after the last press."""
    attempts: int = 5
    """Attempts at one press within a session before the session ends."""
    force: tuple[float, float] | None = None
    """N, lowest and highest at activation. Default: from `Segmentation.pressed` to 80 % of the sensor's
    rating, the limit of every press."""
    before: float = 0.2
    """Time without force before the finger arrives."""
    light: float = 1.0
    """N. A force below this, and below 30 % of the press's largest, is a finger that rests on the button."""
    linger: float = 0.2
    """Longest time of resting before and after a press; below 0.05 s in a clean press."""
    segmentation: Segmentation = field(default_factory=Segmentation)

    def to_json(self) -> str:
        """JSON text stored in a recording."""
        return json.dumps(asdict(self), sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> Self | None:
        """Read the text of `to_json`; None for a recording without verdicts (`{}`).

        Raises DataError for a protocol that this version cannot read.
        """
        try:
            values = json.loads(text)
            if not values:
                return None
            values["segmentation"] = Segmentation(**values["segmentation"])
            values["force"] = values["force"] and tuple(values["force"])
            return cls(**values)
        except (ValueError, TypeError, KeyError):
            raise DataError(
                "The recording's protocol was written by a newer haploop: update haploop to read it."
            ) from None


_RATING = 0.8
"""Largest fraction of the force sensor's rating in a press (a choice)."""
_LIGHT = 0.3
"""Fraction of a press's largest force below which the finger rests on the button, arrives or leaves."""
_MOVING = 0.1
"""Time (s) in which a finger lands or leaves."""
_REST, _TOLD = 1.0, 0.4
"""Longest time (s) before a press in which the sensors' rest is looked at; shortest that tells hum."""
_BETWEEN = 0.35
"""Fraction of both peaks below which the force must fall between two presses (it stays above 60 % at a
snap)."""


def accepted_presses(
    recording: Recording, found: Sequence[ButtonPress] | None = None
) -> tuple[ButtonPress, ...]:
    """Select the accepted presses, or all presses of a recording without verdicts.

    `found` defaults to the presses found with the recording's own segmentation. Raises DataError.

    For example:

        >>> recording = haploop.Recording.open("data/P01-latch.h5")
        >>> len(haploop.accepted_presses(recording))
        2
    """
    protocol = Protocol.from_json(recording.header.protocol)
    if found is None:
        found = find_presses(recording, protocol.segmentation if protocol else None)
    if protocol is None:
        return tuple(found)
    accepted = recording.accepted
    # A press is within a verdict when more of them have begun at its peak than have ended.
    begun, ended = np.sort([one.first for one in accepted]), np.sort([one.end for one in accepted])
    peaks = [press.peak for press in found]
    within = np.searchsorted(begun, peaks, "right") > np.searchsorted(ended, peaks, "right")
    return tuple(press for press, inside in zip(found, within, strict=True) if inside)


def is_of(verdict: PressVerdict, press: ButtonPress) -> bool:
    """Return True when a verdict is on this press."""
    return verdict.first <= press.peak < verdict.end


def activation_forces(recording: Recording) -> list[float]:
    """Return the force at activation (N) of each accepted press that has one.

    It is that of the verdicts, for which no sample is read; a recording without verdicts has its presses
    found. Raises DataError.
    """
    if Protocol.from_json(recording.header.protocol) is None:
        found = [press.force_at_activation for press in find_presses(recording)]
    else:
        found = [press.force for press in recording.outline()[0] if press.accepted]
    return [force for force in found if force is not None and np.isfinite(force)]


class QualityCheck:
    """Checks a press against the protocol: accepted, or rejected with a reason."""

    def __init__(self, path: Path, header: Header, sensors: Sensors, protocol: Protocol) -> None:
        self._path, self._header, self._sensors, self._p = path, header, sensors, protocol
        self._doubtful = False
        self._still: FloatArray = np.zeros(0)
        self._quantity = press_quantity(sensors)
        if self._quantity is None:
            raise DataError(f"{path} has no sensor that shows presses.")
        force = sensors.force
        ranged = force is not None and force.range is not None
        self._most = _RATING * force.range[force.row] if force and force.range and ranged else np.inf
        self.rests: dict[str, FloatArray] = {}
        """(channels,) V that sensors showed at the session's rest, by what they measure."""

    def __call__(self, volts: FloatArray, first: int, span: Span, number: int, attempt: int) -> PressVerdict:
        """Return the verdict on the press in `span` (sample indices of the recording).

        The first accepted press with a doubtful signal has a reason that says so. `volts` is
        (channels, samples) around it and starts at sample `first`: at least
        `Protocol.before` before the span, and no sample of the preceding press.
        """
        p, rate_hz = self._p, self._header.rate_hz
        begin, end = span.first - first, span.end - first
        quiet = slice(max(0, begin - round(0.5 * rate_hz)), max(1, begin - round(0.05 * rate_hz)))
        excerpt = _Excerpt(self._path, self._header, self._sensors, volts, quiet, self.rests)
        found = find_presses(excerpt, p.segmentation)
        activation, at = next(
            (
                (press.activation, press.force_at_activation)
                for press in found
                if press.activation is not None
            ),
            (None, None),
        )
        if found:
            begin, end = found[0].onset, found[-1].release + 1
        quantity, whole, levels = pressing(excerpt, p.segmentation, quiet)
        signal = whole[:]

        wrong: dict[str, str] = {}
        if activation is None:
            wrong["no-activation"] = _unswitched(self._sensors)
        if beyond := excerpt.saturated_in(slice(begin, end)):
            wrong["saturated"] = left_range(beyond)
        if quantity == "force":
            wrong |= self._strength(signal[begin:end], at)
        if len(found) > 1:
            wrong["double"] = "it was pressed twice"
        if quantity in ("force", "displacement"):
            wrong |= self._manner(quantity, signal, levels, begin, end)
        if quantity == "force" and wrong and (hum := hum_of(signal[quiet], rate_hz)):
            restless = [flag for flag in ("double", "not-quiet-before", "not-quiet-after") if flag in wrong]
            wrong |= dict.fromkeys(restless, hum)
        rest, press = slice(max(0, begin - round(_REST * rate_hz)), quiet.stop), slice(begin, end)
        if excerpt.motion:
            still = excerpt.vertical[rest]
            # A rest that is too short to tell hum leaves the one before.
            self._still = still if len(still) >= min(_TOLD * rate_hz, len(self._still)) else self._still
        if fault := axis_fault(excerpt, rest) or signal_fault(excerpt, rest, press, self._still):
            wrong = {"sensor": fault} | wrong
        sentence = "; ".join(dict.fromkeys(wrong.values())) or self._doubt(excerpt, rest, press)
        return PressVerdict(
            number=number,
            attempt=attempt,
            first=first + begin,
            end=first + end,
            activation=np.nan if activation is None else first + activation,
            force=np.nan if at is None else at,
            accepted=not wrong,
            flags=tuple(flag for flag in FLAGS if flag in wrong),
            reason=f"{capital(sentence)}." if sentence else "",
        )

    def _strength(self, force: FloatArray, at: float | None) -> dict[str, str]:
        """What is wrong with the force (samples,) N of a press, and with that at its activation."""
        p = self._p
        width = max(1, round(p.segmentation.bin * self._header.rate_hz))
        peak = float(running_mean(force, width).max())
        low, high = p.force or (p.segmentation.pressed, self._most)
        if peak > self._most:
            return {
                "force-range": f"the force reached {peak:.0f} N, and the sensor allows {self._most:.0f} N"
            }
        if at is not None and not low <= at <= high:
            return {"force-range": f"it switched at {at:.2f} N, outside {low:g} to {high:g} N"}
        return {}

    def _manner(
        self, quantity: str, signal: FloatArray, levels: Levels, begin: int, end: int
    ) -> dict[str, str]:
        """What is wrong with how the finger came, pressed and left, from a force or a travel (samples,)."""
        p, rate_hz = self._p, self._header.rate_hz
        wrong = {}
        width = max(1, round(p.segmentation.bin * rate_hz))
        force = running_mean(signal, width)
        peak = float(force[begin:end].max())
        if _times(force[begin:end:width]) > 1:
            wrong["double"] = "it was pressed twice"
        # The finger arrives, presses (force above `light`), and leaves.
        light = min(p.light, _LIGHT * peak) if quantity == "force" else _LIGHT * peak
        pressing = np.flatnonzero(force[begin:end] >= light)
        coming, leaving = force[begin : begin + pressing[0]], force[begin + pressing[-1] : end]
        waiting = force[max(0, begin - round(p.before * rate_hz)) : begin]
        # A sensor that creeps shows a force that fades after a press, and before the next.
        moving = round(_MOVING * rate_hz)
        if len(coming) > p.linger * rate_hz and not crept(coming[:-moving], peak, rate_hz):
            wrong["not-quiet-before"] = f"the finger rested on it for {len(coming) / rate_hz:.1f} s before"
        elif _touches(coming, levels) or (
            (waiting > levels.released).any() and not crept(waiting, peak, rate_hz)
        ):
            wrong["not-quiet-before"] = "it was touched just before"
        if len(leaving) > p.linger * rate_hz and not crept(leaving[moving:], peak, rate_hz):
            wrong["not-quiet-after"] = f"the finger rested on it for {len(leaving) / rate_hz:.1f} s after"
        elif _touches(leaving[::-1], levels):
            wrong["not-quiet-after"] = "it was touched just after"
        return wrong

    def _doubt(self, excerpt: Recording, rest: slice, press: slice) -> str:
        """What is doubtful in a press that counts, once in a session."""
        found = "" if self._doubtful else doubt(excerpt, rest, press, self._still)
        self._doubtful |= bool(found)
        return found


class _Excerpt(Recording):
    """A few seconds of a recording in progress; hands are off in the slice `quiet`."""

    def __init__(
        self,
        path: Path,
        header: Header,
        sensors: Sensors,
        volts: FloatArray,
        quiet: slice,
        rests: Mapping[str, FloatArray],
    ) -> None:
        super().__init__(path, header, "recording")
        codes, _ = to_codes(volts, header.full_scale)
        contents = Contents(Parted.of(codes), np.empty(0, BLOCK), np.empty(0, EVENT), np.empty(0, VERDICT))
        self.__dict__ |= {"_checked": (contents, ""), "sensors": sensors}
        self._still, self._rests = quiet, rests

    @property
    def quiet(self) -> slice:
        """See `Recording.quiet`."""
        return self._still

    def _rest_of(self, sensor: LinearSensor) -> FloatArray:
        # The median ignores a touch within it.
        return np.asarray(np.median(self.volts_in(sensor.channels, self._still), axis=1))

    def _tared(self, quantity: str) -> Parted:
        sensor = self._linear(quantity)
        if not sensor.ac_coupled or quantity not in self._rests:
            return super()._tared(quantity)
        # What fades of the press before is no rest: that of the session is, and what it leaves is constant.
        faded = sensor.along(self.volts_in(sensor.channels, slice(None)), self._rests[quantity])
        signal = Restorer(sensor, self.rate_hz)(faded)
        return Parted.of(np.asarray(signal - np.median(signal[self._still])))


def _unswitched(sensors: Sensors) -> str:
    if sensors.activation is not None:
        return "the button did not switch"
    if sensors.force is not None:
        return "its force shows no snap, and there is no contact to tell when it switched"
    return "its motion shows no click, and there is no contact to tell when it switched"


def _touches(force: FloatArray, p: Levels) -> bool:
    """True when a finger touches and leaves again within a force signal (N)."""
    touched = np.flatnonzero(force > p.pressed)
    return bool(len(touched) and (force[touched[0] :] < p.released).any())


def _times(force: FloatArray) -> int:
    """Count presses in a force signal (N), even when the finger barely leaves the button between them."""
    least = _LIGHT * float(force.max(initial=0.0))
    count, top, bottom = 0, 0.0, 0.0
    for value in force.tolist():
        bottom = min(bottom, value)
        if count and value > bottom / _BETWEEN and top > bottom / _BETWEEN and value > least:
            count, top, bottom = count + 1, value, value
        elif value > top and (count or value > least):
            count, top, bottom = max(count, 1), value, value
    return count


_BEFORE = 1.0
"""s before a press that are looked at, unless another press is nearer."""


def judged(recording: Recording, protocol: Protocol) -> tuple[PressVerdict, ...]:
    """The verdict on each press, numbered in order, each at its first attempt. Raises DataError."""
    check = QualityCheck(recording.path, recording.header, recording.sensors, protocol)
    for quantity, sensor in recording.sensors.linear.items():
        check.rests[quantity] = recording.volts_in(sensor.channels, recording.rest).mean(axis=1)
    found = find_presses(recording, protocol.segmentation)
    rate_hz = recording.rate_hz
    verdicts = []
    for number, press in enumerate(found, 1):
        low = found[number - 2].release + 1 if number > 1 else 0
        high = found[number].onset if number < len(found) else len(recording)
        first = max(low, press.onset - round(_BEFORE * rate_hz))
        end = min(high, press.release + 1 + round(protocol.quiet * rate_hz))
        span = Span(press.onset, press.release + 1, 0.0)
        volts = recording.volts_in(recording.channels, slice(first, end))
        verdicts.append(check(volts, first, span, number, 1))
    return tuple(verdicts)
