"""What a finger would feel of a checked drive, against the press that was recorded."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ...base.arrays import FloatArray
from ..perception import Feeling, Pressed, feeling_of
from .checked import Check
from .targets import BEFORE

if TYPE_CHECKING:
    from ...acquisition import Representative

_RATES = 1000
"""Largest denominator of the ratio of two sample rates."""


def check_feeling(check: Check, press: Representative | None = None) -> Feeling:
    """Compare the motion of a check with the thresholds of detection, and with `press` at its own size.

    `press` is the one that the drive was computed for.
    """
    return feeling_of(
        check.target,
        check.measured,
        check.rate_hz,
        Pressed(lab=check.lab) if press is None else _pressed(press, check),
        check.accelerations,
    )


def _pressed(press: Representative, check: Check) -> Pressed:
    force = None if press.force is None else float(press.force[press.activation_index])
    return Pressed(_on_clock(press, check.rate_hz, len(check.target)), force, check.lab)


def _on_clock(press: Representative, rate_hz: float, samples: int) -> FloatArray:
    """(samples,) m/s^2: a recorded press on the clock of its drive, which begins before it."""
    ratio = Fraction(rate_hz / press.rate_hz).limit_denominator(_RATES)
    acceleration = scipy.signal.resample_poly(
        np.asarray(press.acceleration), ratio.numerator, ratio.denominator
    )
    start = round(BEFORE * rate_hz)
    out = np.zeros(samples)
    kept = acceleration[: samples - start]
    out[start : start + len(kept)] = kept
    return out
