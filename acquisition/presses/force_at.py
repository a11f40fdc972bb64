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
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base.arrays import FloatArray

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


def force_at(signal: FloatArray, instant: Instant, reach: float, noise: float) -> tuple[float, float] | None:
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


def _two_lines(signal: FloatArray, at: float, reach: float) -> tuple[float, float, float, float] | None:
    """Value, slopes before and after (1/sample) and relative deviation of two lines that meet at `at`."""
    low, high = max(0, int(np.ceil(at - reach))), min(len(signal), int(np.floor(at + reach)) + 1)
    t = np.arange(low, high) - at
    if np.count_nonzero(t < 0) < _FEWEST or np.count_nonzero(t > 0) < _FEWEST:
        return None
    basis = np.stack([np.ones_like(t), np.minimum(t, 0.0), np.maximum(t, 0.0)], axis=1)
    value, before, after = np.linalg.lstsq(basis, signal[low:high], rcond=None)[0]
    return float(value), float(before), float(after), float(np.sqrt(np.linalg.inv(basis.T @ basis)[0, 0]))
