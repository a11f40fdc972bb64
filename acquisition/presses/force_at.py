"""The force at the instant at which a contact changed, and how far it may be off.

Model: the force is two straight lines that meet at the instant, because it has a kink where the button snaps;
one line through it would be biased by a quarter of the kink times `reach`. They are fitted by least squares
over `reach` on each side, two samples at least, and their value where they meet is the force.

The uncertainty is a sum of three bounds. The instant: it lies within half a sample of the midpoint between
two samples, or earlier, when a contact bounced: a touch that is shorter than a sample is missed, and so by
two samples at 5000 samples/s, and at lower rates by the more the longer a sample is, up to the time for
which contacts bounce (docs/hardware.md, "Buttons and people"; longer ones are rare). That is the change of
the force over that time. The noise: 2.6 standard deviations of the fit, from that of the rest. The shape: a
curve is no line, whose error grows with the square of `reach`, so a third of what twice the reach changes.
Of presses of simulated buttons that nobody chose, at 500 to 48,000 samples/s, 98 of 100 forces or more are
within it (tests/acquisition/presses/test_rates.py).

What breaks it: a first touch that is missed for longer than two samples; a contact whose sensor is late by
more than the rig file says. An error of the sensor's gain is no part of it.

Where no contact was recorded, the button switched at the snap of its force, or at its click (`Snaps`). Model:
the force of a button that snaps falls while the finger goes on, and rises again behind the snap; the
contact switches within that fall. Of several falls (a latch has two) it is the last that is half as deep as
the deepest, on the way to the largest force. The fall takes some ms, and the click that the snap sheds into
the cap is its sharpest mark: where motion is measured, the activation is the beginning of the largest click
within the fall, else the fall's steepest point. Without a force it is the beginning of the first click that
is 0.6 as large as the largest, of the downstroke where travel tells it.

Assumed: the contact switches at the snap. What breaks it: a button without a snap; one whose contact closes
before or behind it, by the time that the finger takes from one to the other (on the simulated buttons the
contact comes 1 to 3 ms behind the click); a finger that knocks louder than the button clicks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base.arrays import FloatArray
from ...base.parts import Parted
from ..recording import Recording
from .filtering import Above
from .segmentation_settings import Segmentation

_FEWEST = 2
"""Samples on each side of the instant: three unknowns are fitted."""
_MISSED, _SURE, _BOUNCE = 2.0, 2e-4, 3e-3
"""Samples as measured by which the contact may have changed earlier, if they last for the second (s) or less;
s that contacts bounce for."""
_WITHIN = 0.5
"""Samples as measured by which it may have changed later."""
_SIGMAS = 2.6
_SHAPE = 1 / 3


class Instant(NamedTuple):
    """An instant (samples) on the clock of a signal that was measured at every `step`-th of its samples."""

    at: float
    step: float
    """1, or more in a signal that was resampled to a higher rate."""
    rate_hz: float
    """Samples/s of that clock."""
    behind: float = 0.0
    """Samples by which it may be later, beyond its own half sample."""

    @property
    def early(self) -> float:
        """Samples by which it may be earlier."""
        lasts = self.step / self.rate_hz
        missed = min(_MISSED * max(1.0, lasts / _SURE), max(_BOUNCE / lasts, _MISSED))
        return missed * self.step


def force_at(
    signal: FloatArray | Parted, instant: Instant, reach: float, noise: float
) -> tuple[float, float] | None:
    """The value of a signal (samples,) at an instant, and its uncertainty in the same unit.

    `reach` is in samples, `noise` the standard deviation of a sample. None at the ends of a signal, where
    there are not enough samples on both sides.
    """
    reach = max(reach, _FEWEST * instant.step)
    found = _two_lines(signal, instant.at, reach)
    if found is None:
        return None
    value, before, after, spread = found
    early, late = instant.early, _WITHIN * instant.step + instant.behind
    near = [_two_lines(signal, instant.at + by, reach) for by in (-early, late)]
    moved = max(
        early * abs(before), late * abs(after), *(abs(one[0] - value) for one in near if one is not None)
    )
    wide = _two_lines(signal, instant.at, 2 * reach)
    shape = 0.0 if wide is None else _SHAPE * abs(wide[0] - value)
    return value, moved + shape + _SIGMAS * noise * spread * float(np.sqrt(instant.step))


def _two_lines(
    signal: FloatArray | Parted, at: float, reach: float
) -> tuple[float, float, float, float] | None:
    """Value, slopes before and after (1/sample) and relative deviation of two lines that meet at `at`."""
    low, high = max(0, int(np.ceil(at - reach))), min(len(signal), int(np.floor(at + reach)) + 1)
    t = np.arange(low, high) - at
    if np.count_nonzero(t < 0) < _FEWEST or np.count_nonzero(t > 0) < _FEWEST:
        return None
    basis = np.stack([np.ones_like(t), np.minimum(t, 0.0), np.maximum(t, 0.0)], axis=1)
    value, before, after = np.linalg.lstsq(basis, signal[low:high], rcond=None)[0]
    return float(value), float(before), float(after), float(np.sqrt(np.linalg.inv(basis.T @ basis)[0, 0]))


BEHIND = 0.003
"""s by which the contact may have changed later than the click (above)."""
_DEEP = 0.5
"""Depth of a fall over the deepest one's from which it can be the activation."""
_LOUD = 0.6
"""Size of a click over the largest one's from which it can be the activation."""
_NEAR = 0.008
"""s: longest time from the beginning of a click to its largest swing, and by which it is beside the fall."""
_BEGINS = 0.15
"""A click begins where it first has this part of its largest swing."""


class Snaps:
    """Finds activations in a recording's force and motion."""

    def __init__(self, recording: Recording, p: Segmentation, shaken: Parted | None) -> None:
        self._recording, self._p, self._shaken = recording, p, shaken

    def activation(
        self, force: Above | None, above: Above, start: int, onset: int, release: int
    ) -> tuple[float, str] | None:
        """Instant (samples) of the activation of a press, and what told it; None where nothing does.

        `force` is above its rest, (samples,) N smoothed, or None without one; `above` is the quantity that
        tells presses.
        """
        if force is not None:
            return self._snap(force, start, onset, release)
        quantity = self._recording.motion
        if quantity is None or self._shaken is None:
            return None
        # A travel tells the downstroke: the click of the release comes after the largest one.
        stop = onset + int(np.argmax(above[onset : release + 1])) if quantity == "displacement" else release
        at = self._click(start, onset, onset, max(stop, onset + 1), _LOUD)
        return None if at is None else (at, quantity)

    def _snap(self, force: Above, start: int, onset: int, release: int) -> tuple[float, str] | None:
        fall = _fall(force[onset : release + 1], self._p.snap_share)
        if fall is None:
            return None
        first, last = onset + fall[0], onset + fall[1]
        near = round(_NEAR * self._recording.rate_hz)
        clicked = self._click(start, onset, max(onset, first - near), last + near, 1.0)
        if clicked is not None:
            return clicked, "force"
        steepest = first + int(np.argmin(np.diff(force[first : last + 1])))
        return steepest + 0.5 + self._recording.delay("force") * self._recording.rate_hz, "force"

    def _click(self, start: int, onset: int, first: int, last: int, share: float) -> float | None:
        """Beginning (samples) of the first click of a span that has this share of the largest."""
        shaken, quantity = self._shaken, self._recording.motion
        if shaken is None or quantity is None or last <= first:
            return None
        quiet = shaken[start:onset]
        noise = float(np.sqrt(np.mean(quiet**2))) if len(quiet) else 0.0
        part = shaken[first:last]
        most = float(part.max())
        if most <= self._p.stage_noise * noise:
            return None
        reached = first + int(np.argmax(part >= share * most))
        near = round(_NEAR * self._recording.rate_hz)
        top = reached + int(np.argmax(shaken[reached : reached + near + 1]))
        low = max(start, top - near)
        rising = shaken[low : top + 1]
        begins = low + int(np.argmax(rising > max(_BEGINS * float(rising[-1]), 3 * noise)))
        return begins - 0.5 + self._recording.delay(quantity) * self._recording.rate_hz


def _fall(force: FloatArray, share: float) -> tuple[int, int] | None:
    """First and last index of the fall of the force at the snap; None without one."""
    least = share * float(force.max(initial=0.0))
    falls: list[tuple[int, int]] = []
    top = bottom = 0
    falling = False
    for index, value in enumerate(force.tolist()):
        if not falling:
            if value >= force[top]:
                top = index
            elif value < force[top] - least:
                falling, bottom = True, index
        elif value <= force[bottom]:
            bottom = index
        elif value > force[bottom] + least:
            falls.append((top, bottom))
            falling, top = False, index
    peak = int(np.argmax(force)) if len(force) else 0
    # The fall from the largest force is the release, unless that force was the snap's.
    before = [one for one in falls if one[0] < peak] or [one for one in falls if one[0] == peak]
    depths = [force[first] - force[last] for first, last in before]
    deep = [one for one, depth in zip(before, depths, strict=True) if depth >= _DEEP * max(depths)]
    return deep[-1] if deep else None
