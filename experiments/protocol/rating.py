"""Answers on scales, and what a person can do in a time.

A scale stands in the middle when the question appears, and has no value until it is touched: a middle that
nobody chose is no rating. So each scale's value comes with the times at which it was touched.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

FASTEST = 0.1
"""s for one choice or one scale. Nobody answers a stimulus sooner: Luce, Response Times (1986)."""
SLOWEST = 600.0
"""s for an answer. Our limit: whoever takes longer did something else as well."""

Timing = Literal["possible", "too fast", "too slow", "n/a"]


@dataclass(frozen=True)
class Rated:
    """What was set on one scale."""

    value: float
    touched: tuple[float, ...]
    """When the scale was touched: s since the question appeared, in order, once or more."""


def rated(pairs: Sequence[str], scale: tuple[float, float], answer: Any) -> dict[str, Rated] | str:
    """The ratings of all pairs, from {pair: {"value": ..., "touched": [...]}}; or what was expected."""
    low, high = scale
    given = answer if isinstance(answer, Mapping) and set(answer) == set(pairs) else {}
    wrong = [pair for pair in pairs if not _is_set(given.get(pair), low, high)]
    if wrong:
        return (
            f"a number from {low:g} to {high:g}, and when the scale was touched, for {', '.join(wrong)} (a "
            "scale has no value until it is touched)"
        )
    return {
        pair: Rated(float(answer[pair]["value"]), tuple(map(float, answer[pair]["touched"])))
        for pair in pairs
    }


def timing_of(answer: object, duration: float | None) -> Timing:
    """Whether a person can have answered in this time (s, from the stimulus); "n/a" when it is not known.

    Scales are judged by the first touch of each, from the appearance of the question: another one needs
    `FASTEST` more.
    """
    if duration is None:
        return "n/a"
    needed, taken = FASTEST, duration
    if isinstance(answer, Mapping):
        firsts = [one.touched[0] for one in answer.values()]
        needed, taken = FASTEST * len(firsts), min(duration, max(firsts))
    if taken < needed:
        return "too fast"
    return "too slow" if duration > SLOWEST else "possible"


def _is_set(one: Any, low: float, high: float) -> bool:
    if not isinstance(one, Mapping) or one.keys() != {"value", "touched"}:
        return False
    times = one["touched"]
    return (
        isinstance(times, list | tuple)
        and len(times) > 0
        and all(map(_is_number, [one["value"], *times]))
        and times[0] >= 0
        and low <= one["value"] <= high
        and all(before <= after for before, after in pairwise(times))
    )


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
