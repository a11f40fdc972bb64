"""Custom scales: from volts at a terminal to the units that a program works in, and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.polynomial import polyval

from instruments.arrays import FloatArray

__all__ = ["Scale", "linear"]


@dataclass(frozen=True)
class Scale:
    """A polynomial each way, as NI-DAQmx keeps it: coefficients from the constant up."""

    forward: tuple[float, ...]
    reverse: tuple[float, ...]

    def to_units(self, volts: FloatArray) -> FloatArray:
        """Volts of any shape in the scale's units."""
        return np.asarray(polyval(volts, self.forward))

    def to_volts(self, values: FloatArray) -> FloatArray:
        """The reverse of `to_units`."""
        return np.asarray(polyval(values, self.reverse))


def linear(slope: float, intercept: float) -> Scale:
    """The scale `slope * volts + intercept`. Raises ZeroDivisionError for a slope of zero."""
    return Scale((intercept, slope), (-intercept / slope, 1 / slope))
