"""Where a signal of force or travel rests: what it shows before the first press and after the last one.

Model: a file begins or ends without a finger on the button. A median of the whole file is no rest: a button
held for more than half of it would be called upside down. Where start and end disagree so far that the
signal rises from one and falls from the other, only a person knows which of them is the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...base.arrays import FloatArray

End = Literal["start", "end"]
_SHARE, _FEWEST, _LONGEST = 0.02, 5, 0.1
"""Of a file, samples, and s: how much of its start and end is looked at."""
_NEAR = 0.1
"""Difference of start and end, over the signal's span, up to which they agree: creep, drift and noise."""
_FALLS = 2.0
"""A signal is upside down when it falls from its rest by more than this multiple of its rise."""


@dataclass(frozen=True)
class Rest:
    """The values (in the signal's unit) at both ends of a file, and how far the signal goes from them."""

    start: float
    end: float
    seconds: float
    """Length of either end that was looked at."""
    low: float
    high: float
    """The signal's smallest and largest value."""

    @property
    def agrees(self) -> bool:
        """True when start and end show the same rest."""
        return abs(self.end - self.start) <= _NEAR * (self.high - self.low)

    def at(self, told: End | None) -> float:
        """The value at rest: at the end that was told, else where both agree their mean, else the start."""
        if told == "end":
            return self.end
        return 0.5 * (self.start + self.end) if told is None and self.agrees else self.start

    def falls(self, told: End | None) -> bool | None:
        """Whether the signal falls from its rest when pressed; None where start and end disagree on it."""
        ends = [self.at(told)] if told or self.agrees else [self.start, self.end]
        found = {rest - self.low > _FALLS * (self.high - rest) for rest in ends}
        return found.pop() if len(found) == 1 else None

    def words(self, told: End | None, unit: str) -> str:
        """The rest, and where in the file it was taken from."""
        length = f"{1e3 * self.seconds:.3g} ms"
        if told is not None:
            return (
                f"{self.at(told):.3g} {unit}, in its {'last' if told == 'end' else 'first'} {length}, as told"
            )
        if self.agrees:
            return f"{self.at(None):.3g} {unit}, in its first and last {length}"
        return f"{self.start:.3g} {unit} in its first {length}, {self.end:.3g} in its last"


def rest_of(values: FloatArray, rate_hz: float) -> Rest:
    """The rest of (samples,), from both ends."""
    most = max(_FEWEST, round(_LONGEST * rate_hz))
    count = min(max(_FEWEST, round(_SHARE * len(values))), most, len(values))
    return Rest(
        float(np.median(values[:count])), float(np.median(values[-count:])), count / rate_hz,
        float(values.min()), float(values.max()))  # fmt: skip
