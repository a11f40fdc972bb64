"""Presses in which the button clicked once more than in the participant's others.

A click is a burst of the acceleration's envelope. Of presses aligned at their activation, the median envelope
holds each usual burst, whatever a minority does; a press may have it earlier or later by as much as a warp
reaches, and be louder or softer as a whole. A burst beyond the usual ones, in a press that misses none of
them, is one click more: a finger that bounced, or pressed twice. (One that misses one is only slower.) Such
a press has no place in an average: a warp can neither remove the second click nor share it.

Assumed: less than half of the presses have it, and their clicks come within the reach of each other. A second
click within the reach of a usual one, or of less than a third of the loudest, is not told.
"""

from __future__ import annotations

import numpy as np
import scipy

from ...base.arrays import FloatArray

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
