"""The least sample rates of steps that need one. docs/how-to/recording.md shows this table.

A rate counts as it was measured: an import is resampled, which adds nothing. A clock that is a percent slow
is no other rate.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

from ...base.errors import ConfigurationError

Step = Literal["recording", "force at activation", "representative press"]
_MARGIN = 0.99


class Least(NamedTuple):
    """The least rate (samples/s) of a step, and what is lost below it, as a clause."""

    hz: float
    why: str


LEAST_RATES: Mapping[Step, Least] = MappingProxyType(
    {
        "recording": Least(500.0, "it records the force at activation and what a press is felt by"),
        "force at activation": Least(500.0, "two samples on each side of it last as long as the snap, 4 ms"),
        "representative press": Least(500.0, "the skin feels vibration best near 250 Hz, half of it"),
    }
)


def fast_enough(step: Step, rate_hz: float) -> bool:
    """True when `rate_hz` (samples/s) is enough for a step."""
    return rate_hz >= _MARGIN * LEAST_RATES[step].hz


def require_rate(step: Step, rate_hz: float, whose: str, remedy: str) -> None:
    """Raise ConfigurationError when `rate_hz` (samples/s) of `whose` is too low for a step."""
    least = LEAST_RATES[step]
    if not fast_enough(step, rate_hz):
        raise ConfigurationError(
            f"{whose} has {rate_hz:g} samples/s, and a {step} needs {least.hz:g}, because {least.why}: "
            f"{remedy}."
        )
