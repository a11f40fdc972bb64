"""What has reached the patches, worked out from the plant's own record and by none of the product's code."""

from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from haploop.mocks.plant import AmplifierOutput

STEP = 20e-6
"""Seconds in which an output changes that had been resting."""
SILENT = 1e-3
"""V: what an FFT leaves where a resampled waveform has ended."""
GAP = 0.03
"""Seconds of zero volts that part two bursts."""


@dataclass(frozen=True)
class Burst:
    start: float
    stop: float
    low: float
    high: float
    slew: float
    cut: float
    """V/s of the step with which it ended."""
    mean: float
    first: float
    last: float
    patches: int
    charge: float
    """Largest sum of |dv| in any second."""

    @property
    def seconds(self) -> float:
        return self.stop - self.start


def bursts(record: list[AmplifierOutput]) -> list[Burst]:
    """Everything that was not zero volts at a closed patch, in one piece where it hangs together."""
    times, volts, steps, patches = [], [], [], []
    for output in record:
        count = len(output.volts)
        period = output.period if output.period < 1e-3 else STEP
        times.append(output.start + np.arange(count) * (period if count > 1 else 0.0))
        volts.append(output.volts if output.closed else np.zeros(count))
        steps.append(np.full(count, period))
        patches.append(np.full(count, len(output.closed)))
    if not times:
        return []
    t, v, step, n = (np.concatenate(x) for x in (times, volts, steps, patches))
    change = np.abs(np.diff(v, prepend=0.0))
    loud = np.flatnonzero(np.abs(v) > SILENT)
    if not len(loud):
        return []
    parts = np.split(loud, np.flatnonzero(np.diff(t[loud]) > GAP) + 1)
    found = []
    for part in parts:
        first, last = part[0], part[-1]
        # The step back to zero belongs to it; the last value is held until then.
        after = min(last + 1, len(t) - 1)
        inside = slice(first, after + 1)
        total = np.cumsum(change[inside])
        second_before = np.searchsorted(t[inside], t[inside] - 1.0)
        found.append(Burst(
            start=float(t[first]), stop=float(max(t[after], t[last] + step[last])),
            low=float(v[inside].min()), high=float(v[inside].max()), mean=float(v[first : last + 1].mean()),
            first=abs(float(v[first])), last=abs(float(v[last])), patches=int(n[part].max()),
            slew=float((change[inside] / step[inside])[: part[-1] - first + 1].max()),
            cut=float(change[after] / step[after]),
            charge=float((total - np.concatenate([[0.0], total])[second_before]).max()),
        ))  # fmt: skip
    return found


def of_patch(record: list[AmplifierOutput], patch: str) -> list[AmplifierOutput]:
    """What one patch got of a record in which several amplifiers put something out at the same times."""
    found = []
    for _, together in groupby(record, key=lambda output: (output.start, output.period, len(output.volts))):
        first, *others = together
        own = [output for output in (first, *others) if patch in output.closed]
        found.append(replace(own[0] if own else first, closed=frozenset({patch} if own else ())))
    return found


def busiest_minute(found: list[Burst]) -> float:
    """Seconds of the busiest minute in which something was played."""
    ends = [burst.stop for burst in found]
    return max(
        (sum(max(0.0, min(b.stop, end) - max(b.start, end - 60.0)) for b in found) for end in ends),
        default=0.0,
    )
