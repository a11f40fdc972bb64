"""When a button switched, where no contact was recorded: at the snap of its force, or at its click.

Model: the force of a button that snaps falls while the finger goes on, and rises again behind the snap; the
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

import numpy as np

from ...base.arrays import FloatArray
from ..recording import Recording
from .segmentation_settings import Segmentation

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

    def __init__(self, recording: Recording, p: Segmentation, shaken: FloatArray | None) -> None:
        self._recording, self._p, self._shaken = recording, p, shaken

    def activation(
        self, force: FloatArray | None, above: FloatArray, start: int, onset: int, release: int
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

    def _snap(self, force: FloatArray, start: int, onset: int, release: int) -> tuple[float, str] | None:
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
        level = max(_BEGINS * float(shaken[top]), 3 * noise)
        begins = low + int(np.argmax(shaken[low : top + 1] > level))
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
